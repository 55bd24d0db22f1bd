"""Quality of service of every topic, and the telling when a peer offers less."""

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
    """Reliable, keep last 50, volatile: nothing is lost at several thousand samples a second."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE
    )


def overriding() -> QoSOverridingOptions:
    """Let the standard ``qos_overrides`` parameters change history, depth and reliability."""
    return QoSOverridingOptions.with_default_policies()


def reading(report: Callable[[str], None]) -> dict[str, Any]:
    """Event callbacks of a subscription: incompatible publishers.

    Not that of lost messages: rmw_fastrtps locks up for good (Jazzy) where one is lost while the
    status is taken, which a flood does within seconds. Losses are seen by their gaps (ros/executor/sequence_numbers.py).
    """
    return {
        "event_callbacks": SubscriptionEventCallbacks(
            incompatible_qos=lambda event: report(_policy(event)),
            incompatible_type=lambda _: report("message type"),
        )
    }


def writing(report: Callable[[str], None]) -> dict[str, Any]:
    """Event callbacks of a publisher: subscribers that ask for more than is offered."""
    return {
        "event_callbacks": PublisherEventCallbacks(
            incompatible_qos=lambda event: report(_policy(event)),
            incompatible_type=lambda _: report("message type"),
        )
    }


def _policy(event: Any) -> str:
    return str(qos_policy_name_from_kind(event.last_policy_kind)).lower()
