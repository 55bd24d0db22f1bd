"""``constraint: simulator`` over topics: a free-running MuJoCo process keeps slide and hinge."""

import json
import sys
from pathlib import Path

import pytest
from recorded_loops import scene_arguments
from ros_processes import installed, program
from scenes import bundled

from cylconn_ros.simulation.simulate import simulate

PERIOD = 0.002
CLIENT = Path(__file__).parents[1] / "mujoco_client.py"
RULES = (
    "constraint:=simulator",
    f"period:={PERIOD}",
    "latency:=-1",
    "wrench.axes:=world",
    "wrench.point:=com",
    "timeout:=.inf",
)


@pytest.mark.parametrize("lag", [0.0, 2.0, 5.0, 12.0])
def test_friction_stops_the_slide_of_a_free_running_simulator(lag, installed_prefix, tmp_path):
    """It gains no energy, comes to rest, and slides as far as the lag that occurred allows."""
    connector = [*installed(installed_prefix, "connector"), *scene_arguments("coast", *RULES)]
    client = [sys.executable, CLIENT, "coast", PERIOD, lag, 20.0]
    with program(connector, tmp_path) as connecting:
        with program(list(map(str, client)), tmp_path) as moving:
            assert moving.wait() == 0, moving.output
        assert connecting.stop() == 0, connecting.output
    found = json.loads(moving.lines[-1])
    scene = bundled("coast")
    expected = simulate(scene)["displacement"][-1]
    speed = scene.plant.body_b.twist[0]
    assert found["rests"]
    assert found["most"] <= 1.05 * found["start"]
    late = (found["age"] + 1) * PERIOD  # s, the greatest lag that occurred
    # friction begins late, ends late, and brings the last part of the speed to rest exponentially
    friction = scene.friction.coefficient * 9.81
    allowed = speed * late + friction * (4.0 * late) ** 2 + 4.0 * friction * late * 50.0 * PERIOD
    assert abs(found["distance"] - expected) < allowed + 0.005
