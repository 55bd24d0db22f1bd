"""What is unusual about the configuration in which a history begins."""

from __future__ import annotations

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import model
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.initial import apart_at

_RESOLUTION = 1e-9  # m or rad: a start at a stop is not beyond it


def start_warnings(connector: Connector) -> list[str]:
    """Warnings about a start beyond a stop or apart; empty before the first sample."""
    memory, scene = connector.memory, connector.scene
    if memory[model.HAS_REFERENCE] == 0.0:
        return []
    apart = apart_at(scene.friction, memory[model.LENGTH0], memory[model.LENGTH0])
    found = [apart] if apart else []
    if not TRAITS[connector.method].has_limits:
        return found
    stops, reference = scene.stops, scene.reference
    for soft, start, name, (low, high), what, unit, speed in (
        (stops.compliant[0], memory[model.LENGTH0], "l", (stops.l_min, stops.l_max),
         "slide", "m", f"reference.pull_in_speed ({reference.pull_in_speed:g} m/s)"),
        (stops.compliant[1], memory[model.ANGLE0], "theta", (stops.theta_min, stops.theta_max),
         "spin", "rad", f"reference.pull_in_rate ({reference.pull_in_rate:g} rad/s)"),
    ):  # fmt: skip
        for end, stop, beyond in (("min", low, low - start), ("max", high, start - high)):
            if beyond > _RESOLUTION and not soft:  # False if the stop is not given
                found.append(
                    f"{what} starts at {start:.6g} {unit}, beyond stops.{name}_{end} ({stop:g} "
                    f"{unit}): it is pulled in at no more than {speed}; check the initial pose or "
                    "the stop"
                )
    return found
