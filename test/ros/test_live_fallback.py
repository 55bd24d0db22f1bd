"""The node without an interface that its fast path needs: a warning, and the same numbers."""

import sys
from pathlib import Path

import numpy as np
import pytest
from paths import CONFIG
from recorded_loops import scene_arguments, states
from ros_processes import module, program

from cylconn_ros.core import layout
from cylconn_ros.recording.run import read_run
from cylconn_ros.ros.executor import executor
from cylconn_ros.scene.scene import load
from cylconn_ros.simulation.simulate import simulate

WITHOUT = Path(__file__).with_name("without_internal.py")
SLOWER = "samples are processed by its own executor"
IN_PYTHON = "samples are processed in Python"
STEPS = 100
REMOVED = {
    **{f"{owner}.{name}": SLOWER for owner, names in executor._INTERNAL.items() for name in names},
    "Node._subscriptions": SLOWER,
    "os.eventfd": SLOWER,
    "select.epoll": SLOWER,
    "rcl_subscription_set_on_new_message_callback": SLOWER,
    "rcl_take_serialized_message": IN_PYTHON,
    "rcl_publish_serialized_message": IN_PYTHON,
    "rcl_publisher_get_subscription_count": IN_PYTHON,
    "rcutils_get_default_allocator": IN_PYTHON,
    "rcutils_uint8_array_fini": IN_PYTHON,
}


@pytest.mark.parametrize("removed", REMOVED)
def test_a_node_without_an_interface_gives_the_same_numbers(removed: str, tmp_path: Path) -> None:
    rules = [f"plant.duration:={STEPS / 1000}", "record.enabled:=true"]
    connector: list[str | Path] = [sys.executable, WITHOUT, removed]
    connector += scene_arguments("demo", *rules)
    plant = [*module("plant.node"), *scene_arguments("demo", *rules)]
    with program(connector, tmp_path) as connecting, program(plant, tmp_path) as moving:
        assert moving.wait() == 0, moving.output
        assert connecting.stop() == 0, connecting.output
    warnings = [line for line in connecting.lines if REMOVED[removed] in line]
    assert len(warnings) == 1, connecting.output
    if removed not in ("os.eventfd", "select.epoll"):
        assert removed in warnings[0]
    stamp, found = states(read_run(next((tmp_path / "runs").iterdir())))
    _, first = np.unique(stamp, return_index=True)
    expected = simulate(load(CONFIG / "demo.yaml"), samples=STEPS).outs[:, layout.STATE]
    for name in ("length", "angle", "normal_force", "force_friction"):
        at = layout.STATE_INDEX[name] - layout.STATE0
        np.testing.assert_array_equal(found[first][:STEPS, at], expected[:, at])
