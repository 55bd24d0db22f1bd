"""A connector node on an rclpy, rcl or system that lacks one interface: its name, then arguments.

``CLASS.METHOD`` is of rclpy's extension module, ``Node._subscriptions`` of rclpy, ``os.NAME`` and
``select.NAME`` of Python, and anything else a function of a C library.
"""

import ctypes
import os
import select
import sys
from typing import Any

from cylconn_ros.ros.connector.node import main
from cylconn_ros.ros.executor import executor


class Library(ctypes.CDLL):
    """Without the function ``removed``."""

    def __getattr__(self, name: str) -> Any:
        if name == REMOVED:
            raise AttributeError(name)
        return super().__getattr__(name)


REMOVED = sys.argv.pop(1)
OWNER, _, NAME = REMOVED.rpartition(".")
if OWNER in ("os", "select"):
    delattr({"os": os, "select": select}[OWNER], NAME)
elif OWNER == "Node":
    executor.getattr = lambda thing, name, *rest: (  # type: ignore[attr-defined]
        None if name == NAME else getattr(thing, name, *rest)
    )
elif OWNER:
    executor.hasattr = lambda thing, name: (  # type: ignore[attr-defined]
        hasattr(thing, name) and (thing.__name__, name) != (OWNER, NAME)
    )
else:
    ctypes.CDLL = Library  # type: ignore[misc]

if __name__ == "__main__":
    raise SystemExit(main())
