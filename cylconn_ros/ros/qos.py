"""Quality of service of the topics, and warnings about peers with incompatible QoS."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import (
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

DEPTH = 50


def samples() -> QoSProfile:
    """Reliable, keep last 50, volatile: no loss at several thousand samples per second."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE
    )


def overriding() -> QoSOverridingOptions:
    """Let the standard ``qos_overrides`` parameters change history, depth and reliability."""
    return QoSOverridingOptions.with_default_policies()


def subscription_events(report: Callable[[str], None]) -> dict[str, Any]:
    """Event callbacks of a subscription: a publisher's QoS or type is incompatible.

    ``report`` gets the name of the policy. The message_lost event is not used: rmw_fastrtps (Jazzy)
    deadlocks if a message is lost while the status is taken, which a flood of messages causes
    within seconds. Lost messages are counted by their sequence numbers
    (ros/executor/sequence_numbers.py).
    """
    return {
        "event_callbacks": SubscriptionEventCallbacks(
            incompatible_qos=lambda event: report(_policy(event)),
            incompatible_type=lambda _: report("message type"),
        )
    }


def publisher_events(report: Callable[[str], None]) -> dict[str, Any]:
    """Event callbacks of a publisher: a subscription requests more than is offered."""
    return {
        "event_callbacks": PublisherEventCallbacks(
            incompatible_qos=lambda event: report(_policy(event)),
            incompatible_type=lambda _: report("message type"),
        )
    }


def incompatible(topic: str, policy: str, is_input: bool) -> str:
    """Warning about a peer of ``topic`` whose ``policy`` is incompatible, with the remedy."""
    if not is_input:
        remedy = f"request no more than RELIABLE, VOLATILE, keep last {DEPTH}"
    elif policy == "reliability":
        override = f"qos_overrides.{topic}.subscription.reliability"
        remedy = f"publish RELIABLE, or set {override} to best_effort"
    else:
        remedy = f"publish RELIABLE, VOLATILE, keep last {DEPTH}"
    return f"{topic}: a peer's QoS is incompatible ({policy}); {remedy}"


def _policy(event: Any) -> str:
    return str(qos_policy_name_from_kind(event.last_policy_kind)).lower()
