"""``constraint: simulator`` in process: MuJoCo has the joint, the connector sends friction."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled, pair, sleeve

import cylconn_ros as cr
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.core import free_gain, layout
from cylconn_ros.errors import SceneError
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]
LAGS = (0.3, 1.0, 2.5, 5.0, 12.0)


@dataclasses.dataclass
class Run:
    """Samples of a run: outputs, kinetic and potential energy, states, gains of slide and spin."""

    outs: Array
    energy: Array
    states: Array
    gains: Array

    def __getitem__(self, at: int) -> Array:
        """A column of the outputs."""
        return self.outs[:, at]


def kept(name: str, **changes: Any) -> cr.Scene:
    """A bundled scene whose constraint is the simulator's, wrenches as ``xfrc_applied`` wants."""
    fixed: dict[str, Any] = {"method": "auto", "constraint": "simulator", "latency": -1}
    wrench = cr.Wrench(axes="world", point="com")
    return dataclasses.replace(bundled(name), wrench=wrench, **(fixed | changes))


def run(
    scene: cr.Scene, duration: float, lag: float = 0.0, jitter: float = 0.5, substeps: int = 8
) -> Run:
    """MuJoCo's slide and hinge under the connector's pair, each wrench ``lag`` periods late."""
    simulator = MujocoScene(scene, 0.0, "RK4", scene.period / substeps)
    mujoco, model, data = simulator.mujoco, simulator.model, simulator.data
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    connector, rng = cr.Connector(scene), np.random.default_rng(3)
    bodies = [(model.body("b").id, 6)] + ([(model.body("a").id, 0)] if simulator.joint.free else [])
    sample = np.zeros(layout.NSAMPLE)
    acting: Array = np.zeros(12)
    sample[layout.LOADS] = loads = np.array([*scene.plant.body_a.load, *scene.plant.body_b.load])
    sent: list[tuple[float, Array]] = []
    outs, energy, states, gains = [], [], [], []
    for k in range(round(duration / scene.period) + 1):
        sample[layout.MOTION] = simulator.state()
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        outs.append(connector.step(sample).copy())
        energy.append(data.energy.sum())
        states.append(sample[layout.MOTION].copy())
        gains.append(free_gain.free_gain(connector.par, connector.memory))
        sent.append((k + lag * (1.0 + jitter * rng.uniform(-1.0, 1.0)), outs[-1][:12]))
        for i in range(substeps):
            for at, wrench in sent:
                if at <= k + i / substeps + 1e-9:
                    acting = wrench
            for body, at_body in bodies:
                own = slice(at_body, at_body + 6)
                data.xfrc_applied[body] = acting[own] + loads[own]
            mujoco.mj_step(model, data)
        sent = sent[-40:]
    return Run(np.array(outs), np.array(energy), np.array(states), np.array(gains))


def end_error(scene: cr.Scene, outs: Array, reference: cr.Run) -> float:
    """Error of slide and rotation at the end, m."""
    slid = outs[-1, layout.DISPLACEMENT] - reference["displacement"][-1]
    turned = outs[-1, layout.ROTATION] - reference["rotation"][-1]
    return float(math.hypot(slid, scene.friction.radius * turned))


@pytest.mark.parametrize("name", ["coast", "incline", "slide_and_spin", "demo"])
def test_the_motion_is_the_reference_solution(name: str) -> None:
    """Second order in lock step, with an error like that of the connector's own constraint."""
    exact = dataclasses.replace(bundled(name), method="minimal", tolerance=1e-10)
    reference = cr.simulate(exact, duration=1.0)
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        scene = kept(name, period=h)
        found = run(scene, 1.0, substeps=8 if name == "demo" else 1)
        errors.append(end_error(scene, found.outs, reference))
        assert found.gains[2:].min() == 1.0
    connector = dataclasses.replace(scene, constraint="connector", latency=0)
    own = end_error(scene, cr.simulate(connector, duration=1.0).outs, reference)
    assert errors[-1] < 2.0 * own + 1e-12
    assert errors[-1] < 1e-11 or math.log2(errors[0] / errors[-1]) / 2.0 > 1.7


@pytest.mark.parametrize("lag", LAGS)
@pytest.mark.parametrize("h", [0.002, 0.001])
def test_late_friction_takes_energy_and_stops(lag: float, h: float) -> None:
    """Lag with jitter, not declared: no energy from friction, and the body comes to rest."""
    for name in ("coast", "slide_and_spin"):
        found = run(kept(name, period=h), 1.5, lag)
        assert found.energy.max() <= 1.0001 * found.energy[0]
        late = len(found.outs) * 4 // 5
        assert found[layout.SLIP_RATE][-1] < 1e-3
        assert np.ptp(found[layout.LENGTH][late:]) < 1e-3  # creep in 0.3 s, m
        assert found[layout.FLAGS][-1].astype(int) & layout.GAINS_LOWERED
        prompt = run(kept(name, period=h), 1.5, substeps=1)
        travel = prompt[layout.DISPLACEMENT][-1]
        over = 2.0 * (lag + 1.0) * h * 1.0  # m: the speed is 1 m/s; friction begins that late
        over += 4.0 * (1.0 + 3.0 * 1.5 * (lag + 1.0)) * h * 0.1  # and ends exponentially
        assert abs(found[layout.DISPLACEMENT][-1] - travel) < over


@pytest.mark.parametrize("lag", LAGS)
def test_late_stick_holds_on_a_slope(lag: float) -> None:
    """Known loads are balanced in full at any lag: the body slips until the first wrench acts."""
    found = run(kept("incline_stick", period=0.002), 1.0, lag)
    late = len(found.outs) // 2
    fallen = 9.81 * (1.5 * lag + 1.0) * 0.002  # m/s, the speed reached at most
    assert found[layout.SLIP_RATE].max() < fallen
    assert np.ptp(found[layout.LENGTH][late:]) < 1e-6
    assert found[layout.FLAGS][-1].astype(int) & layout.STOPPED


@pytest.mark.parametrize("lag", LAGS)
@pytest.mark.parametrize("name", ["end_stop", "between_stops", "dry_friction_oscillator"])
def test_late_stops_and_springs_take_energy(name: str, lag: float) -> None:
    """A stop does not throw the body back, a spring does not feed its oscillation."""
    scene = kept(name, period=0.002)
    found = run(scene, 1.0, lag)
    spring = 0.5 * scene.elasticity.k1 * found[layout.MATERIAL_DISPLACEMENT] ** 2
    total = found.energy + spring
    exchanged = np.abs(np.diff(found.energy)).sum()
    assert total.max() <= total[0] + 0.05 * exchanged
    for bound, side in ((scene.stops.l_min, -1.0), (scene.stops.l_max, 1.0)):
        if not math.isnan(bound):
            assert (side * (found[layout.LENGTH] - bound)).max() < 0.1


@pytest.mark.parametrize("lag", LAGS)
@pytest.mark.parametrize("name", ["gap_spring", "rubber_stops"])
def test_late_tables_and_compliant_stops_take_energy(name: str, lag: float) -> None:
    """A contact is left with no more speed than it was met with, once the lag is known."""
    found = run(kept(name), 2.0, lag)
    speed = np.abs(found[layout.VELOCITY])
    first = np.flatnonzero(np.diff(np.sign(found[layout.VELOCITY])))[0]
    assert speed[first + 200 :].max() < 1.15 * speed[0]
    assert speed[-300:].max() < speed[0]


@pytest.mark.parametrize("name", ["gap_spring", "rubber_stops", "bump_and_rebound"])
def test_tables_and_compliant_stops_in_lock_step_are_those_of_the_connector(name: str) -> None:
    scene = kept(name)
    found = run(scene, 1.0, substeps=1)
    own = cr.simulate(dataclasses.replace(scene, constraint="connector", latency=0), duration=1.0)
    assert np.abs(found[layout.LENGTH] - own["length"]).max() < 1e-9


def test_the_pair_is_balanced() -> None:
    """Forces and moments of the pair vanish about any point, in the middle of the step."""
    scene = dataclasses.replace(
        pair(friction={"coefficient": 0.3, "radius": 0.02, "overlap": 0.1}, damping={"c1": 2.0}),
        constraint="simulator",
        wrench=cr.Wrench(axes="world", point="com"),
    )
    rng, connector = np.random.default_rng(5), cr.Connector(scene)
    state = Plant(dataclasses.replace(scene, constraint="connector")).state.copy()
    for _ in range(20):
        out = connector.step(np.concatenate([state, np.zeros(12)]))
        fa, ta, fb, tb = np.split(out[:12], 4)
        assert np.linalg.norm(fb) == pytest.approx(abs(out[layout.FORCE]), rel=1e-12)
        np.testing.assert_allclose(fa, -fb, rtol=0, atol=1e-13)
        xa, xb = (
            middle_of_step(scene.bodies[k], state[13 * k : 13 * k + 13], scene.period)
            for k in (0, 1)
        )
        about = ta + tb + np.cross(xa, fa) + np.cross(xb, fb)
        np.testing.assert_allclose(about, 0.0, atol=1e-12)
        if out[layout.REGIME] == layout.SLIP:
            assert out[layout.TRACTION] == pytest.approx(0.3 * out[layout.NORMAL_FORCE], rel=1e-12)
        state[20:26] += 0.05 * rng.normal(size=6)


def middle_of_step(body: cr.Body, state: Array, h: float) -> Array:
    """The mass centre of a body without loads after half a step."""
    x, y, z, w = state[3:7]
    v, c = np.array([x, y, z]), np.array(body.com)
    arm = c + 2.0 * np.cross(v, np.cross(v, c) + w * c)
    return np.asarray(state[:3] + arm + 0.5 * h * (state[7:10] + np.cross(state[10:13], arm)))


def test_the_pair_has_no_power_on_the_constraint() -> None:
    """At node b force and moment are along the axis, whatever presses shaft and sleeve together."""
    tilted = (0.0, 0.25881904510252074, 0.0, 0.9659258262890683)
    scene = dataclasses.replace(
        sleeve(
            v=0.4, spin=3.0, shaft=tilted, constraint="simulator",
            friction={"coefficient": 0.3, "radius": 0.02, "overlap": 0.1},
        ),
        wrench=cr.Wrench(axes="world", point="com"),
    )  # fmt: skip
    axis = np.array([0.8660254037844386, 0.0, -0.5])
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = Plant(dataclasses.replace(scene, constraint="connector")).state
    sample[layout.B_LOAD : layout.B_LOAD + 6] = 3.0, 5.0, -7.0, 0.2, 0.3, -0.1
    out = cr.Connector(scene).step(sample)
    force, moment = out[layout.FORCE_B : layout.TORQUE_B], out[layout.TORQUE_B : layout.STATE0]
    assert np.linalg.norm(out[layout.FORCE + 1 : layout.FORCE + 3]) > 5.0  # reactions
    assert abs(out[layout.FORCE]) > 0.5
    np.testing.assert_allclose(force, out[layout.FORCE] * axis, atol=1e-12)
    np.testing.assert_allclose(moment, out[layout.MOMENT] * axis, atol=1e-12)


def test_the_reactions_are_those_of_an_exact_constraint() -> None:
    """Violations in the sample, which the simulator removes, do not change the reactions."""
    scene = kept("coast")
    moved = np.zeros(layout.NSAMPLE)
    moved[layout.MOTION] = MujocoScene(scene).state()
    first, second = cr.Connector(scene), cr.Connector(scene)
    first.step(moved)
    second.step(moved)
    expected = first.step(moved)
    moved[layout.B_POSE + 1] += 1e-4
    found = second.step(moved)
    assert found[layout.OFFSET_VIOLATION] == pytest.approx(1e-4)
    np.testing.assert_allclose(found[layout.NORMAL_FORCE], expected[layout.NORMAL_FORCE], rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"method": "penalty", "penalty": {"stiffness": 1e4, "damping": 10.0}},
            "method is penalty",
        ),
        ({"method": "baumgarte"}, "method is baumgarte"),
        ({"method": "observe"}, "method is observe"),
        ({"body_b": {"kind": "unknown"}}, "body_b.kind is unknown"),
    ],
)
def test_other_methods_refuse(changes: dict[str, Any], message: str) -> None:
    """Only a solved step has reactions without violations."""
    with pytest.raises(SceneError, match=rf"constraint = 'simulator': needs .*{message}"):
        sleeve(constraint="simulator", **changes)


def test_the_plant_has_no_joint() -> None:
    """The bodies of the plant would fall apart."""
    with pytest.raises(SceneError, match="the bodies of the plant have no joint"):
        cr.simulate(sleeve(constraint="simulator"), samples=2)


def test_the_model_says_it() -> None:
    """The start-up line names what is sent and what is not."""
    connector = cr.Connector(sleeve(constraint="simulator"))
    assert "only what acts on slide and spin is sent" in connector.model
    assert "the simulator's joint keeps them" in connector.not_modelled
