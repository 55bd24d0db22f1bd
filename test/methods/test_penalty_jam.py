"""A jam held by method penalty: the weight hangs beside the shaft, coupling 2 mu d / L = 1.2."""

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import closed_loop

UPWARDS = [0.0, -(0.5**0.5), 0.0, 0.5**0.5]


def test_a_loaded_jam_is_held_and_gains_stay() -> None:
    scene = Scene.from_parameters(
        {
            "method": "penalty",
            "body_a": {"kind": "fixed"},
            "body_b": {
                "kind": "unknown",
                "mass": 1.0,
                "com": [0.1, 0.0, 0.0],
                "inertia": [0.001, 0.0, 0.0, 0.002, 0.0, 0.002],
            },
            "node_a": {"orientation": UPWARDS},
            "friction": {"coefficient": 0.6, "radius": 0.02, "overlap": 0.1, "preload": 5.0},
            "penalty": {"stiffness": 1e5, "damping": 200.0},
        }
    )
    run = closed_loop(scene, 601)
    slid = np.abs(run.outs[:, layout.DISPLACEMENT])
    assert slid.max() < 1e-3
    flags = run.outs[:, layout.FLAGS].astype(int)
    assert not (flags & layout.GAINS_LOWERED).any()
