"""The cases of the work-precision diagrams: scene, end state to be computed, reference solution.

Every solver returns poses and twists at the end. Slide, spin, rates and constraint violation are
computed from these here, in the same way for all, and compared with closed forms or independent
equations of motion (cylconn_ros/reference), never with another solver.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common import frames, published
from cylconn_ros.bench.common.frames import Array, inverse, product, rotation, to_world
from cylconn_ros.bench.common.results import Errors
from cylconn_ros.bench.common.settings import SceneLoader
from cylconn_ros.reference import (
    answers,
    closed_forms,
    fixed_shaft,
    over_time_answers,
    sleeve_answers,
)
from cylconn_ros.reference.free_pair import free_pair, motion
from cylconn_ros.scene.scene import Scene

ERROR = "error"
"""The main error (m): of slide and of spin times radius combined, or of a centre of mass."""

LOOKAHEAD = 0.1
"""s: if the bodies still move at the end, an error of the rate counts as the error of the position
this much later."""

Reference = Mapping[str, float]
"""Quantities of :func:`end_quantities` that are known at the end."""


@dataclass(frozen=True)
class Case:
    """A case of the benchmark.

    Attributes
    ----------
        name: of the scene. title: what happens. error_of: the quantity that ERROR measures.
        duration: s, a multiple of 20 ms. scale: m, size of the motion; a solution with an error
            above half of it counts as failed.
        reference: reference solution of a scene at a time (s). source: where it comes from.
        reaction_dependent: the friction depends on reactions that change during the motion.
        comes_to_rest: the bodies are at rest at the end.
        scene: builds the scene; None: the bundled scene of this name.
        calibrates: whether the reference also holds for the calibration scene.
        published: result of another program, its name and its error (m), without a CPU time.
        group: connectors that share the body; only methods of groups solve it.
    """

    name: str
    title: str
    error_of: str
    duration: float
    scale: float
    reference: Callable[[Scene, float], Reference]
    source: str
    reaction_dependent: bool = False
    comes_to_rest: bool = False
    scene: Callable[[], Scene] | None = None
    calibrates: bool = True
    published: tuple[str, float] | None = None
    group: bool = False

    @property
    def events(self) -> bool:
        """Whether friction or stops act."""
        return self.name not in ("free_slide", "free_flight")


def spin_radius(scene: Scene) -> float:
    """Radius (m) that converts spin to a distance."""
    return scene.friction.radius if scene.friction.on else 0.02


def end_quantities(scene: Scene, state: Array) -> dict[str, float]:
    """Quantities of a state (26,).

    slide (m), spin (rad, within half a turn): since the start. v (m/s), w (rad/s): their rates.
    offset (m), tilt (rad): constraint violation. x, y, z (m): centre of mass of B. energy (J).
    """
    found = {}
    (l0, y0, z0), q0, axis_b = _relative(scene, _start(scene))
    (slide, y, z), q, _ = _relative(scene, state)
    rotated = product(q, inverse(q0))
    found["slide"] = slide - l0
    found["spin"] = 2.0 * math.atan2(rotated[0], rotated[3])
    found["offset"] = math.hypot(y - y0, z - z0)
    e1 = rotation(state[3:7]) @ rotation(scene.node_a.orientation)[:, 0]
    e1b = rotation(state[16:20]) @ axis_b
    found["tilt"] = math.atan2(float(np.linalg.norm(np.cross(e1b, e1))), float(e1b @ e1))
    xa, xb = state[:3], to_world(state[13:20], scene.node_b.position)
    velocity_b = state[20:23] + np.cross(state[23:26], xb - state[13:16])
    velocity_a = state[7:10] + np.cross(state[10:13], xb - xa)
    found["v"] = float(e1 @ (velocity_b - velocity_a))
    found["w"] = float(e1 @ (state[23:26] - state[10:13]))
    com, _ = frames.com(scene.body_b, state[13:])
    found["x"], found["y"], found["z"] = map(float, com)
    found["energy"] = frames.energy(scene, state)
    return found


def errors(case: Case, scene: Scene, reference: Reference, state: Array) -> Errors:
    """Errors of an end state (26,); ERROR first."""
    if not np.all(np.isfinite(state)):
        return {ERROR: (math.nan, "m")}
    found = end_quantities(scene, state)
    r = spin_radius(scene)
    difference = {name: found[name] - value for name, value in reference.items()}
    if "spin" in difference:
        difference["spin"] = math.remainder(difference["spin"], 2.0 * math.pi)
    if "x" in difference:
        error = math.sqrt(sum(difference[name] ** 2 for name in "xyz"))
    else:
        error = math.hypot(difference.get("slide", 0.0), r * difference.get("spin", 0.0))
        if not case.comes_to_rest:
            rates = math.hypot(difference.get("v", 0.0), r * difference.get("w", 0.0))
            error = math.hypot(error, LOOKAHEAD * rates)
    sizes: Errors = {ERROR: (error, "m")}
    for name, unit in (("slide", "m"), ("spin", "rad"), ("v", "m/s"), ("w", "rad/s")):
        if name in difference:
            sizes[name] = abs(difference[name]), unit
    if "energy" in difference:
        sizes["energy"] = abs(difference["energy"] / reference["energy"]), "1"
    sizes["violation"] = math.hypot(found["offset"], r * found["tilt"]), "m"
    return sizes


def failure(case: Case, scene: Scene, sizes: Errors, state: Array) -> str:
    """Why a solution counts as failed; empty if it does not."""
    if not math.isfinite(sizes[ERROR][0]):
        return "diverged"
    if sizes["violation"][0] > 0.5 * case.scale:
        return "joint came apart"
    if sizes[ERROR][0] > 0.5 * case.scale:
        return "error above half of the motion"
    found = end_quantities(scene, state)
    speed = math.hypot(found["v"], spin_radius(scene) * found["w"])
    if case.comes_to_rest and speed > 0.1 * case.scale / case.duration:
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
    """Node b from node a and orientation of B, in the axes of a; joint axis in the axes of B."""
    node_a = product(state[3:7], scene.node_a.orientation)
    axes = rotation(node_a)
    d = to_world(state[13:20], scene.node_b.position) - to_world(state[:7], scene.node_a.position)
    q = product(inverse(node_a), state[16:20])
    return axes.T @ d, q, rotation(q).T[:, 0]


# --- reference solutions of a scene at a time (s)

_QUANTITIES: dict[Callable[..., float], str] = {
    answers.distance: "slide",
    answers.rotation: "spin",
    answers.creep: "slide",
}


def _closed(
    scene: Scene, end: float, solution: Callable[..., list[answers.Expected]]
) -> dict[str, float]:
    """Slide and spin from the closed forms of the scene library."""
    return {_QUANTITIES[e.of]: e.value for e in solution(scene, end) if e.of in _QUANTITIES}


def _free_slide(scene: Scene, end: float) -> Reference:
    a = answers.gravity_along_slot(scene)
    v = float(np.linalg.norm(scene.initial_twist(1)[:3])) + a * end
    w = float(np.linalg.norm(scene.initial_twist(1)[3:]))
    return {**_closed(scene, end, answers.free_slide), "v": v, "w": w}


def _coast(scene: Scene, end: float) -> Reference:
    return {**_closed(scene, end, answers.coast), "v": 0.0}


def _slide_and_spin(scene: Scene, end: float) -> Reference:
    twist, f = scene.initial_twist(1), scene.friction
    v0, c = twist[0], f.radius * twist[3] / twist[0]
    tau = v0 / (f.coefficient * float(np.linalg.norm(scene.gravity)))
    spin = closed_forms.constant_normal_force_turn(c, v0, tau) / f.radius
    return {**_closed(scene, end, answers.slide_and_spin), "spin": spin, "v": 0.0, "w": 0.0}


def _eccentric_rotor(scene: Scene, end: float) -> Reference:
    spin, rate = (e.value for e in answers.eccentric_rotor(scene, end))
    return {"slide": 0.0, "spin": spin, "w": rate}


def _free_flight(scene: Scene, end: float) -> Reference:
    x, y, z = map(float, free_pair(scene, end).com_b)
    return {"x": x, "y": y, "z": z, "energy": frames.energy(scene, _start(scene))}


def _hub_and_rotor(scene: Scene, end: float) -> Reference:
    found = end_quantities(scene, motion(scene, end))
    return {name: found[name] for name in ("slide", "spin", "v", "w")}


def _at_rest(_scene: Scene, _end: float) -> Reference:
    return {"slide": 0.0, "v": 0.0}


def _oscillator(scene: Scene, _end: float) -> Reference:
    force = scene.friction.coefficient * scene.body_b.mass * float(np.linalg.norm(scene.gravity))
    x0 = scene.initial_pose(1)[0] - scene.reference.length
    _, x = closed_forms.dry_oscillator(scene.elasticity.k1, scene.body_b.mass, force, x0)
    return {"slide": x - x0, "v": 0.0}


def _between_stops(scene: Scene, end: float) -> Reference:
    position, velocity = (e.value for e in answers.between_stops(scene, end))
    return {"slide": position - scene.initial_pose(1)[0], "v": velocity}


def _near_jam(scene: Scene, end: float) -> Reference:
    return {**_closed(scene, end, answers.near_jam), "v": 0.0}


def _demo(scene: Scene, end: float) -> Reference:
    found = fixed_shaft.slide_and_spin(scene, end, points=2)
    return {"slide": found.distance, "spin": float(found.alpha[-1]), "v": 0.0, "w": 0.0}


def _brake(scene: Scene, end: float) -> Reference:
    return {**_closed(scene, end, over_time_answers.brake), "v": 0.0}


def _forced_oscillator(scene: Scene, end: float) -> Reference:
    position = over_time_answers.forced_oscillator(scene, end)[1].value
    return {"slide": position - scene.initial_pose(1)[0]}


def _one_slide(scene: Scene, end: float) -> Reference:
    position, velocity = published.slide(scene, end)
    return {"slide": position, "v": velocity}


def _friction_oscillator(scene: Scene, _end: float) -> Reference:
    return {"slide": published.oscillation(scene) - scene.initial_pose(1)[0], "v": 0.0}


def _bounce(scene: Scene, end: float) -> Reference:
    height = scene.initial_pose(1)[0] - scene.stops.l_min
    position, velocity = published.bounced(
        height, abs(scene.gravity[0]), scene.stops.restitution, end
    )
    return {"slide": position - height, "v": velocity}


def _telescope(scene: Scene, end: float) -> Reference:
    return {**_closed(scene, end, sleeve_answers.telescope_binds), "v": 0.0}


def _two_rails(scene: Scene, _end: float) -> Reference:
    """Without overlap the normal forces of both rails add up to the weight: v^2/(2 mu g)."""
    deceleration = scene.friction.coefficient * float(np.linalg.norm(scene.gravity))
    return {"slide": scene.initial_twist(1)[0] ** 2 / (2.0 * deceleration), "v": 0.0}


CLOSED_FORM = "closed form"
REDUCED = "reduced equations, DOP853 to 1e-12"
NEWTON_EULER = "Newton-Euler with multipliers, DOP853 to 1e-12"
ONE_SLIDE = "one equation of motion, DOP853 to 1e-12"
WITH_KINKS = "one equation of motion, DOP853, kinks not located"
SLIDE_AND_SPIN = "slide and spin"
CASES = {
    case.name: case
    for case in (
        Case("free_slide", "free slide", SLIDE_AND_SPIN, 1.0, 1.0, _free_slide, CLOSED_FORM),
        Case("coast", "slide with normal load", "stopping distance", 0.5, 0.2, _coast, CLOSED_FORM,
             comes_to_rest=True),
        Case("slide_and_spin", "slide and spin on one disc", "stopping distance and angle", 0.7,
             0.3, _slide_and_spin, CLOSED_FORM, comes_to_rest=True),
        Case("eccentric_rotor", "rotor braked by its own centrifugal load", SLIDE_AND_SPIN, 2.0,
             0.35, _eccentric_rotor, CLOSED_FORM, reaction_dependent=True),
        Case("free_flight", "two free bodies 1000:1, no friction", "position of the small body",
             2.0, 0.05, _free_flight, NEWTON_EULER),
        Case("hub_and_rotor", "two free bodies 1000:1, friction", SLIDE_AND_SPIN, 1.0, 0.25,
             _hub_and_rotor, NEWTON_EULER, reaction_dependent=True),
        Case("incline_stick", "stick on an incline", "creep in 2 s", 2.0, 0.5, _at_rest,
             CLOSED_FORM, comes_to_rest=True),
        Case("dry_friction_oscillator", "dry-friction oscillator", "position at rest", 2.0, 0.1,
             _oscillator, CLOSED_FORM, comes_to_rest=True),
        Case("between_stops", "stop impacts, restitution 0.8", "position", 1.0, 0.1,
             _between_stops, CLOSED_FORM),
        Case("near_jam", "near jam, c = 0.95", "stopping distance", 0.1, 0.0127, _near_jam,
             CLOSED_FORM, reaction_dependent=True, comes_to_rest=True),
        Case("jam", "jam, c = 1.05", "distance after the stop", 0.1, 0.1, _at_rest, CLOSED_FORM,
             reaction_dependent=True, comes_to_rest=True),
        Case("demo", "unbalanced sleeve down a slope", "stopping distance and angle", 4.0, 1.4,
             _demo, REDUCED, reaction_dependent=True, comes_to_rest=True),
        Case("spring_hard_stop", "spring, Stribeck, hard stop", "position at rest", 1.2, 0.25,
             _one_slide, ONE_SLIDE, comes_to_rest=True, scene=published.spring_hard_stop,
             calibrates=False, published=("Modelica", 2e-6)),
        Case("brake", "brake closes", "stopping distance", 1.2, 0.6, _brake, CLOSED_FORM,
             comes_to_rest=True, calibrates=False),
        Case("friction_table", "table of friction, driven", "position", 3.0, 12.0, _one_slide,
             WITH_KINKS, scene=published.friction_table, calibrates=False),
        Case("friction_oscillator", "Siconos' friction oscillator", "position at rest", 24.0, 12.0,
             _friction_oscillator, CLOSED_FORM, comes_to_rest=True, calibrates=False,
             scene=published.friction_oscillator,
             published=("Siconos, 10 ms", abs(0.682044135 - 0.6821789367))),
        Case("forced_oscillator", "forced, dry friction (Den Hartog)", "position", 2.0, 0.08,
             _forced_oscillator, CLOSED_FORM, calibrates=False),
        Case("stick_slip", "stick-slip pull", "position after the first jump", 12.0, 0.65,
             _one_slide, ONE_SLIDE, comes_to_rest=True, scene=published.stick_slip,
             calibrates=False),
        Case("bounce_under_load", "bounce under load, restitution 0.8", "position", 2.0, 1.0,
             _bounce, CLOSED_FORM, scene=published.bounce_under_load, calibrates=False),
        Case("telescope_binds", "overlap shrinks until it binds", "stopping distance", 0.6, 0.23,
             _telescope, CLOSED_FORM, reaction_dependent=True, comes_to_rest=True),
        Case("two_rails", "drawer on two rails", "stopping distance", 1.0, 0.25, _two_rails,
             CLOSED_FORM, comes_to_rest=True, scene=lambda: published.two_rails()[0],
             calibrates=False, group=True),
    )
}  # fmt: skip
"""The cases by the names of their scenes, in drawing order."""


def scene_of(load: SceneLoader, case: Case) -> Scene:
    """The scene of a case with the duration of the case."""
    scene = case.scene() if case.scene else load(case.name)
    return dataclasses.replace(
        scene, plant=dataclasses.replace(scene.plant, duration=case.duration)
    )


def chosen(names: tuple[str, ...] = ()) -> Iterator[Case]:
    """All cases, or the named ones."""
    yield from (CASES[name] for name in names or CASES)
