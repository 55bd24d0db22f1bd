"""Persistent wait set for benchmark clients; the nodes use ros/executor/new_message_event.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.context import Context


class WaitSet:
    """Wait repeatedly for the same subscriptions."""

    def __init__(self, handles: Sequence[Any], context: Context) -> None:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        self._handles = list(handles)
        self._set = rclpy_implementation.WaitSet(len(handles), 0, 0, 0, 0, 0, context.handle)

    def wait(self, timeout: int) -> bool:
        """Wait up to ``timeout`` ns; return True if a message has arrived."""
        self.wait_only(timeout)
        return bool(self._set.get_ready_entities("subscription"))

    def wait_only(self, timeout: int) -> None:
        """Wait up to ``timeout`` ns without checking which subscriptions are ready."""
        waiting = self._set
        waiting.clear_entities()
        for handle in self._handles:
            waiting.add_subscription(handle)
        waiting.wait(timeout)
