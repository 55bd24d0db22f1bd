"""The scenes of the work-precision diagrams: what is asked at the end, and whence the answer is.

Every contestant answers with poses and twists at the end; slide, spin, rates and violation are
taken from these by the same NumPy here, and compared with closed forms or independent equations of
motion (cylconn_ros/reference), never with a contestant.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common import frames
from cylconn_ros.bench.common.frames import Array, inverse, outside, product, rotation
from cylconn_ros.bench.common.settings import SceneLoader
from cylconn_ros.bench.precision.trials import Errors
from cylconn_ros.reference import answers, closed_forms, fixed_shaft
from cylconn_ros.reference.free_pair import free_pair, motion
from cylconn_ros.scene.scene import Scene

PLACE = "error"
"""The quantity that matters: of slide and of spin at the radius together, or of a mass centre."""

SOON = 0.1
"""s: what still moves at the end is judged by where it will be this much later, too."""

Truth = Mapping[str, float]
"""Quantities of :func:`measured` that are known at the end."""


@dataclass(frozen=True)
class Case:
    """A scene of the benchmark.

    Attributes
    ----------
        title: what happens. matters: what the error is of.
        duration: s, a multiple of 20 ms. scale: m, the size of the motion: an answer that is off
        by half of it is worth nothing.
        reactive: whether friction depends on reactions that change or that it changes itself.
        rests: whether it is at rest at the end.
    """

    name: str
    title: str
    matters: str
    duration: float
    scale: float
    answer: Callable[[Scene, float], Truth]
    source: str
    reactive: bool = False
    rests: bool = False


def radius(scene: Scene) -> float:
    """At which a turn counts as a way, m."""
    return scene.friction.radius if scene.friction.on else 0.02


def measured(scene: Scene, state: Array) -> dict[str, float]:
    """What a state (26,) says: slide (m) and spin (rad, within half a turn) since the start...

    ... their rates ``v``, ``w``, the violation of the constraint ``offset`` (m) and ``tilt`` (rad),
    the place of B's mass centre ``x``, ``y``, ``z``, and the ``energy``.
    """
    found = {}
    (l0, y0, z0), q0, axis_b = _relative(scene, _start(scene))
    (slide, y, z), q, _ = _relative(scene, state)
    turned = product(q, inverse(q0))
    found["slide"] = slide - l0
    found["spin"] = 2.0 * math.atan2(turned[0], turned[3])
    found["offset"] = math.hypot(y - y0, z - z0)
    e1 = rotation(state[3:7]) @ rotation(scene.node_a.orientation)[:, 0]
    e1b = rotation(state[16:20]) @ axis_b
    found["tilt"] = math.atan2(float(np.linalg.norm(np.cross(e1b, e1))), float(e1b @ e1))
    xa, xb = state[:3], outside(state[13:20], scene.node_b.position)
    at_b = state[20:23] + np.cross(state[23:26], xb - state[13:16])
    of_a = state[7:10] + np.cross(state[10:13], xb - xa)
    found["v"] = float(e1 @ (at_b - of_a))
    found["w"] = float(e1 @ (state[23:26] - state[10:13]))
    place, _ = frames.com(scene.body_b, state[13:])
    found["x"], found["y"], found["z"] = map(float, place)
    found["energy"] = frames.energy(scene, state)
    return found


def errors(case: Case, scene: Scene, truth: Truth, state: Array) -> Errors:
    """How far off a state at the end is; ``PLACE`` first."""
    if not np.all(np.isfinite(state)):
        return {PLACE: (math.nan, "m")}
    found = measured(scene, state)
    r = radius(scene)
    off = {name: found[name] - value for name, value in truth.items()}
    if "spin" in off:
        off["spin"] = math.remainder(off["spin"], 2.0 * math.pi)
    if "x" in off:
        way = math.sqrt(sum(off[name] ** 2 for name in "xyz"))
    else:
        way = math.hypot(off.get("slide", 0.0), r * off.get("spin", 0.0))
        if not case.rests:
            rates = math.hypot(off.get("v", 0.0), r * off.get("w", 0.0))
            way = math.hypot(way, SOON * rates)
    sizes: Errors = {PLACE: (way, "m")}
    for name, unit in (("slide", "m"), ("spin", "rad"), ("v", "m/s"), ("w", "rad/s")):
        if name in off:
            sizes[name] = abs(off[name]), unit
    if "energy" in off:
        sizes["energy"] = abs(off["energy"] / truth["energy"]), "1"
    sizes["violation"] = math.hypot(found["offset"], r * found["tilt"]), "m"
    return sizes


def failure(case: Case, scene: Scene, sizes: Errors, state: Array) -> str:
    """Why an answer is worth nothing; empty where it is worth something."""
    if not math.isfinite(sizes[PLACE][0]):
        return "blew up"
    if sizes["violation"][0] > 0.5 * case.scale:
        return "came apart"
    if sizes[PLACE][0] > 0.5 * case.scale:
        return "off by more than half of the motion"
    found = measured(scene, state)
    speed = math.hypot(found["v"], radius(scene) * found["w"])
    if case.rests and speed > 0.1 * case.scale / case.duration:
        return "does not come to rest"
    return ""


def _start(scene: Scene) -> Array:
    return np.array(
        [
            *scene.initial_pose(0), *scene.initial_twist(0),
            *scene.initial_pose(1), *scene.initial_twist(1),
        ]
    )  # fmt: skip


def _relative(scene: Scene, state: Array) -> tuple[Array, Array, Array]:
    """Node b from node a and B's orientation, in A's end; and the slot in body B's axes."""
    end = product(state[3:7], scene.node_a.orientation)
    axes = rotation(end)
    d = outside(state[13:20], scene.node_b.position) - outside(state[:7], scene.node_a.position)
    turn = product(inverse(end), state[16:20])
    return axes.T @ d, turn, rotation(turn).T[:, 0]


# --- answers, for a scene up to its end (s)


def _closed(scene: Scene, end: float, answer: Callable[..., list[answers.Expected]]) -> Truth:
    """Slide and spin of the library's closed forms."""
    names = {"distance": "slide", "turn": "spin", "creep": "slide"}
    known = {names[e.name]: e.value for e in answer(scene, end) if e.name in names}
    return known


def _free_slide(scene: Scene, end: float) -> Truth:
    a = answers.along(scene)
    v = float(np.linalg.norm(scene.initial_twist(1)[:3])) + a * end
    w = float(np.linalg.norm(scene.initial_twist(1)[3:]))
    return {**_closed(scene, end, answers.free_slide), "v": v, "w": w}


def _coast(scene: Scene, end: float) -> Truth:
    return {**_closed(scene, end, answers.coast), "v": 0.0}


def _slide_and_spin(scene: Scene, end: float) -> Truth:
    twist, f = scene.initial_twist(1), scene.friction
    v0, c = twist[0], f.radius * twist[3] / twist[0]
    tau = v0 / (f.coefficient * float(np.linalg.norm(scene.gravity)))
    turn = closed_forms.constant_normal_force_turn(c, v0, tau) / f.radius
    return {**_closed(scene, end, answers.slide_and_spin), "spin": turn, "v": 0.0, "w": 0.0}


def _eccentric_rotor(scene: Scene, end: float) -> Truth:
    turn, spin = (e.value for e in answers.eccentric_rotor(scene, end))
    return {"slide": 0.0, "spin": turn, "w": spin}


def _free_flight(scene: Scene, end: float) -> Truth:
    x, y, z = map(float, free_pair(scene, end).com_b)
    return {"x": x, "y": y, "z": z, "energy": frames.energy(scene, _start(scene))}


def _hub_and_rotor(scene: Scene, end: float) -> Truth:
    found = measured(scene, motion(scene, end))
    return {name: found[name] for name in ("slide", "spin", "v", "w")}


def _stays(scene: Scene, end: float) -> Truth:
    return {"slide": 0.0, "v": 0.0}


def _oscillator(scene: Scene, end: float) -> Truth:
    force = scene.friction.coefficient * scene.body_b.mass * float(np.linalg.norm(scene.gravity))
    x0 = scene.initial_pose(1)[0] - scene.reference.length
    _, place = closed_forms.dry_oscillator(scene.elasticity.k1, scene.body_b.mass, force, x0)
    return {"slide": place - x0, "v": 0.0}


def _between_stops(scene: Scene, end: float) -> Truth:
    position, velocity = (e.value for e in answers.between_stops(scene, end))
    return {"slide": position - scene.initial_pose(1)[0], "v": velocity}


def _near_jam(scene: Scene, end: float) -> Truth:
    return {**_closed(scene, end, answers.near_jam), "v": 0.0}


def _jam(scene: Scene, end: float) -> Truth:
    return {"slide": 0.0, "v": 0.0}


def _demo(scene: Scene, end: float) -> Truth:
    found = fixed_shaft.slide_and_spin(scene, end, points=2)
    return {"slide": found.distance, "spin": float(found.alpha[-1]), "v": 0.0, "w": 0.0}


CLOSED = "closed form"
REDUCED = "reduced equations, DOP853 to 1e-12"
NEWTON = "Newton-Euler with multipliers, DOP853 to 1e-12"
WAY = "slide and spin"
CASES = {
    case.name: case
    for case in (
        Case("free_slide", "free slide", WAY, 1.0, 1.0, _free_slide, CLOSED),
        Case("coast", "slide with normal load", "stop distance", 0.5, 0.2, _coast, CLOSED,
             rests=True),
        Case("slide_and_spin", "slide and spin on one disc", "stop distance and turn", 0.7, 0.3,
             _slide_and_spin, CLOSED, rests=True),
        Case("eccentric_rotor", "rotor braked by its own centrifugal load", WAY, 2.0, 0.35,
             _eccentric_rotor, CLOSED, reactive=True),
        Case("free_flight", "two free bodies 1000:1, no friction", "place of the small one", 2.0,
             0.05, _free_flight, NEWTON),
        Case("hub_and_rotor", "two free bodies 1000:1, friction", WAY, 1.0, 0.25, _hub_and_rotor,
             NEWTON, reactive=True),
        Case("incline_stick", "stick on an incline", "creep in 2 s", 2.0, 0.5, _stays, CLOSED,
             rests=True),
        Case("dry_friction_oscillator", "dry-friction oscillator", "place of rest", 2.0, 0.1,
             _oscillator, CLOSED, rests=True),
        Case("between_stops", "stop impacts, restitution 0.8", "position", 1.0, 0.1,
             _between_stops, CLOSED),
        Case("near_jam", "near jam, c = 0.95", "stop distance", 0.1, 0.0127, _near_jam, CLOSED,
             reactive=True, rests=True),
        Case("jam", "jam, c = 1.05", "way after the stop", 0.1, 0.1, _jam, CLOSED,
             reactive=True, rests=True),
        Case("demo", "unbalanced sleeve down a slope", "stop distance and turn", 4.0, 1.4, _demo,
             REDUCED, reactive=True, rests=True),
    )
}  # fmt: skip
"""By the names of the scenes, in the order to draw."""


def scene_of(load: SceneLoader, case: Case) -> Scene:
    """The scene, as long as the case has it."""
    scene = load(case.name)
    return dataclasses.replace(
        scene, plant=dataclasses.replace(scene.plant, duration=case.duration)
    )


def chosen(names: tuple[str, ...] = ()) -> Iterator[Case]:
    """All cases, or those named."""
    yield from (CASES[name] for name in names or CASES)
