"""Friction in the user's own MuJoCo loop, from the reactions of the same step."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import planar_slider
import pytest
from paths import ROOT

import cylconn_ros as cr
from cylconn_ros.core import layout
from cylconn_ros.errors import ModelError, SceneError

SLIDE = '<joint name="slide" type="slide" axis="1 0 0"/>'
HINGE = '<joint name="hinge" type="hinge" axis="1 0 0"/>'
FRICTION = cr.Friction(coefficient=0.3, radius=0.02, overlap=0.1)
INTEGRATORS = ["Euler", "implicit", "implicitfast"]
if hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"):
    INTEGRATORS.append("discrete")


def loaded(xml: str):
    """Model and data."""
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


def one_body(scene: cr.Scene, joints: str) -> str:
    b = scene.body_b
    i = b.inertia
    return f"""<mujoco><option timestep="{scene.period}"/><worldbody><body name="b">{joints}
      <inertial pos="{b.com[0]} {b.com[1]} {b.com[2]}" mass="{b.mass}"
        fullinertia="{i[0]} {i[3]} {i[5]} {i[1]} {i[2]} {i[4]}"/></body></worldbody></mujoco>"""


BASE: dict[str, Any] = {
    "node_a": cr.Node(orientation=(0, 0, 0, 1)), "body_a": cr.Body(kind="fixed"),
    "period": 0.001, "latency": 0, "plant_integration": "semi_implicit",
    "reference": cr.Reference(offsets="zero", misalignment="zero"),
}  # fmt: skip


def start(twist, load) -> cr.PlantSettings:
    return cr.PlantSettings(body_b=cr.PlantBody(twist=twist, load=load))


DRAWER = cr.Scene(
    **BASE,
    body_b=cr.Body(mass=2.0, com=(0.05, 0.02, -0.03), inertia=(0.02, 0.001, 0, 0.03, 0, 0.04)),
    friction=cr.Friction(coefficient=0.3, radius=0.02, overlap=0.1, preload=2.0),
    command=cr.Command(spin=cr.Imposed(position=0.0)),
    plant=start((0.8, 0, 0, 0, 0, 0), (4.0, 1.0, 0, 0.1, 0.2, 0.3)),
)
SPRING_AND_STOP = DRAWER.replace(
    {
        "friction.coefficient": 0.1, "friction.overlap": 0.3, "friction.static_coefficient": 0.15,
        "friction.decay": 5.0, "stops.l_max": 0.1, "stops.restitution": 0.5,
        "elasticity.k1": 300.0, "damping.c1": 2.0, "plant.body_b.load": (0.0,) * 6,
        "plant.body_b.twist": (3.0, 0, 0, 0, 0, 0),
    }
)  # fmt: skip
ROD = cr.Scene(
    **BASE,
    body_b=cr.Body(mass=2.0, com=(0.05, 0, 0), inertia=(0.02, 0, 0, 0.03, 0, 0.03)),
    friction=cr.Friction(coefficient=0.2, radius=0.05, overlap=0.2),
    plant=start((0.8, 0, 0, 8.0, 0, 0), (1.0, 0, 0, 0.05, 0, 0)),
)
JAM = cr.Scene(
    **BASE,
    body_b=cr.Body(mass=1.0, com=(0, 0.2, 0), inertia=(0.002, 0, 0, 0.002, 0, 0.002)),
    friction=cr.Friction(coefficient=0.5, radius=0.02, overlap=0.1),
    command=cr.Command(spin=cr.Imposed(position=0.0)),
    plant=start((1.0, 0, 0, 0, 0, 0), (0.0, 1.0, 0, 0, 0, 0)),
)


@pytest.mark.parametrize("scene", [DRAWER, SPRING_AND_STOP, ROD, JAM], ids=str.lower(
    "DRAWER SPRING_AND_STOP ROD JAM").split())  # fmt: skip
def test_it_is_the_free_body_connector_where_both_apply(scene: cr.Scene) -> None:
    """Slide, spin, forces, regimes and flags of every step: 1e-9 of the greatest value."""
    spins = scene is ROD
    model, data = loaded(one_body(scene, SLIDE + (HINGE if spins else "")))
    twist, load = scene.plant.body_b.twist, np.array(scene.plant.body_b.load)
    data.qvel[:] = (twist[0], twist[3])[: model.nv]
    friction = cr.mujoco.Friction(
        model, data, slide="slide", hinge="hinge" if spins else None, scene=scene
    )
    run = cr.simulate(scene, duration=0.5)
    outs = []
    for _ in run.time:
        mujoco.mj_kinematics(model, data)
        arm = data.xpos[1] - data.xipos[1]
        data.xfrc_applied[1] = *load[:3], *(load[3:] + np.cross(arm, load[:3]))
        friction.step()
        outs.append(friction.result.array.copy())
    found = np.array(outs)
    columns = [
        layout.LENGTH,
        layout.VELOCITY,
        layout.FORCE,
        layout.NORMAL_FORCE,
        layout.RADIAL_FORCE,
    ]
    columns += [layout.BENDING_MOMENT, layout.FORCE_FRICTION, layout.FORCE_REACTION]
    columns += [layout.ANGLE, layout.ANGULAR_VELOCITY, layout.MOMENT] if spins else []
    for k in columns:
        scale = np.abs(run.outs[:, k]).max() + 1e-9
        assert np.abs(found[:, k] - run.outs[:, k]).max() < 1e-9 * scale, k
    for k in (layout.REGIME, layout.FLAGS, layout.STOP):
        assert (found[:, k] == run.outs[:, k]).all()
    if scene is JAM:
        assert int(found[0, layout.FLAGS]) & layout.JAMMED
        assert np.ptp(found[:, layout.LENGTH]) == 0.0


def on_an_arm(h: float, end: float, integrator: str = "Euler"):
    """q, l, q', l' of the planar slider at ``end``, and the steps at which the regime changes."""
    model, data = loaded(planar_slider.model(h, integrator))
    data.qpos[0], data.qvel[1] = planar_slider.START[0], planar_slider.START[3]
    scene = cr.Friction(coefficient=planar_slider.MU, radius=0.01, overlap=planar_slider.L)
    friction = cr.mujoco.Friction(model, data, slide="slide", scene=scene)
    regimes = []
    for k in range(round(end / h)):
        data.qfrc_applied[:] = planar_slider.torque(k * h), 0.0
        friction.step()
        regimes.append(friction.result["regime"])
    state = np.array([data.qpos[0], planar_slider.START[1] + data.qpos[1], *data.qvel])
    return state, np.flatnonzero(np.diff(regimes)) * h


def test_inside_a_mechanism_it_converges_at_the_simulators_order() -> None:
    expected, events = planar_slider.reference(1.0)
    errors, halves = [], []
    for h in (2e-3, 1e-3, 5e-4):
        state, changes = on_an_arm(h, 1.0)
        errors.append(state - expected)
        halves.append(state)
        assert np.abs(changes[-1] - events[-1][0]) < 2.0 * h  # slip begins again
    ratios = np.array([errors[0] / errors[1], errors[1] / errors[2]])
    assert ((ratios > 1.8) & (ratios < 2.2)).all()
    assert np.abs(2.0 * halves[2] - halves[1] - expected).max() < 5e-4


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_inside_a_mechanism_friction_is_that_of_the_instant(side: float) -> None:
    """Forces of one short step against the hand-reduced equations: 1e-9."""
    random = np.random.default_rng(5)
    scene = cr.Friction(coefficient=planar_slider.MU, radius=0.01, overlap=planar_slider.L)
    for _ in range(20):
        model, data = loaded(planar_slider.model(1e-10))
        q, l, w = random.uniform(-3, 3), random.uniform(0.1, 0.5), random.uniform(-4, 4)  # noqa: E741
        y = np.array([q, l, w, side * random.uniform(0.1, 1.0)])
        data.qpos[:], data.qvel[:] = (q, l - planar_slider.START[1]), y[2:]
        data.qfrc_applied[0] = planar_slider.torque(0.0)
        friction = cr.mujoco.Friction(model, data, slide="slide", scene=scene)
        friction.apply()
        expected = planar_slider.slip(0.0, y, side)
        force, moment = friction.result["force"], friction.result["moment"]
        assert force[0] == pytest.approx(expected[2], rel=1e-9)
        assert np.hypot(*force[1:]) == pytest.approx(abs(expected[3]), rel=1e-9)
        assert np.hypot(*moment[1:]) == pytest.approx(abs(expected[4]), rel=1e-9)


def tumbling(h: float):
    """Two floating bodies on one axis after 0.2 s: slide, angle, rates."""
    xml = f"""<mujoco><option timestep="{h}" gravity="0 0 0"/><worldbody><body><freejoint/>
      <inertial pos="0 0 0" mass="3" diaginertia="0.05 0.04 0.06"/><body>{SLIDE}{HINGE}
      <inertial pos="0.1 0.02 0" mass="1" diaginertia="0.01 0.02 0.02"/></body></body>
      </worldbody></mujoco>"""
    model, data = loaded(xml)
    data.qvel[:] = 0.0, 0.0, 0.0, 1.0, 2.0, -1.0, 0.5, 4.0
    friction = cr.mujoco.Friction(
        model,
        data,
        slide="slide",
        hinge="hinge",
        scene=cr.Friction(coefficient=0.2, radius=0.02, overlap=0.1),
    )
    for _ in range(round(0.2 / h)):
        friction.step()
    return np.array([*data.qpos[-2:], *data.qvel[-2:]])


def test_two_free_bodies_converge_to_the_joint_coordinate_solution() -> None:
    twist_a = (0.0, 0.0, 0.0, 1.0, 2.0, -1.0)
    scene = cr.Scene(
        node_a=cr.Node(orientation=(0, 0, 0, 1)), gravity=(0, 0, 0), method="minimal",
        body_a=cr.Body(mass=3.0, inertia=(0.05, 0, 0, 0.04, 0, 0.06)),
        body_b=cr.Body(mass=1.0, com=(0.1, 0.02, 0.0), inertia=(0.01, 0, 0, 0.02, 0, 0.02)),
        friction=cr.Friction(coefficient=0.2, radius=0.02, overlap=0.1),
        plant=cr.PlantSettings(
            body_a=cr.PlantBody(twist=twist_a),
            body_b=cr.PlantBody(twist=(0.5, 0, 0, 5.0, 2.0, -1.0)),
        ),
    )  # fmt: skip
    run = cr.simulate(scene, duration=0.2)
    names = ("displacement", "rotation")
    expected = [run[name][-1] for name in names]
    expected += [run["velocity"][-1][0], run["angular_velocity"][-1][0]]
    errors = [tumbling(h) - expected for h in (1e-3, 5e-4, 2.5e-4)]
    for one, half in ((errors[0], errors[1]), (errors[1], errors[2])):
        assert np.abs(half).max() < 0.55 * np.abs(one).max()
    assert np.abs(errors[2]).max() < 5e-3


ARM = """<mujoco><option timestep="0.002" integrator="{}"/><worldbody>
  <body><joint name="a" type="hinge" axis="0 1 0" damping="0.3"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" contype="0" conaffinity="0"/>
    <body pos="0.4 0 0"><joint name="b" type="hinge" axis="0 0 1" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" contype="0" conaffinity="0"/>
      <body pos="0.3 0 0">{}{}
        <geom type="box" size="0.05 0.03 0.02" pos="0.02 0.01 0" contype="0" conaffinity="0"/>
      </body></body></body></worldbody>
  <actuator><position joint="a" kp="80" kv="5"/><position joint="b" kp="40" kv="2"/></actuator>
</mujoco>"""  # fmt: skip


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_stick_does_not_creep_on_a_moving_arm(integrator: str) -> None:
    model, data = loaded(ARM.format(integrator, SLIDE, HINGE))
    friction = cr.mujoco.Friction(
        model, data, slide="slide", hinge="hinge",
        scene=cr.Friction(coefficient=0.4, radius=0.02, overlap=0.05, preload=60.0),
    )  # fmt: skip
    for k in range(2500):
        data.ctrl[:] = 0.8 * np.sin(0.01 * k), 0.7 * np.cos(0.007 * k)
        friction.step()
        assert np.abs(data.qpos[2:]).max() < 1e-15
    assert friction.result.regime == "stick"
    assert np.abs(data.qpos[:2]).max() > 0.1


def test_apply_and_step_are_the_same_and_own_forces_are_kept() -> None:
    states = []
    for steps in (True, False):
        model, data = loaded(ARM.format("implicitfast", SLIDE, HINGE))
        friction = cr.mujoco.Friction(model, data, slide="slide", hinge="hinge", scene=FRICTION)
        for k in range(200):
            data.qfrc_applied[2] = 3.0 * np.sin(0.05 * k)
            data.qfrc_applied[0] = 1.0
            if steps:
                friction.step()
            else:
                friction.apply()
                mujoco.mj_step(model, data)
        states.append(np.array([*data.qpos, *data.qvel]))
    assert (states[0] == states[1]).all()
    assert np.abs(states[0][2]) > 1e-3


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_constraint_solver_gives_the_compiled_steps_equations(integrator: str) -> None:
    """The response by runs of the solver equals mass matrix and composite inertias: 1e-9."""
    model, data = loaded(ARM.format(integrator, SLIDE, HINGE))
    data.qpos[:], data.qvel[:] = (0.3, -0.8, 0.05, 0.4), (1.0, -2.0, 0.5, 3.0)
    found = []
    for by_runs in (False, True):
        friction = cr.mujoco.Friction(model, data, slide="slide", hinge="hinge", scene=FRICTION)
        if by_runs:
            friction._addresses = friction._arguments = friction._response.damping = None
        data.qfrc_applied[:] = 0.0
        friction.apply()
        assert (friction.runs > 0) == (by_runs or integrator in ("implicit", "discrete"))
        found.append(friction._numbers.copy())
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9, atol=1e-9)


HAND = """<mujoco><option timestep="0.001" cone="{cone}"/><worldbody>
  <body name="drawer" pos="0 0 0.5">{slide}
    <geom type="box" size="0.2 0.2 0.05" mass="2" contype="0" conaffinity="0"/>
    <geom type="capsule" fromto="0.25 -0.2 0 0.25 0.2 0" size="0.01" mass="0.2" friction="0.4 0 0"/>
  </body>
  <body name="hand" pos="0.225 0 0.5">
    <joint name="x" type="slide" axis="1 0 0" damping="5"/>
    <joint name="y" type="slide" axis="0 1 0"/>
    <joint name="z" type="slide" axis="0 0 1"/>
    <geom type="capsule" fromto="0 0 -0.05 0 0 0.05" size="0.01" mass="0.5" friction="0.4 0 0"
      {contact}/></body></worldbody>
  {weld}
  <actuator><position joint="x" kp="600" kv="20"/><position joint="y" kp="600" kv="20"/>
    <position joint="z" kp="600" kv="20"/></actuator></mujoco>"""  # fmt: skip
WELD = '<equality><weld body1="hand" body2="drawer" anchor="0.225 0 0"/></equality>'


@pytest.mark.parametrize("how", ["weld", "contact", "elliptic contact"])
def test_friction_contains_the_hand_that_pulls(how: str) -> None:
    """Mu FN of the reactions that MuJoCo has in its own step is the friction: 1e-9."""
    welded = how == "weld"
    xml = HAND.format(
        slide=SLIDE, weld=WELD if welded else "",
        contact='contype="0" conaffinity="0"' if welded else "",
        cone="elliptic" if "elliptic" in how else "pyramidal",
    )  # fmt: skip
    model, data = loaded(xml)
    friction = cr.mujoco.Friction(model, data, slide="slide", scene=FRICTION)
    body, slips, worst, pressed = model.body("drawer").id, 0, 0.0, 0.0
    for k in range(1500):
        data.ctrl[:] = 0.02 + 0.0003 * k, 0.1 * np.sin(0.003 * k), 0.01
        friction.step()
        result = friction.result
        mujoco.mj_rnePostConstraint(model, data)  # with the accelerations of the step
        assert not int(result["flags"]) & layout.NOT_CONVERGED
        if result.regime != "slip" or data.nefc == 0:
            continue
        wrench, node = data.cfrc_int[body], np.array([result["length"], 0.0, 0.5])
        force = wrench[3:]
        moment = wrench[:3] + np.cross(data.subtree_com[body] - node, force)
        normal = np.hypot(force[1], force[2]) + 2.0 / 0.1 * np.hypot(moment[1], moment[2])
        worst = max(worst, abs(result["traction"] / (0.3 * normal) - 1.0))
        slips, pressed = slips + 1, max(pressed, abs(moment[2]))
    assert slips > 100
    assert pressed > 0.1  # the hand's lever arm
    assert worst < 1e-6 if "elliptic" in how else worst < 1e-9


def refused(
    error: type, text: str, *, xml: str = ARM.format("Euler", SLIDE, ""), scene=FRICTION, **names
):
    model, data = loaded(xml)
    with pytest.raises(error, match=text):
        cr.mujoco.Friction(model, data, scene=scene, **(names or {"slide": "slide"}))


def test_what_cannot_be_used_is_refused() -> None:
    refused(ModelError, "give it as hinge", slide="a")
    refused(ModelError, "no_such: not in the model", slide="no_such")
    refused(ModelError, "give the name", hinge=None)
    refused(ModelError, "set model.opt.integrator", xml=ARM.format("RK4", SLIDE, ""))
    loss = SLIDE.replace("/>", ' frictionloss="1"/>')
    refused(ModelError, r"dof_frictionloss\[2\] = 0", xml=ARM.format("Euler", loss, ""))
    limited = SLIDE.replace("/>", ' range="0 1" limited="true"/>')
    stops = DRAWER.replace({"stops.l_max": 1.0})
    refused(ModelError, "has a range", xml=ARM.format("Euler", limited, ""), scene=stops)
    turned = DRAWER.replace({"node_a.orientation": (0, 0, 0.7071067811865476, 0.7071067811865476)})
    refused(SceneError, "must be the axis of the joint", scene=turned)
    off = DRAWER.replace({"node_b.position": (0, 0.1, 0)})
    refused(
        SceneError, "off the axis of the hinge", xml=ARM.format("Euler", SLIDE, HINGE), scene=off
    )
    refused(SceneError, "limits.force", scene=DRAWER.replace({"limits.force": 10.0}))
    nothing = cr.Scene(**BASE, body_b=DRAWER.body_b)
    refused(SceneError, "nothing acts", scene=nothing)


def test_the_example_model_jams_off_the_middle() -> None:
    path = Path(ROOT / "models" / "arm_opens_drawer.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    friction = cr.mujoco.Friction(model, data, slide="slide", scene=FRICTION)
    drawer = model.body("drawer").id
    for offset, moves in ((0.0, True), (0.19, False)):  # c = 2 mu d / L: 0, and 1.14
        mujoco.mj_resetData(model, data)
        friction.reset()
        for _ in range(200):
            data.ctrl[:] = data.qfrc_bias[1:]
            data.xfrc_applied[drawer, 0] = 300.0
            data.xfrc_applied[drawer, 5] = -300.0 * offset  # force at a handle off the middle
            friction.step()
        assert (data.qvel[0] > 0.5) == moves
        assert (friction.result.regime == "stick") == (not moves)


ROBOT = """<mujoco><option timestep="0.001"/><default><geom contype="0"/></default>
  <worldbody><body><joint type="hinge" axis="0 1 0"/>
  <geom size="0.05" mass="1"/><body pos="0.2 0 0"><joint name="lift" type="slide" axis="0 0 1"/>
  <geom size="0.04" mass="0.6" pos="0 0.05 0"/><body pos="0.1 0 0" euler="0 30 10">
  <joint name="slide" type="slide" axis="1 0 0"/><joint name="hinge" type="hinge" axis="1 0 0"/>
  <geom type="box" size="0.1 0.05 0.03" pos="0.05 0.01 0.02" mass="0.8"/>
  <body name="tip" pos="0.2 0 0"><joint type="ball"/><geom size="0.02" mass="0.1" pos="0.05 0 0"/>
  </body></body></body></body><body pos="1 0 0"><freejoint/><geom size="0.1" mass="1"/></body>
  </worldbody><actuator><motor joint="lift"/></actuator></mujoco>"""


@pytest.mark.parametrize("case", ["plain", "weightless", "a force on the tip", "apply"])
def test_the_call_by_addresses_is_the_step_by_calls_from_python(case: str) -> None:
    """Reactions by own recursion over ancestors and subtree against mj_rnePostConstraint."""
    runs = []
    for directly in (True, False):
        model, data = loaded(ROBOT)
        friction: Any = cr.mujoco.Friction(
            model, data, slide="slide", hinge="hinge",
            scene=cr.Friction(coefficient=0.3, radius=0.02, overlap=0.1),
        )  # fmt: skip
        assert friction._addresses is not None
        if not directly:
            friction._addresses = None
        data.qvel[:] = np.linspace(-2.0, 3.0, model.nv)
        data.ctrl[0] = 12.0
        if case == "weightless":
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        if case == "a force on the tip":
            data.xfrc_applied[model.body("tip").id] = 1.0, -2.0, 3.0, 0.1, 0.2, -0.1
        outs = []
        for _ in range(200):
            if case == "apply":
                friction.apply()
                assert friction.time == data.time
                mujoco.mj_step(model, data)
            else:
                friction.step()
                assert friction.time == pytest.approx(data.time - 0.001, abs=1e-12)
            assert friction.runs == 0  # no constraint was active
            outs.append([*friction.result.array[: layout.REGIME], *data.qpos, *data.qvel])
        runs.append(np.array(outs))
    scale = np.abs(runs[1]).max(axis=0) + 1e-3
    assert np.abs((runs[0] - runs[1]) / scale).max() < 1e-10


def test_a_model_with_functions_of_the_user_is_stepped_from_python() -> None:
    """Their exceptions could not pass through compiled code."""
    model, data = loaded(ROBOT.replace("<motor", '<general gaintype="user"'))
    friction: Any = cr.mujoco.Friction(
        model, data, slide="slide", scene=cr.Friction(coefficient=0.3, radius=0.02, overlap=0.1)
    )
    assert friction._addresses is None
    friction.step()
    assert np.isfinite(friction.forces).all()
