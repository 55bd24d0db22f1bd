"""Quality of service of the topics, and warnings about peers with incompatible QoS."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import (
    HistoryPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

DEPTH = 50
"""Messages that a publisher keeps."""
INPUT_DEPTH = 1000
"""Messages that wait at an input: `ros2 bag play` publishes in bursts of more than 50 at 1 kHz, and
1000 hold what arrives in 50 ms at 20 kHz. The queue grows with the messages in it."""


def samples(reliability: str = "reliable", depth: int = DEPTH) -> QoSProfile:
    """Keep last, volatile, and reliable: no loss at several thousand samples per second.

    ``reliability``: "reliable", or "best_effort" for subscriptions to publishers of either kind.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy[reliability.upper()],
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
    if is_input and policy == "reliability":
        return (
            f"{topic}: a publisher is best_effort (expected reliable), its messages are not "
            "received; publish reliable, or set qos.reliability: best_effort"
        )
    if is_input:
        return (
            f"{topic}: a publisher's QoS is incompatible ({policy}), its messages are not "
            f"received; publish reliable, volatile, keep last {DEPTH}"
        )
    return (
        f"{topic}: a subscription's QoS is incompatible ({policy}), it receives nothing; request "
        f"no more than reliable, volatile, keep last {DEPTH}"
    )


def are_compatible(publisher: QoSProfile, subscription: QoSProfile) -> bool:
    """Whether messages pass from a publisher to a subscription."""
    compatibility, _ = qos_check_compatible(publisher, subscription)
    return bool(compatibility != QoSCompatibility.ERROR)


def _policy(event: Any) -> str:
    return str(qos_policy_name_from_kind(event.last_policy_kind)).lower()
