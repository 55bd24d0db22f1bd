"""What else acts on the bodies of a connector in a MuJoCo model, and a drawer that an arm opens."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from paths import ROOT

import cylconn_ros as cr
from cylconn_ros.errors import ModelError
from cylconn_ros.importing import from_mujoco
from cylconn_ros.mujoco.motion import Motion
from cylconn_ros.mujoco.plant import MujocoPlant

ARM = ROOT / "models" / "drawer_arm.xml"
FRICTION = {"friction.coefficient": 0.3, "friction.radius": 0.01, "friction.overlap": 0.1}


def scene_of(path: Path, joint: str, **changes: Any) -> cr.Scene:
    draft = from_mujoco.draft_of(path, [joint])
    scene = draft.scene()
    assert scene is not None
    return scene.replace({"latency": 0.0, **FRICTION, **changes})


def momentum(plant: MujocoPlant, body: str) -> np.ndarray:
    """Linear momentum of a body and angular momentum about its frame's present origin."""
    model, data, out = plant.model, plant.data, np.zeros(6)
    plant.mujoco.mj_forward(model, data)
    index = model.body(body).id
    kind = plant.mujoco.mjtObj.mjOBJ_BODY  # mass centre, world axes
    plant.mujoco.mj_objectVelocity(model, data, kind, index, out, 0)
    axes = data.ximat[index].reshape(3, 3)
    linear = model.body_mass[index] * out[3:]
    angular = axes @ np.diag(model.body_inertia[index]) @ axes.T @ out[:3]
    return np.concatenate([linear, angular + np.cross(data.xipos[index], linear)])


HELD = """<mujoco><option timestep="0.001" integrator="implicitfast" gravity="0 0 -9.81"/>
<worldbody><body name="rail"><geom size="0.01" mass="1" contype="0" conaffinity="0"/>
<body name="sled" pos="0.1 0.2 0.3" euler="10 20 30"><joint name="slide" type="slide"
 axis="1 0 0" pos="0 0.05 0"/>
<geom type="box" size="0.1 0.05 0.02" pos="0.02 0 0.01" mass="2" euler="5 0 0"/>
<body name="flap" pos="0.1 0 0.02"><joint name="flap" type="hinge" axis="0 1 0" stiffness="3"/>
<geom size="0.03" pos="0.1 0.02 0" mass="0.7"/></body></body></body>
<body name="wall" pos="0.27 0.25 0.26"><geom type="box" size="0.05 0.2 0.2"/></body>
</worldbody><actuator><motor name="drive" joint="slide"/><motor name="flap" joint="flap"/>
</actuator></mujoco>"""


@pytest.mark.parametrize("constraint", ["connector", "simulator"])
def test_the_load_is_what_changes_the_momentum_besides_gravity_and_wrench(
    tmp_path: Path, constraint: str
) -> None:
    """A sled with a flap on a hinge, pressed against a wall; drives on both joints."""
    path = tmp_path / "sled.xml"
    path.write_text(HELD)
    plant = MujocoPlant(scene_of(path, "slide", constraint=constraint), path, ["slide"])
    wrench = np.array([4.0, 1.0, 40.0, 0.1, -0.2, 0.3])
    drive = {} if constraint == "connector" else {"drive": 5.0}
    assert plant.varying == [1]
    touched = False
    for _ in range(200):
        assert plant.command({**drive, "flap": 0.4}) == []
        plant.step(np.zeros(6), wrench)
        touched |= plant.data.ncon > 0
    assert touched
    load = plant.load(1)
    model, data, body = plant.model, plant.data, plant.model.body("sled").id
    at, rotation = data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy()
    com = data.xipos[body].copy()
    before, model.opt.timestep = momentum(plant, "sled"), 1e-7
    plant.mujoco.mj_step(model, data)
    change = (momentum(plant, "sled") - before) / 1e-7
    weight = model.body_mass[body] * model.opt.gravity
    applied, turning = np.split(data.xfrc_applied[body], 2)  # at the mass centre
    force = load[:3] + applied + weight
    torque = np.cross(at, load[:3]) + load[3:] + turning + np.cross(com, applied + weight)
    if constraint == "connector":
        np.testing.assert_allclose(change, [*force, *torque], rtol=1e-4, atol=1e-3)
    else:  # the joint's reaction has no component along its axis
        axis = rotation[:, 0]
        assert change[:3] @ axis == pytest.approx(force @ axis, rel=1e-4, abs=1e-3)
        assert abs(load[:3] @ axis) > 1.0


@pytest.mark.parametrize("constraint", ["connector", "simulator"])
def test_an_arm_opens_a_drawer_that_slides_jams_and_slides_again(constraint: str) -> None:
    """The finger pulls in the middle, then 215 mm beside it, then in the middle again.

    Along the rail F, friction up to mu (W + 2 F y/L): no force F moves the drawer if
    y > L/(2 mu) = 167 mm.
    """
    scene = scene_of(ARM, "drawer", constraint=constraint)
    plant, connector = MujocoPlant(scene, ARM, ["drawer"]), cr.Connector(scene)
    motion = Motion(ARM.with_suffix(".csv"))
    length, force, violation = [], [], 0.0
    for _ in range(6000):
        plant.command(motion.at(plant.time_ns * 1e-9))
        load = plant.load(1)
        state = plant.state
        answer = connector.step(pose_b=state[13:20], twist_b=state[20:26], load_b=load)
        length.append(answer["length"])
        force.append(load[0])
        violation = max(violation, answer["offset_violation"])
        plant.step(np.zeros(6), np.concatenate([answer.force_b, answer.torque_b]))
    assert length[200] == pytest.approx(0.0, abs=1e-9)
    assert length[1400] == pytest.approx(0.1685, abs=1e-3)
    jammed = slice(2600, 3600)
    assert np.median(force[jammed]) > 100.0  # that in the middle: 14 N
    assert np.ptp(length[jammed]) < 1e-4
    assert length[-1] == pytest.approx(0.3508, abs=1e-3)
    assert violation < 1e-5


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1: must be time and"),
        ("time,a,a\n0,1,1\n", "different names"),
        ("time,a\n", "has no row"),
        ("time,a\n0,1\n1,nan\n", "line 3: must be 2 finite numbers"),
        ("time,a\n0,1\n0.5\n", "line 3: must be 2 finite numbers"),
        ("time,a\n0,1\n0,2\n", "time = 0: must be later"),
    ],
)
def test_a_motion_that_cannot_be_used(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(ModelError, match=said):
        Motion(path)


def test_a_motion_is_linear_between_its_rows_and_held_beyond(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_text("time, a,b\n1,0,5\n\n2,10,5\n")
    motion = Motion(path)
    assert [motion.at(t)["a"] for t in (0.0, 1.25, 9.0)] == [0.0, 2.5, 10.0]
    assert motion.at(1.5)["b"] == 5.0


PRESSED = """<mujoco><worldbody><geom type="box" size="1 0.1 1" pos="0 0.14 0"/>
<body name="b"><joint name="joint" type="{kind}" axis="1 0 0"/>
<geom type="box" size="0.1 0.05 0.05" mass="1"/></body></worldbody></mujoco>"""


def test_a_contact_to_which_no_joint_yields_has_the_force_of_a_free_body(tmp_path: Path) -> None:
    """A box 10 mm inside a wall beside it, on a hinge through its mass centre: not 2e17 N.

    Four contacts with four rows: each a_ref/R, with a_ref = depth/(d time^2), R = (1-d)/d 4/m.
    """
    loads = []
    for kind in ("slide", "hinge"):
        path = tmp_path / f"{kind}.xml"
        path.write_text(PRESSED.format(kind=kind))
        scene = scene_of(path, "joint", constraint="simulator", **{"body_a.frame": "base"})
        loads.append(MujocoPlant(scene, path, ["joint"]).load(1))
    depth, d, time = 0.01, 0.95, 0.02  # MuJoCo's solimp and solref
    force = 16.0 * depth / (d * time * time) * d / (1.0 - d) / 4.0
    for load in loads:
        assert load == pytest.approx([0.0, -force, 0.0, 0.0, 0.0, 0.0], rel=1e-6, abs=1e-6)


def test_bodies_that_yield_and_fixed_ones_keep_their_inverse_mass(tmp_path: Path) -> None:
    plain = mujoco.MjModel.from_xml_path(str(ARM))
    model = mujoco.MjModel.from_xml_path(str(ARM))
    assert cr.mujoco.bound_unyielding(model) == ["drawer"]  # does not turn
    changed = np.argwhere(model.body_invweight0 != plain.body_invweight0)
    assert changed.tolist() == [[plain.body("drawer").id, 1]]
