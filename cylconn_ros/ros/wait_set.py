"""A wait set that is kept: for who asks nodes and waits for answers; nodes hear bells instead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.context import Context


class WaitSet:
    """Subscriptions to be waited for again and again."""

    def __init__(self, handles: Sequence[Any], context: Context) -> None:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        self._handles = list(handles)
        self._set = rclpy_implementation.WaitSet(len(handles), 0, 0, 0, 0, 0, context.handle)

    def wait(self, timeout: int) -> bool:
        """Wait up to ``timeout`` ns; whether anything has come."""
        self.wait_only(timeout)
        return bool(self._set.get_ready_entities("subscription"))

    def wait_only(self, timeout: int) -> None:
        """Wait up to ``timeout`` ns, for who looks himself what has come."""
        waiting = self._set
        waiting.clear_entities()
        for handle in self._handles:
            waiting.add_subscription(handle)
        waiting.wait(timeout)
