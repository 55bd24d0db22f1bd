"""Mass and inertia about the slot: from the known forces of a joint, and of an axis that spins."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom
from test_recordings_together import write_axis

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.cli.main import main
from cylconn_ros.core import layout
from cylconn_ros.errors import IdentifyError, IndeterminateError
from cylconn_ros.identification.effort import AxisRecording, estimate_axis
from cylconn_ros.identification.friction import estimate_friction
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

SEEDS = int(os.environ.get("IDENTIFY_SEEDS", "4"))
BOTH = ("mass", "inertia")


def wrong_scene() -> Scene:
    """The scene of the study with three quarters of mass and inertia."""
    ixx, *others = sensors.INERTIA
    inertia = [0.75 * ixx, *others]
    return joints.scene().replace({"body_b.mass": 0.75 * sensors.MASS, "body_b.inertia": inertia})


def test_mass_and_inertia_beside_friction() -> None:
    """From three quarters of both; all intervals hold, those of friction too."""
    truth = {"mass": sensors.MASS, "inertia": sensors.INERTIA[0], "coefficient": 0.2}
    truth |= {"radius": 0.02, "overlap": 0.1, "preload": 3.0}
    rows = joints.motion("Coulomb")
    inside = dict.fromkeys(truth, 0)
    for seed in range(SEEDS):
        samples = sensors.measured(rows, "white", seed)
        found = estimate_friction(wrong_scene(), samples, unknown=BOTH)
        assert found.accepted
        for name, value in truth.items():
            inside[name] += found[name].low <= value <= found[name].high
        assert found["mass"].value == pytest.approx(truth["mass"], rel=5e-3)
        assert found["inertia"].value == pytest.approx(truth["inertia"], rel=5e-3)
    least = binom.ppf(1e-4, SEEDS, 0.95)
    assert {name: count for name, count in inside.items() if count < least} == {}


ARM = 0.03  # m, of the mass centre from the slot


def unbalanced(t: Array) -> tuple[Array, Array]:
    """Return motion (n, 13) and loads (n, 2) of a sleeve whose mass centre is off the slot.

    The motion is prescribed; the loads along and about the slot are those that cause it against
    Coulomb friction (mu 0.2, R 0.02 m, L 0.1 m, FCint 3 N).
    """
    m, ixx = sensors.MASS, sensors.INERTIA[0]
    v = 0.9 * np.sin(5.0 * t) + 0.4 * np.sin(2.3 * t + 1.0)
    x = -0.18 * np.cos(5.0 * t) - 0.4 / 2.3 * np.cos(2.3 * t + 1.0)
    dv = 4.5 * np.cos(5.0 * t) + 0.92 * np.cos(2.3 * t + 1.0)
    w = 12.0 * np.sin(3.1 * t + 0.4) + 8.0
    angle = -12.0 / 3.1 * np.cos(3.1 * t + 0.4) + 8.0 * t
    dw = 37.2 * np.cos(3.1 * t + 0.4)
    c, s = np.cos(angle), np.sin(angle)
    arm = ARM * np.stack([0.0 * t, -s, c], axis=1)
    along = ARM * np.stack([0.0 * t, -c, -s], axis=1)
    across = m * (dw[:, None] * along - np.square(w)[:, None] * arm + [0.0, 0.0, 9.81])
    size = np.hypot(v, 0.02 * w)
    cos, sin = v / size, 0.02 * w / size
    traction = 0.2 * (np.linalg.norm(across, axis=1) + 3.0) / (1.0 - 4.0 * ARM * np.abs(cos))
    push = m * dv + traction * cos
    turn = ixx * dw + np.cross(arm, across)[:, 0] + 0.02 * traction * sin
    zero, half = 0.0 * t, 0.5 * angle
    place = np.stack([x, arm[:, 1], arm[:, 2], np.sin(half), zero, zero, np.cos(half)], axis=1)
    twist = np.stack([v, w * along[:, 1], w * along[:, 2], w, zero, zero], axis=1)
    return np.hstack([place, twist]), np.stack([push, turn], axis=1)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_mass_centre_off_the_slot(seed: int) -> None:
    """The inertia is that about the slot: it contains m d^2."""
    t: Array = np.asarray(sensors.PERIOD * np.arange(joints.SAMPLES), dtype=np.float64)
    rows = np.zeros((len(t), layout.NSAMPLE))
    rows[:, layout.A_POSE + 6] = 1.0
    rows[:, layout.B_POSE : layout.B_POSE + 13] = unbalanced(t)[0]
    loads = unbalanced(t + 0.5 * sensors.PERIOD)[1]
    rows[:, layout.LOADS.start + 6], rows[:, layout.LOADS.start + 9] = loads.T
    scene = wrong_scene().replace({"node_b.position": [0.0, 0.0, -ARM]})
    found = estimate_friction(scene, sensors.measured(rows, "white", seed), unknown=BOTH)
    assert found.accepted
    assert found["mass"].value == pytest.approx(sensors.MASS, rel=5e-3)
    about = sensors.INERTIA[0] + sensors.MASS * ARM**2
    assert found["inertia"].value == pytest.approx(about, rel=5e-3)
    assert found["inertia"].low < about < found["inertia"].high
    assert found["coefficient"].low < 0.2 < found["coefficient"].high


def test_without_a_known_force_the_mass_is_not_determined() -> None:
    """Twice mass, inertia, FCint, c1: the same motion. Loads are what tells them apart."""
    rows = joints.motion("Coulomb")
    rows[:, layout.LOADS] = 0.0
    samples = sensors.measured(rows, "white", 1)
    with pytest.raises(IndeterminateError, match="mass: no known force along the slot acts"):
        estimate_friction(joints.scene(), samples, unknown=("mass",))
    with pytest.raises(IndeterminateError, match="no known moment about the slot"):
        estimate_friction(joints.scene(), samples, unknown=("inertia",))


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_mass_and_preload_scale_together_without_known_forces(factor: float) -> None:
    """Coasting: with another mass mu, L and R are the same, FCint is in proportion."""
    law = joints.law_of("Coulomb")
    rows = _coasting(law.coefficient, law.preload)
    samples = sensors.measured(rows, "white", 1)
    scene = joints.scene()
    other = scene.replace({
        "body_b.mass": factor * sensors.MASS,
        "body_b.inertia": [factor * x for x in sensors.INERTIA],
    })  # fmt: skip
    known = [
        {"radius": 0.02, "overlap": 0.1, "preload": scale * law.preload} for scale in (1.0, factor)
    ]
    found = [
        estimate_friction(one, samples, values)
        for one, values in zip((scene, other), known, strict=True)
    ]
    values = [one["coefficient"].value for one in found]
    assert values[1] == pytest.approx(values[0], rel=1e-6)
    assert values[0] == pytest.approx(law.coefficient, rel=0.02)


def _coasting(coefficient: float, preload: float) -> Array:
    rows = np.zeros((1500, layout.NSAMPLE))
    rows[:, layout.A_POSE + 6] = rows[:, layout.B_POSE + 6] = 1.0
    t = sensors.PERIOD * np.arange(len(rows))
    slowing = coefficient * (9.81 + preload / sensors.MASS)
    rows[:, layout.B_POSE] = 5.0 * t - 0.5 * slowing * t**2
    rows[:, layout.B_TWIST] = 5.0 - slowing * t
    return rows


def test_two_free_bodies_are_refused() -> None:
    scene = joints.scene().replace({
        "body_a.kind": "free", "body_a.mass": 1.0, "body_a.inertia": [1.0, 0, 0, 1.0, 0, 1.0],
    })  # fmt: skip
    rows = joints.motion("Coulomb")
    with pytest.raises(IdentifyError, match="free are: body_a and body_b"):
        estimate_friction(scene, sensors.measured(rows, "white", 1), unknown=("mass",))


TRUTH = {"mass": 0.012, "c1": 0.03, "preload_friction": 0.08, "offset": 0.02}


def spinning(seed: int) -> AxisRecording:
    """Simulate a spin about the slot under a recorded torque; encoder of 1e-5 rad."""
    inertia, viscous, coulomb, offset = TRUTH.values()
    time: Array = np.asarray(np.arange(0.0, 20.0, 1e-3), dtype=np.float64)
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    torque = (
        0.5 * np.sin(2.0 * time + phase[0]) + 0.35 * np.sin(5.3 * time + phase[1])
        + 0.2 * np.sin(11.0 * time + phase[2])
    )  # fmt: skip
    angle, rate, steps = 0.0, 0.0, 20
    seen = np.zeros(len(time))
    for k in range(len(time)):
        seen[k] = np.round(angle / 1e-5) * 1e-5
        for _ in range(steps):
            push = torque[k] - offset
            way = np.sign(rate) or (np.sign(push) if abs(push) > coulomb else 0.0)
            if way == 0.0:
                break
            after = rate + 1e-3 / steps * (push - way * coulomb - viscous * rate) / inertia
            after = after if way * after > 0.0 else 0.0
            angle += 0.5e-3 / steps * (rate + after)
            rate = after
    return AxisRecording(time, seen, torque)


def test_inertia_about_the_slot_of_an_axis_that_spins() -> None:
    inside = dict.fromkeys(TRUTH, 0)
    for seed in range(SEEDS):
        found = estimate_axis([spinning(seed)])
        assert found.accepted
        for name, value in TRUTH.items():
            assert found[name][0] == pytest.approx(value, rel=0.01), name
            inside[name] += found[name][1] <= value <= found[name][2]
    assert min(inside.values()) >= binom.ppf(1e-4, SEEDS, 0.95)


def test_an_axis_with_another_friction_has_no_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Friction that depends on the angle: rejected, exit code 1, the page marks the pattern."""
    one = spinning(1)
    torque = one.effort + 0.03 * np.sin(one.position)
    write_axis(tmp_path / "bag", AxisRecording(one.time, one.position, torque))
    page = tmp_path / "page.html"
    options = ["--axis", "/joint_states", "--json", str(tmp_path / "a.json"), "--report", str(page)]
    assert main(["identify", str(tmp_path / "bag"), *options]) == 1
    found = json.loads((tmp_path / "a.json").read_text())
    assert not found["accepted"]
    assert found["estimates"]["mass"]["value"] is None
    assert "over position" in " ".join(found["verdict"])
    assert "do not use" in capsys.readouterr().out
    text = page.read_text()
    assert "Do not use: there are no values" in text
    assert "pattern remains" in text


def test_mass_and_inertia_through_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, params = tmp_path / "bag", tmp_path / "sleeve.yaml"
    write_joint(bag, sensors.measured(joints.motion("Coulomb"), "white", 1))
    _write(params, wrong_scene())
    options = ["--params", str(params), "--estimate", "mass", "--estimate", "inertia"]
    page = tmp_path / "page.html"
    assert main(["identify", str(bag), *options, "--report", str(page)]) == 0
    printed = capsys.readouterr().out
    rows = {line[:10].strip(): line.split() for line in printed.splitlines()}
    assert float(rows["mass"][1]) == pytest.approx(2.0, rel=5e-3)
    assert float(rows["inertia"][1]) == pytest.approx(0.0016, rel=5e-3)
    assert "taken as known: nodes of the parameters" in printed
    text = page.read_text()
    assert "m: mass of the free body" in text
    assert "if nodes in the parameters are right" in text


def _write(path: Path, scene: Scene) -> None:
    lines = [f"    {name}: {json.dumps(v)}" for name, v in scene.parameters().items() if _set(v)]
    path.write_text("/**:\n  ros__parameters:\n" + "\n".join(lines) + "\n")


def _set(value: object) -> bool:
    if isinstance(value, float):
        return bool(np.isfinite(value))
    return value not in ((), [])


def write_joint(
    path: Path, samples: SampleArrays, names: tuple[str, ...] = ("pose", "twist", "load")
) -> None:
    """Write poses, twists and loads of body B, or some of them, as other software records them."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    t = store.types
    point, turn = t["geometry_msgs/msg/Point"], t["geometry_msgs/msg/Quaternion"]
    vector, header = t["geometry_msgs/msg/Vector3"], t["std_msgs/msg/Header"]
    every = {"pose": "PoseStamped", "twist": "TwistStamped", "load": "WrenchStamped"}
    kinds = {name: every[name] for name in names}
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            name: writer.add_connection(
                f"/body_b/{name}", f"geometry_msgs/msg/{kind}", typestore=store
            )
            for name, kind in kinds.items()
        }
        for stamp, row in zip(samples.stamps, samples.samples, strict=True):
            at = t["builtin_interfaces/msg/Time"](*divmod(int(stamp), 1_000_000_000))
            head = header(stamp=at, frame_id="world")
            place, twist, load = row[13:20], row[20:26], row[layout.LOADS][6:]
            parts = {
                "pose": t["geometry_msgs/msg/Pose"](point(*place[:3]), turn(*place[3:])),
                "twist": t["geometry_msgs/msg/Twist"](vector(*twist[:3]), vector(*twist[3:])),
                "load": t["geometry_msgs/msg/Wrench"](vector(*load[:3]), vector(*load[3:])),
            }
            for name in names:
                kind = f"geometry_msgs/msg/{kinds[name]}"
                message = t[kind](head, parts[name])
                writer.write(topics[name], int(stamp), store.serialize_cdr(message, kind))
