"""Several recordings of a joint together, and an axis whose efforts were recorded."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from paths import BAGS

from cylconn_ros.bench.identification import axis
from cylconn_ros.cli.main import main
from cylconn_ros.identification.effort import AxisRecording
from cylconn_ros.identification.recording import identify


def write_axis(path: Path, recording: AxisRecording) -> None:
    """Write joint states of an axis named carriage, as a controller publishes them."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types, none = store.types, np.zeros(0)
    state = types["sensor_msgs/msg/JointState"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for t, q, effort in zip(recording.time, recording.position, recording.effort, strict=True):
            ns = round(t * 1e9)
            stamp = types["builtin_interfaces/msg/Time"](ns // 1_000_000_000, ns % 1_000_000_000)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            message = state(header, ["carriage"], np.array([q]), none, np.array([effort]))
            writer.write(topic, ns, store.serialize_cdr(message, state.__msgtype__))


def test_an_axis_through_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = axis.simulate(seed=5)
    bags = [tmp_path / "one", tmp_path / "two"]
    for bag, part in zip(bags, (slice(0, 12400), slice(12400, None)), strict=True):
        write_axis(bag, AxisRecording(whole.time[part], whole.position[part], whole.effort[part]))
    options = ["--with", str(bags[1]), "--axis", "/joint_states"]
    assert main(["identify", str(bags[0]), *options, "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)["estimates"]
    for name, value in axis.TRUTH.items():
        assert found[name]["value"] == pytest.approx(value, rel=0.01)
    assert main(["identify", str(bags[0]), *options]) == 0
    assert "friction is one number: without reactions" in capsys.readouterr().out
    wrong = ["identify", str(bags[0]), "--axis", "/joint_states:arm"]
    assert main(wrong) == 2
    assert "joint 'arm' is not one of carriage" in capsys.readouterr().err


def test_a_value_that_is_not_determined_is_withheld(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A force of 400 N that acts on the body and is not in the recording."""
    write_axis(tmp_path / "bag", axis.simulate(seed=1, noise=400.0))
    assert main(["identify", str(tmp_path / "bag"), "--axis", "/joint_states"]) == 1
    assert "not determined" in capsys.readouterr().out


def test_two_recordings_narrow_the_intervals() -> None:
    bag = BAGS / "lossy"
    one, both = identify(bag), identify(bag, others=[bag])
    assert both.samples == 2 * one.samples
    for name, value in {"coefficient": 0.2, "radius": 0.02}.items():
        widths = [found[name].high - found[name].low for found in (one, both)]
        assert widths[1] < widths[0]
        assert both[name].value == pytest.approx(value, rel=0.01)
