"""Laws of whole motions: random scenes of a second each, run with every method that applies.

Bodies have arms of up to ten radii of gyration and turn with |w| h from 0.001 to 2; with and
without friction, gravity and springs, on exact and semi-implicit plants, wrenches held in world or
body axes. Stops are left out. Of every run:

    energy      kinetic + gravitational + spring energy never exceeds that of the start by more than
                a share (ENERGY) of the greatest kinetic energy, beside what a semi-implicit plant
                adds to its free bodies by its own. Without springs where the constraint is lost, by
                more than LOST radii of gyration: the slide has no meaning there
    rise        nor, with method impulse and without flags, any earlier value
    flag        a constraint that is lost is flagged
    finite      every output is finite
    reference   slide and spin after REFERENCE_TIME agree with the motion in joint coordinates,
                computed to a tolerance (method minimal), where the bodies turn slowly. Motions that
                jam are not compared: how slide and spin stop in a jam depends on the path of the
                impulse, which one step does not resolve

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
ENERGY = {"impulse": 0.01, "baumgarte": 0.05, "penalty": 0.05, "augmented_lagrangian": 0.05}
"""Greatest rise of the energy as a share of the greatest kinetic energy. Those other than impulse
are of first order, or their springs store energy and return it."""
LOST = 10.0  # radii of gyration, of an offset
BAD = layout.UNDERSAMPLED | layout.MISALIGNED | layout.GAINS_LOWERED
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
    energy: float = 0.0  # greatest rise above the start, as a share of the kinetic energy
    references: int = 0
    jams: int = 0  # motions that jam, not compared
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
        energy, rise, unflagged, end = _run(accepted["motion"])
        result.energy = max(result.energy, energy)
        if not energy <= ENERGY[method]:
            result.failures.append(f"{number}: energy +{energy:.2g}")
        elif method == "impulse" and not rise <= ENERGY[method]:
            result.failures.append(f"{number}: energy +{rise:.2g} above an earlier value")
        if unflagged:
            result.failures.append(f"{number}: constraint lost without a flag")
        exact = one.scene.plant_integration == "exact"
        if one.turn < SLOW and exact and TRAITS[method].second_order:
            _compare(one, end, number, result)


def _compare(one: MotionScene, end: Array, number: int, result: MotionResult) -> None:
    """Compare the end (slide, spin) with the motion in joint coordinates, where it has one."""
    try:
        motion = solve(one.scene, REFERENCE_TIME, 1e-9, most_steps=20_000)
    except (SceneError, RuntimeError):
        return
    if any(event.kind == "jams" for event in motion.events):
        result.jams += 1
        return
    error = float(abs(end[0] - (motion.length[-1] - motion.length[0])) / one.size)
    result.references += 1
    result.reference = max(result.reference, error)
    if not error <= REFERENCE_ERROR:
        result.failures.append(f"{number}: off the reference by {error:.2g}")


def _run(scene: Scene) -> tuple[float, float, bool, Array]:
    """Laws of one motion, and slide and spin for the reference.

    The energy above the start and above any earlier value (0 for motions with a flag), as shares of
    the greatest kinetic energy, and whether the constraint is lost without a flag.
    """
    samples = round(DURATION / scene.period) + 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a motion that diverges overflows
        run = closed_loop(scene, samples)
        at = run.outs[round(REFERENCE_TIME / scene.period)]
        end = at[[layout.DISPLACEMENT, layout.ROTATION]]
        if not np.isfinite(run.energy).all() or run.outs[:, layout.STATUS].any():
            return math.inf, math.inf, False, end
        plain = Plant(scene)
        par = plain.par.copy()
        par[0:3] = 0.0
        kinetic = max(plant.energy(par, state) for state in run.states)
        u = run.outs[:, layout.MATERIAL_DISPLACEMENT]
        lost = run.outs[:, layout.OFFSET_VIOLATION].max() > LOST * _gyration(scene)
        springs = 0.0 if lost else 0.5 * scene.elasticity.k1
        gained = np.diff(run.energy + springs * u * u)
        if scene.plant_integration == "semi_implicit":
            gained = gained - np.maximum(_own_gain(plain, run.states[:-1]), 0.0)
        level = np.concatenate([[0.0], np.cumsum(gained)])
        rise = float(np.max(level - np.minimum.accumulate(level)))
        flags = int(np.bitwise_or.reduce(run.outs[:, layout.FLAGS].astype(np.int64)))
        flagged = flags & BAD != 0
        scale = max(kinetic, 1e-300)
        above = 0.0 if flagged else rise / scale
    return float(level.max()) / scale, above, bool(lost and not flagged), end


def _gyration(scene: Scene) -> float:
    """Least radius of gyration of the free bodies, m."""
    found = math.inf
    for body in (scene.body_a, scene.body_b):
        if body.kind == "free":
            xx, xy, xz, yy, yz, zz = body.inertia
            least = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0]
            found = min(found, math.sqrt(least / body.mass))
    return found


def _own_gain(body: Plant, states: Array) -> Array:
    """Energy that each step of a semi-implicit plant adds to its bodies without wrenches."""
    found, none = np.empty(len(states)), np.zeros(6)
    for k, state in enumerate(states):
        moved = state.copy()
        plant.step(body.par, moved, none, none, body.loads, body.scene.period)
        found[k] = plant.energy(body.par, moved) - plant.energy(body.par, state)
    return found


def check_all(
    seed: int, motions: int, progress: Callable[[int, int], None]
) -> dict[str, MotionResult]:
    """Check ``motions`` random motions; results by method."""
    results: dict[str, MotionResult] = {}
    for number in range(motions):
        check(seed, number, results)
        progress(number + 1, motions)
    return results
