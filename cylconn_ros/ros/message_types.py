"""Import message classes by type name."""

from __future__ import annotations

import importlib
from typing import Any


def message_class(name: str) -> Any:
    """Import the class of a type such as ``geometry_msgs/msg/PoseStamped``."""
    package, subfolder, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.{subfolder}"), kind)
