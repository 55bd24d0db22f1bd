"""A jam held by method penalty: the weight hangs beside the shaft, coupling 2 mu d / L = 1.2."""

import numpy as np
import pytest

from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import closed_loop

UPWARDS = [0.0, -(0.5**0.5), 0.0, 0.5**0.5]


def jam(mass: float, stiffness: float, damping: float, speed: float = 0.0) -> Scene:
    return Scene.from_parameters(
        {
            "method": "penalty",
            "body_a": {"kind": "fixed"},
            "body_b": {
                "kind": "unknown",
                "mass": mass,
                "com": [0.1, 0.0, 0.0],
                "inertia": [0.001 * mass, 0.0, 0.0, 0.002 * mass, 0.0, 0.002 * mass],
            },
            "node_a": {"orientation": UPWARDS},
            "friction": {"coefficient": 0.6, "radius": 0.02, "overlap": 0.1, "preload": 5.0},
            "penalty": {"stiffness": stiffness, "damping": damping},
            "plant": {"body_b": {"twist": [0.0, 0.0, -speed, 0.0, 0.0, 0.0]}},
        }
    )


def test_a_loaded_jam_is_held_and_gains_stay() -> None:
    run = closed_loop(jam(1.0, 1e5, 200.0), 601)
    slid = np.abs(run.outs[:, layout.DISPLACEMENT])
    assert slid.max() < 1e-3
    flags = run.outs[:, layout.FLAGS].astype(int)
    assert not (flags & layout.GAINS_LOWERED).any()


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_gains_ten_times_too_great_are_lowered_before_the_jam_runs_away(speed: float) -> None:
    """With c h/m = 20, friction reverses the slip in each step, and the jam makes it grow."""
    run = closed_loop(jam(0.1, 1e6, 2000.0, speed), 1001)
    flags = run.outs[:, layout.FLAGS].astype(int)
    assert (flags & layout.GAINS_LOWERED).any()
    assert np.abs(run.outs[:, layout.DISPLACEMENT]).max() < 0.1
