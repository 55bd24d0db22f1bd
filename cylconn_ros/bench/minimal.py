"""The method ``minimal`` as a simulation of its own, where it is installed."""

from __future__ import annotations

import importlib
from typing import Any

from cylconn_ros.bench.errors import AbsentError
from cylconn_ros.connector.scene import Scene

MODULE = "cylconn_ros.connector.minimal_simulation"


def solve(scene: Scene, duration: float, rtol: float) -> Any:
    """Its solution; raises AbsentError."""
    try:
        module = importlib.import_module(MODULE)
    except ModuleNotFoundError as error:
        if error.name != MODULE:
            raise
        raise AbsentError("is not written yet") from None
    return module.solve(scene, duration, rtol)
