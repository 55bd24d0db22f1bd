"""``cylconn identify``: output, files, errors, and recordings of other software."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from paths import BAGS, CONFIG
from scenes import bundled
from test_identify import measured, motion_of

from cylconn_ros.cli.main import main
from cylconn_ros.errors import IdentifyError, UnknownNameError
from cylconn_ros.identification.recording import identify

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo, recorded."""
    run = tmp_path_factory.mktemp("identify") / "demo"
    assert main(["simulate", "demo", "--duration", "2", "-o", str(run)]) == 0
    return run


def test_the_table(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(bag)]) == 0
    text = capsys.readouterr().out
    rows = {line[:10].strip(): line.split() for line in text.splitlines()}
    assert float(rows["mu"][1]) == pytest.approx(0.2, rel=1e-3)
    assert float(rows["L"][1]) == pytest.approx(0.08, rel=1e-2)
    assert rows["R"][-1] == "m"
    assert "windows" in text
    assert "skipped     1 (first sample)" in text
    assert "taken as known: mass, inertia and nodes" in text
    assert "next:" in text


def test_json_and_picture(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture, numbers = tmp_path / "a.png", tmp_path / "a.json"
    options = ["--known", "preload=4", "--known", "overlap", "--plot", str(picture)]
    assert main(["identify", str(bag), *options, "--json", str(numbers)]) == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"
    found = json.loads(numbers.read_text())
    mu = found["estimates"]["friction.coefficient"]
    assert mu["estimated"]
    assert mu["interval_95"][0] < 0.2 < mu["interval_95"][1]
    assert found["estimates"]["friction.overlap"]["value"] == 0.08
    assert found["estimates"]["friction.static_coefficient"]["value"] is None
    capsys.readouterr()
    assert main(["identify", str(bag), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["samples"] == 2001


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--known", "mass=1"], "must be one of preload, overlap, radius"),
        (["--known", "radius=-1"], "must be finite and > 0"),
        (["--topic", "pose:=/x"], "must be like body_b/pose:=/arm/pose"),
    ],
)
def test_wrong_options(
    bag: Path, options: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["identify", str(bag), *options])
    assert error in capsys.readouterr().err


def test_the_inertia_must_be_known(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "unknown.yaml"
    params.write_text(
        "/**:\n  ros__parameters:\n    method: penalty\n"
        "    body_b: {kind: unknown}\n    node_a: {orientation: [0.0, 0.0, 0.0, 1.0]}\n"
        "    friction: {coefficient: 0.1, radius: 0.02}\n"
        "    penalty: {stiffness: 1.0e4, damping: 10.0}\n"
    )
    assert main(["identify", str(bag), "--params", str(params)]) == 2
    assert "needs mass and inertia of a body" in capsys.readouterr().err


def test_a_recording_of_the_real_node(capsys: pytest.CaptureFixture[str]) -> None:
    """With jitter, lost, repeated and reordered messages (bags/README.md)."""
    lossy = BAGS / "lossy"
    assert main(["identify", str(lossy), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)["estimates"]
    truth = {"coefficient": 0.2, "preload": 4.0, "overlap": 0.08, "radius": 0.02}
    for name, value in truth.items():
        low, high = found[f"friction.{name}"]["interval_95"]
        assert low <= value <= high
        assert high - low < 0.02 * value


def test_the_function_gives_the_result_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    bag = BAGS / "lossy"
    found = identify(bag, known={"preload": None, "radius": 0.02})
    assert found["preload"].value == 4.0
    assert found["coefficient"].low <= 0.2 <= found["coefficient"].high
    known = ["--known", "preload", "--known", "radius=0.02"]
    assert main(["identify", str(bag), *known, "--json", "-"]) == 0
    mu = json.loads(capsys.readouterr().out)["estimates"]["friction.coefficient"]
    assert mu["interval_95"] == [found["coefficient"].low, found["coefficient"].high]
    with pytest.raises(UnknownNameError, match="mu: no such name; there are coefficient, preload"):
        found["mu"]
    with pytest.raises(IdentifyError, match="'mass' is not one of preload, overlap, radius"):
        identify(bag, known={"mass": 1.0})


def test_a_bag_of_other_software_at_uneven_rates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Odometry on another topic, written by rosbags, with parameters from a file."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    scene = bundled("demo")
    rng = np.random.default_rng(7)
    rows = np.cumsum(rng.integers(1, 5, 1400))
    rows = rows[rows < 3400]
    seen = measured(motion_of(scene, 3400), 7, size=0.3)[rows]
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    odometry, time = types["nav_msgs/msg/Odometry"], types["builtin_interfaces/msg/Time"]
    point, turn = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
    vector, twist = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Twist"]
    bag = tmp_path / "foreign"
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/drawer/odom", odometry.__msgtype__, typestore=store)
        for k, row in zip(rows, seen, strict=True):
            stamp = time(sec=int(k) // 1000, nanosec=int(k) % 1000 * 1_000_000)
            pose = types["geometry_msgs/msg/Pose"](
                position=point(*row[13:16]), orientation=turn(*row[16:20])
            )
            message = odometry(
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="world"),
                child_frame_id="world",
                pose=types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
                twist=types["geometry_msgs/msg/TwistWithCovariance"](
                    twist(vector(*row[20:23]), vector(*row[23:26])), np.zeros(36)
                ),
            )
            data = store.serialize_cdr(message, odometry.__msgtype__)
            writer.write(topic, int(k) * 1_000_000, data)
    assert main(["identify", str(bag)]) == 2
    assert "no parameters were stored with the recording" in capsys.readouterr().err
    params = CONFIG / "demo.yaml"
    theirs = ["--params", str(params), "--topic", "body_b/odom:=/drawer/odom", "--json", "-"]
    assert main(["identify", str(bag), *theirs]) == 0
    found = json.loads(capsys.readouterr().out)
    low, high = found["estimates"]["friction.coefficient"]["interval_95"]
    assert low <= 0.2 <= high
    assert high - low < 0.1
