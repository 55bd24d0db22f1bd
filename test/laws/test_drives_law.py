"""The law of drives on simulated runs, and mistakes that it finds."""

from typing import Any

import numpy as np
import pytest
from scenes import sleeve, with_period

from cylconn_ros.core import layout
from cylconn_ros.laws.runs import first_violation
from cylconn_ros.simulation.simulate import Run, simulate

LIMITED: dict[str, Any] = {"velocity": 1.0, "max_force": 10.0}


def run(**changes: Any) -> Run:
    given = {"mass": 2.0, "l0": 0.0, "v": 0.0, "gravity": [0.0, 0.0, 0.0], **changes}
    return simulate(with_period(sleeve(**given), 1e-3), samples=260)


@pytest.mark.parametrize(
    "changes",
    [
        {"command": {"slide": LIMITED}},
        {"command": {"slide": {"velocity": 1.0}}, "stops": {"l_max": 0.2}},
        {"command": {"slide": LIMITED}, "stops": {"l_max": 0.02}},
        {"command": {"slide": {"position": 0.02, "approach_speed": 0.3}}},
        {"command": {"slide": {"position": 0.02, "max_force": 10.0}}, "spin": 3.0,
         "gravity": [0.0, 0.0, -9.81],
         "friction": {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 5.0}},
    ],
)  # fmt: skip
def test_the_law_holds_and_finds_mistakes(changes: dict[str, Any]) -> None:
    found = run(**changes)
    assert first_violation(found.scene, found.states, found.outs) == ""
    most = changes["command"]["slide"].get("max_force", np.inf)
    pushes = np.abs(found["force_reaction"]) == most
    if pushes.any():
        outs = found.outs.copy()
        outs[pushes, layout.FORCE_REACTION] *= 1.001
        assert first_violation(found.scene, found.states, outs) != ""
    outs = found.outs.copy()
    flags = outs[:, layout.FLAGS].astype(int)
    outs[outs[:, layout.STOP] == 0, layout.FLAGS] = flags[0] | layout.DRIVE_BLOCKED
    assert "stops" in first_violation(found.scene, found.states, outs)
