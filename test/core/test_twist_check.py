"""Twists against poses: no false alarm in any scene, and none at an impact within a sample."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model
from cylconn_ros.reference.library import LIBRARY
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

H = 0.002
INERTIA = [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]


def flags(outs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Samples with the flag."""
    found = outs[..., layout.FLAGS].astype(np.int64) & layout.TWIST_CONTRADICTS
    return np.asarray(found != 0)


@pytest.mark.parametrize("latency", [0, -1])
@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_no_scene_raises_the_flag(name: str, integration: str, latency: int) -> None:
    changes = {"plant_integration": integration, "latency": latency}
    run = simulate(bundled(name).replace(changes), duration=1.0)
    assert not flags(run.outs).any()


def drawer(**changes: object) -> Connector:
    """A drawer on a rail."""
    return Connector(
        Scene.from_parameters(
            {
                "node_a.orientation": [0, 0, 0, 1],
                "body_b.mass": 2.0,
                "body_b.inertia": INERTIA,
                "friction.coefficient": 0.2,
                "friction.radius": 0.02,
                "period": H,
                **changes,
            }
        )
    )


def moved(connector: Connector, positions: list[float], velocities: list[float]) -> list[bool]:
    """Flags for positions and velocities along the rail, m and m/s."""
    found = []
    for x, v in zip(positions, velocities, strict=True):
        out = connector.step(pose_b=[x, 0, 0, 0, 0, 0, 1], twist_b=[v, 0, 0, 0, 0, 0], h=H)
        found.append(bool(int(out.array[layout.FLAGS]) & layout.TWIST_CONTRADICTS))
    return found


@pytest.mark.parametrize("latency", [0, 1, -1])
def test_a_stop_and_an_impact_within_a_sample_are_no_contradiction(latency: int) -> None:
    connector = drawer(latency=latency)
    at = [0.0, 1.0 * H, 1.0 * H, 1.0 * H, 2.0 * H, 2.2 * H, 1.7 * H, 1.2 * H]
    velocity = [1.0, 1.0, 0.0, 0.0, 1.0, -0.5, -0.5, -0.5]
    #           the drawer stops (h v+)    starts   bounces within the sample
    assert moved(connector, at, velocity) == [False] * 8


@pytest.mark.parametrize("latency", [0, 1, -1])
def test_a_motion_outside_the_velocities_is_a_contradiction_and_is_stored(latency: int) -> None:
    connector = drawer(latency=latency)
    assert moved(connector, [0.0, H, 3.0 * H], [1.0, 1.0, 1.0]) == [False, False, True]
    stored = connector.memory[model.CONTRADICTION : model.CONTRADICTION + 6]
    assert stored[:3].tolist() == [0.0, 0.0, 0.0]  # body A is fixed
    assert stored[3:] == pytest.approx([4.0 * H * H, H * H, 2.0 * H * H])
