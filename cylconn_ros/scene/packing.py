"""The parameter array of a scene, which the compiled step reads, and the choice of the method."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import elements, friction, model
from cylconn_ros.core.overlap import SLOPES
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.elements import compliant_stops, damper_tables, spring_tables
from cylconn_ros.scene.scene import Body, Friction, Node, Scene

Array = NDArray[np.float64]

SHARE = 0.01  # of the tolerance, for the steps of minimal: on all scenes measured 0.05 is enough
LEAST = 1e-13  # tolerance of a step; below it is rounding


def choose_method(scene: Scene) -> str:
    """The method that ``auto`` stands for: impulse if both inertias are known, else penalty."""
    if scene.method != "auto":
        return scene.method
    if "unknown" in (scene.body_a.kind, scene.body_b.kind):
        return "penalty"
    return "impulse"


def step_tolerance(tolerance: float) -> float:
    """Tolerance of a step of minimal that keeps the motion within ``tolerance``; 0: none given."""
    return max(SHARE * tolerance, LEAST) if tolerance > 0.0 else 0.0


def pack(scene: Scene, *, plant: bool = False) -> Array:
    """The parameter array of ``scene``, laid out as in :mod:`cylconn_ros.core.model`.

    ``plant``: for the plant, which knows the inertia of every body that it moves, also of a body
    whose inertia is unknown to the connector.

    Raises :class:`SceneError` if the scene lacks a parameter that the method needs.
    """
    law, table = _friction(scene.friction)
    par = np.zeros(model.TABLE + len(table))
    par[model.GRAVITY : model.GRAVITY + 3] = scene.gravity
    par[model.BODY_A : model.BODY_A + 18] = _body(scene.body_a, plant)
    par[model.BODY_B : model.BODY_B + 18] = _body(scene.body_b, plant)
    node_a, node_b = scene.node_a, scene.node_b
    par[model.NODE_A : model.NODE_A + 3] = _from_com(node_a, scene.body_a)
    par[model.NODE_A + 3 : model.NODE_A + 7] = node_a.orientation
    par[model.NODE_B : model.NODE_B + 3] = _from_com(node_b, scene.body_b)
    if node_b.orientation:
        par[model.NODE_B + 3] = 1.0
        par[model.NODE_B + 4 : model.NODE_B + 8] = node_b.orientation
    ref = scene.reference
    par[model.REFERENCE : model.REFERENCE + 4] = (
        ref.offsets == "hold",
        ref.misalignment == "hold",
        ref.length,
        ref.angle,
    )
    par[model.PULL_IN : model.PULL_IN + 2] = ref.pull_in_speed, ref.pull_in_rate
    par[model.FRICTION : model.FRICTION + friction.SIZE] = friction.pack(law)
    par[model.OVERLAP : model.OVERLAP + 6] = pack_overlap(scene.friction)
    par[model.OFFSET] = scene.friction.offset_force
    elasticity, damping = scene.elasticity, scene.damping
    par[model.ELASTICITY : model.ELASTICITY + 4] = (
        elasticity.k1,
        elasticity.kr1,
        damping.c1,
        damping.cr1,
    )
    method = choose_method(scene)
    if TRAITS[method].uses_gains and not plant:
        par[model.PENALTY : model.PENALTY + 6] = _penalty(scene, method, scene.friction.preload)
    par[model.AUGMENTED] = scene.penalty.multiplier_gain
    feedback = scene.baumgarte
    par[model.BAUMGARTE : model.BAUMGARTE + 3] = (
        feedback.alpha,
        feedback.beta,
        feedback.regularisation_velocity,
    )
    par[model.OUTPUT : model.OUTPUT + 6] = (
        scene.wrench.axes == "world",
        scene.wrench.point == "com",
        scene.wrench.hold == "body",
        scene.plant_integration == "semi_implicit",
        scene.limits.force,
        scene.limits.torque,
    )
    par[model.STOPS : model.STOPS + 5] = _stops(scene)
    par[model.ELEMENTS : model.ELEMENTS + elements.SIZE] = _elements(scene)
    lock = scene.lock
    par[model.LOCK : model.LOCK + 3] = (
        ("none", "slide", "spin").index(lock.component),
        lock.position,
        lock.force,
    )
    for k, imposed in enumerate((scene.command.slide, scene.command.spin)):
        at = model.COMMAND + 3 * k
        par[at : at + 3] = imposed.position, imposed.velocity, imposed.force
        at = model.DRIVE + 2 * k
        par[at : at + 2] = imposed.max_force, imposed.approach_speed
    par[model.REST_RATE] = scene.friction.rest_rate
    par[model.LATENCY] = 0.0 if plant else _latency(scene)
    if scene.constraint == "simulator" and not plant:
        par[model.CONSTRAINT] = 1.0 if scene.latency >= 0 else 2.0
        par[model.LATENCY] = max(scene.latency, 0)
    par[model.TOLERANCE] = step_tolerance(scene.tolerance)
    par[model.TABLE :] = table
    return par


def pack_preload(scene: Scene, preload: float) -> list[tuple[slice, Sequence[float]]]:
    """The sections of the parameter array that depend on the preload, for another one (N)."""
    law, _ = _friction(dataclasses.replace(scene.friction, preload=preload))
    at = model.FRICTION
    found: list[tuple[slice, Sequence[float]]] = [
        (slice(at, at + friction.SIZE), friction.pack(law))
    ]
    method = choose_method(scene)
    if TRAITS[method].uses_gains:
        at, gains = model.PENALTY, _penalty(scene, method, preload)
        found.append((slice(at, at + 6), gains))
    return found


def _from_com(node: Node, body: Body) -> Array:
    """The node relative to its body's mass centre; for infinite inertia, to the body's origin."""
    return np.array(node.position) - np.array(_com(body))


def _com(body: Body) -> tuple[float, ...]:
    return body.com if body.kind in ("free", "unknown") else (0.0, 0.0, 0.0)


def _body(body: Body, plant: bool) -> list[float]:
    known = body.kind == "free" or (plant and body.kind == "unknown")
    if not known:
        return [0.0, math.inf, 0.0, *_com(body), *[0.0] * 12]
    ixx, ixy, ixz, iyy, iyz, izz = body.inertia
    j = np.linalg.inv([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    inverse = [j[0, 0], j[0, 1], j[0, 2], j[1, 1], j[1, 2], j[2, 2]]
    return [1.0, body.mass, 1.0 / body.mass, *body.com, *body.inertia, *map(float, inverse)]


def latency_is_measurable(scene: Scene) -> bool:
    """Whether the motion can tell when wrenches act: known inertia, and wrenches that are sent."""
    return (
        "unknown" not in (scene.body_a.kind, scene.body_b.kind)
        and scene.constraint == "connector"
        and TRAITS[choose_method(scene)].sends_wrench
    )


def _latency(scene: Scene) -> float:
    """The latency, MEASURED, or ADAPTED if it cannot be measured; 0 if no wrench is sent."""
    if scene.latency >= 0:
        return float(scene.latency)
    if not TRAITS[choose_method(scene)].sends_wrench:
        return 0.0
    unknown = "unknown" in (scene.body_a.kind, scene.body_b.kind)
    return model.ADAPTED if unknown else model.MEASURED


def _stops(scene: Scene) -> list[float]:
    """Rigid stops of length and angle, infinite if there is none, and the restitution."""
    stops = scene.stops
    if any(stops.compliant):
        free = {"l_min": math.nan, "l_max": math.nan} if stops.compliant[0] else {}
        if stops.compliant[1]:
            free |= {"theta_min": math.nan, "theta_max": math.nan}
        stops = dataclasses.replace(stops, **free)
    low = [-math.inf if math.isnan(x) else x for x in (stops.l_min, stops.theta_min)]
    high = [math.inf if math.isnan(x) else x for x in (stops.l_max, stops.theta_max)]
    return [low[0], high[0], low[1], high[1], stops.restitution]


def _friction(given: Friction) -> tuple[friction.Law, list[float]]:
    """The friction law, and the numbers of its table."""
    table = given.table
    law = friction.make_law(
        on=given.on,
        coefficient=given.mean_coefficient,
        static_coefficient=given.static_coefficient,
        decay=given.decay,
        cap=given.max_force,
        radius=given.radius,
        overlap=given.overlap if given.presses("bending") else 0.0,
        preload=given.preload if given.presses("preload") else 0.0,
        radial=given.presses("radial"),
        direction=given.direction,
        table=None if table is None else friction.Table(table.rates, table.forces, table.values),
    )
    return law, [] if table is None else [*table.rates, *table.forces, *table.values]


def pack_overlap(given: Friction) -> list[float]:
    """How overlap and middle of the contact change with the slide, as in core/overlap.py."""
    sigma = SLOPES[given.overlap_change]
    auto = "body_b" if sigma == 0.0 else "between"
    centre = auto if given.contact_centre == "auto" else given.contact_centre
    kappa = {"body_b": 0.0, "body_a": 1.0, "between": 0.5}[centre]
    bends = given.on and given.overlap > 0.0  # else neither matters
    least, most = given.overlap_min, given.overlap_max
    if sigma == 0.0:  # they are bounds of one that changes
        least, most = 0.0, math.inf
    return [
        sigma if bends else 0.0, kappa if bends else 0.0, given.overlap_at, given.overlap,
        least, most,
    ]  # fmt: skip


def _penalty(scene: Scene, method: str, preload: float) -> list[float]:
    """Gains: stiffness and damping of the offsets, the misalignment and the elastic stick."""
    gains, given = scene.penalty, scene.friction
    for name in ("stiffness", "damping"):
        if math.isnan(getattr(gains, name)):
            raise SceneError(
                f"penalty.{name} = .nan: must be given for the method {method}; a sampled spring "
                "is stable up to about m/h^2 and its damper to m/h, with the lighter body's mass m"
            )
    arm = max(0.5 * given.overlap, 0.0 if math.isnan(given.radius) else given.radius)
    swing = gains.rotational_stiffness
    if math.isnan(swing):
        swing = gains.stiffness * arm * arm
    if swing == 0.0:
        raise SceneError(
            "penalty.rotational_stiffness = .nan: must be given (> 0 N.m/rad) where neither "
            "friction.overlap nor friction.radius gives an arm to derive it from"
        )
    swing_damping = gains.rotational_damping
    if math.isnan(swing_damping):
        swing_damping = gains.damping * swing / gains.stiffness
    stick = gains.stick_stiffness
    if math.isnan(stick):
        stick = gains.stiffness
        allowed = gains.elastic_slip
        if not math.isnan(allowed) and preload != 0.0:
            greatest = max(given.mean_coefficient, np.nan_to_num(given.static_coefficient))
            stick = greatest * abs(preload) / allowed or stick
    stick_damping = gains.damping * stick / gains.stiffness
    # A damper acts d + 1/2 periods late, and stays stable with its gain in inverse proportion; the
    # spring's goes with the square, to keep the ratio of damping.
    unknown = "unknown" in (scene.body_a.kind, scene.body_b.kind)
    lag = 1.0 + 2.0 * max(scene.latency, 0) if unknown else 1.0
    return [
        gains.stiffness / lag**2,
        swing / lag**2,
        gains.damping / lag,
        swing_damping / lag,
        float(stick) / lag**2,
        stick_damping / lag,
    ]


def _elements(scene: Scene) -> Array:
    """The numbers of core/elements.py, (SIZE,)."""
    par = np.zeros(elements.SIZE)
    tables = zip(spring_tables(scene), damper_tables(scene), strict=True)
    for k, (spring, damper) in enumerate(tables):
        at, stops = elements.first_of(k), compliant_stops(scene.stops, k)
        par[k] = bool(spring.points or damper.points or stops.stiffness > 0.0)
        par[at : at + 5] = stops
        par[at + elements.STEEPEST] = max([stops.stiffness, *spring.slopes])
        par[at + elements.STEEPEST + 1] = max([stops.damping, *damper.slopes])
        for first, table in ((elements.SPRING, spring), (elements.DAMPER, damper)):
            numbers = elements.pack_table(table.points, table.values, table.constant)
            par[at + first : at + first + len(numbers)] = numbers
    return par
