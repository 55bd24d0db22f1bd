"""Laws of whole motions: random scenes of a second each, run with every method that applies.

Bodies have arms of up to ten radii of gyration and turn with |w| h from 0.001 to 2; with and
without friction, gravity and springs, on exact and semi-implicit plants, wrenches held in world or
body axes. Stops are left out. Of every run:

    energy      kinetic + gravitational + spring energy never exceeds an earlier value by more than
                a share of the kinetic energy (ENERGY), beside what a semi-implicit plant adds to
                its free bodies by its own
    finite      every output is finite
    reference   slide and spin after REFERENCE_TIME agree with the motion in joint coordinates,
                computed to a tolerance (method minimal), where the bodies turn slowly

Methods other than impulse are run where their held wrenches turn little: |w| h times arm over
radius of gyration below SLOW.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout, plant
from cylconn_ros.errors import SceneError
from cylconn_ros.laws import library, rigid
from cylconn_ros.laws.random import Random, decades, direction, generator, orientation
from cylconn_ros.methods.traits import SOLVERS, TRAITS
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import closed_loop
from cylconn_ros.simulation.minimal import solve
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]

DURATION = 1.0  # s
REFERENCE_TIME = 0.1  # s
SLOW = 0.02
ENERGY = {"impulse": 0.01, "baumgarte": 0.01, "penalty": 0.05, "augmented_lagrangian": 0.05}
"""Greatest rise of the energy as a share of the kinetic energy at the start. The springs of the
penalty methods store energy and return it."""
REFERENCE_ERROR = 0.02  # of the distance travelled and a tenth of the least radius of gyration


@dataclasses.dataclass
class MotionScene:
    """A random scene; turn: its |w| h times arm over radius of gyration; size: m, of its error."""

    scene: Scene
    turn: float
    size: float


@dataclasses.dataclass
class MotionResult:
    """Results of one method; ``failures`` names each motion that violates a law, with the value."""

    motions: int = 0
    energy: float = 0.0  # greatest rise, as a share of the kinetic energy
    references: int = 0
    reference: float = 0.0  # greatest error
    failures: list[str] = dataclasses.field(default_factory=list)


def random_motion(seed: int, number: int) -> MotionScene:
    """The scene ``number`` for a seed, with method impulse."""
    rng = generator(seed, number, 7)
    h = 1e-3
    turn = float(decades(rng, -3.0, math.log10(2.0)))
    gyration = decades(rng, -2.0, -0.5, 2)
    masses = decades(rng, -1.0, 1.0) * np.array([1.0, decades(rng, -2.0, 2.0)])
    bodies, nodes = [], []
    kinds = [("free", "free"), ("free", "free"), ("fixed", "free"), ("free", "fixed")]
    kind = kinds[rng.integers(len(kinds))]
    ratio = 1.0
    for k in range(2):
        com = 0.1 * rng.normal(size=3)
        arm = direction(rng, 1)[0] * gyration[k] * decades(rng, -1.0, 1.0)
        bodies.append(_body(rng, kind[k], float(masses[k]), float(gyration[k]), com))
        nodes.append(com + arm)
        ratio = max(ratio, float(np.linalg.norm(arm) / gyration[k]))
    spin = direction(rng, 1)[0] * turn / h
    if "fixed" in kind:  # the free body turns about the slot, and in it
        spin *= 0.0
    node = orientation(rng, 1)
    moving = rng.random() < 0.5
    slide = float(moving * rng.normal() * turn / h * gyration.min())
    twist = float((moving or "fixed" in kind) * rng.normal() * turn / h)
    values: dict[str, Any] = {
        "period": h,
        "method": "impulse",
        "latency": 0,
        "gravity": [0.0, 0.0, -9.81 * float(rng.random() < 0.5)],
        "plant_integration": "semi_implicit" if rng.random() < 0.25 else "exact",
        "wrench": {"hold": "body" if rng.random() < 0.25 else "world"},
        "body_a": bodies[0],
        "body_b": bodies[1],
        "node_a": {"position": nodes[0].tolist(), "orientation": node[0].tolist()},
        "node_b": {"position": nodes[1].tolist()},
        "plant": _start(bodies, nodes, node, kind, spin, slide, twist),
    }
    if rng.random() < 0.5:
        values["friction"] = {
            "coefficient": float(decades(rng, -1.0, 0.0)),
            "radius": float(0.3 * gyration.min()),
            "overlap": float(gyration.min()),
        }
    if rng.random() < 0.25:
        values["elasticity"] = {"k1": float(masses.min() * decades(rng, 0.0, 4.0))}
    scene = Scene.from_parameters(values)
    size = REFERENCE_TIME * abs(slide) + 0.1 * float(gyration.min())
    return MotionScene(scene, max(turn, abs(twist) * h) * math.sqrt(1.0 + ratio * ratio), size)


def _body(rng: Random, kind: str, mass: float, gyration: float, com: Array) -> dict[str, Any]:
    pose = [*rng.normal(size=3).tolist(), *orientation(rng, 1)[0].tolist()]
    if kind == "fixed":
        return {"kind": "fixed", "pose": pose, "com": com.tolist()}
    moments = mass * gyration**2 * rng.uniform(1.0, 1.8, 3)
    axes = rigid.matrix(orientation(rng, 1))[0]
    tensor = axes @ np.diag(moments) @ axes.T
    elements = [float(tensor[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    return {"kind": kind, "mass": mass, "com": com.tolist(), "inertia": elements, "pose": pose}


def _start(
    bodies: list[dict[str, Any]], nodes: list[Array], node: Array, kind: tuple[str, str],
    spin: Array, slide: float, twist: float,
) -> dict[str, Any]:  # fmt: skip
    """Poses and twists that satisfy the constraint; node b is at node a."""
    turn_a, turn_b = (rigid.matrix(np.array([one["pose"][3:]]))[0] for one in bodies)
    axis = turn_a @ rigid.matrix(node)[0][:, 0]
    at_a, arm_a, arm_b = np.array(bodies[0]["pose"][:3]), turn_a @ nodes[0], turn_b @ nodes[1]
    at_b = at_a + arm_a - arm_b
    bodies[1]["pose"][:3] = at_b.tolist()
    if kind[1] == "fixed":
        spin_a, spin_b = -twist * axis, np.zeros(3)
        velocity_b = np.zeros(3)
        velocity_a = -slide * axis - np.cross(spin_a, arm_a)
    else:
        spin_a, spin_b, velocity_a = spin, spin + twist * axis, np.zeros(3)
        velocity_b = np.cross(spin_a, arm_a) + slide * axis - np.cross(spin_b, arm_b)
    found = {}
    for name, v, w in (("body_a", velocity_a, spin_a), ("body_b", velocity_b, spin_b)):
        found[name] = {"twist": [*map(float, v), *map(float, w)]}
    return found


def check(
    seed: int, number: int, results: dict[str, MotionResult], methods: tuple[str, ...] = SOLVERS
) -> None:
    """Run one scene with every method that applies and add to ``results`` by method."""
    one = random_motion(seed, number)
    for method in methods:
        if method != "impulse" and one.turn > SLOW:
            continue
        accepted, _ = library.accepted_scenes({"motion": one.scene}, method)
        if "motion" not in accepted:
            continue
        result = results.setdefault(method, MotionResult())
        result.motions += 1
        rise, end = _run(accepted["motion"])
        if rise > result.energy:
            result.energy = rise
        if not rise <= ENERGY[method]:
            result.failures.append(f"{number}: energy +{rise:.2g}")
        exact = one.scene.plant_integration == "exact"
        if one.turn < SLOW and exact and TRAITS[method].second_order:
            error = _reference_error(one, end)
            if error is not None:
                result.references += 1
                result.reference = max(result.reference, error)
                if not error <= REFERENCE_ERROR:
                    result.failures.append(f"{number}: off the reference by {error:.2g}")


def _run(scene: Scene) -> tuple[float, Array]:
    """Greatest rise of the energy as a share of the kinetic energy, and the end for reference."""
    samples = round(DURATION / scene.period) + 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a motion that diverges overflows
        run = closed_loop(scene, samples)
        at = run.outs[round(REFERENCE_TIME / scene.period)]
        end = at[[layout.DISPLACEMENT, layout.ROTATION]]
        if not np.isfinite(run.energy).all() or run.outs[:, layout.STATUS].any():
            return math.inf, end
        plain = Plant(scene)
        par = plain.par.copy()
        par[0:3] = 0.0
        kinetic = plant.energy(par, plain.state)
        u = run.outs[:, layout.MATERIAL_DISPLACEMENT]
        total = run.energy + 0.5 * scene.elasticity.k1 * u * u
        gained = np.diff(total)
        if scene.plant_integration == "semi_implicit":
            gained = gained - np.maximum(_own_gain(plain, run.states[:-1]), 0.0)
        level = np.concatenate([[0.0], np.cumsum(gained)])
        weight = float(np.sum(np.abs(run.outs[:, layout.ENERGY_EXCHANGED][-1:])))
        rise = float(np.max(level - np.minimum.accumulate(level)))
        return rise / max(kinetic, 1e-2 * weight, 1e-300), end


def _own_gain(body: Plant, states: Array) -> Array:
    """Energy that each step of a semi-implicit plant adds to its bodies without wrenches."""
    found, none = np.empty(len(states)), np.zeros(6)
    for k, state in enumerate(states):
        moved = state.copy()
        plant.step(body.par, moved, none, none, body.loads, body.scene.period)
        found[k] = plant.energy(body.par, moved) - plant.energy(body.par, state)
    return found


def _reference_error(one: MotionScene, end: Array) -> float | None:
    """Error of slide and spin against the motion in joint coordinates; None if it has none."""
    try:
        motion = solve(one.scene, REFERENCE_TIME, 1e-9, most_steps=20_000)
    except (SceneError, RuntimeError):
        return None
    slide = abs(end[0] - (motion.length[-1] - motion.length[0]))
    return float(slide / one.size)


def check_all(
    seed: int, motions: int, progress: Callable[[int, int], None]
) -> dict[str, MotionResult]:
    """Check ``motions`` random motions; results by method."""
    results: dict[str, MotionResult] = {}
    for number in range(motions):
        check(seed, number, results)
        progress(number + 1, motions)
    return results
