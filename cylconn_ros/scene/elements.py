"""Tables of springs and dampers, and compliant stops of a scene, and the rules for them."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from cylconn_ros.core.layout import MOST_POINTS
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.behaviour import Stops
from cylconn_ros.scene.bodies import Body
from cylconn_ros.scene.fields import SceneFields
from cylconn_ros.scene.schema import show

# What a period h carries, as multiples of m/h^2 and m/h, m the mass that slides. Solved steps keep
# the energy of a spring at any stiffness; beyond 10 they skip most of what the spring does.
SOLVED = (10.0, 20.0)
# Methods that take the force from the sample are stable for k h^2/m + 2 c h/m < 4, k and c the sums
# over all springs and dampers of the component, on both plants (Jury's criterion for the held force
# of methods/sampled_elements.py). Half of it is allowed: reactions that follow the force late, by
# friction or by arms of elastic constraints, make the body lighter.
FROM_THE_SAMPLE = 2.0
# A plant that takes positions from the new velocities loses a linear spring beyond this multiple of
# m/h^2: each step turns it over and adds energy.
SEMI_IMPLICIT = 4.0


class Table(NamedTuple):
    """One table of a scene: names and numbers of its points and values."""

    group: str
    points_name: str
    values_name: str
    points: tuple[float, ...]
    values: tuple[float, ...]
    constant: bool

    @property
    def slopes(self) -> list[float]:
        """Slopes between the points."""
        pairs = itertools.pairwise(zip(self.points, self.values, strict=True))
        return [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairs]

    @property
    def steepest(self) -> float:
        """Greatest slope; 0 without points."""
        return max(map(abs, self.slopes), default=0.0)


def _tables(scene: SceneFields, group: str, slide: str, spin: str) -> tuple[Table, Table]:
    """The tables of slide and spin in a group; ``slide``, ``spin``: names of their points."""
    found = [
        (f"{group}.{name}", points, values, getattr(getattr(scene, group), name))
        for name, points, values in (
            ("table", slide, "forces"), ("rotational_table", spin, "moments"),
        )
    ]  # fmt: skip
    one, two = (
        Table(full, points, values, getattr(table, points), getattr(table, values),
              table.extrapolation == "constant")
        for full, points, values, table in found
    )  # fmt: skip
    return one, two


def spring_tables(scene: SceneFields) -> tuple[Table, Table]:
    """The tables of the springs on slide and spin; without points if there is none."""
    return _tables(scene, "elasticity", "positions", "angles")


def damper_tables(scene: SceneFields) -> tuple[Table, Table]:
    """The tables of the dampers on slide and spin; without points if there is none."""
    return _tables(scene, "damping", "rates", "rates")


class CompliantStops(NamedTuple):
    """Compliant stops of one component; infinite: none."""

    low: float
    high: float
    stiffness: float
    damping: float
    depth: float


def compliant_stops(stops: Stops, k: int) -> CompliantStops:
    """The compliant stops of slide (k = 0) or spin (1)."""
    if not stops.compliant[k]:
        return CompliantStops(-math.inf, math.inf, 0.0, 0.0, 1.0)
    low, high, stiffness, damping, depth = (
        (stops.l_min, stops.l_max, stops.stiffness, stops.damping, stops.damping_depth),
        (stops.theta_min, stops.theta_max, stops.rotational_stiffness, stops.rotational_damping,
         stops.rotational_damping_depth),
    )[k]  # fmt: skip
    return CompliantStops(
        -math.inf if math.isnan(low) else low,
        math.inf if math.isnan(high) else high,
        stiffness,
        0.0 if math.isnan(damping) else damping,
        depth,
    )


def has_elements(scene: SceneFields) -> bool:
    """Whether the scene has a table of a spring or a damper, or a compliant stop."""
    tables = (*spring_tables(scene), *damper_tables(scene))
    return any(scene.stops.compliant) or any(table.points for table in tables)


def check_elements(scene: SceneFields) -> None:
    """Raise :class:`SceneError` for tables and compliant stops that cannot be."""
    for table in spring_tables(scene):
        _check_table(table)
    for table in damper_tables(scene):
        _check_table(table)
        if table.points:
            _check_opposes(table)
    _check_compliant(scene.stops)
    _check_period(scene)


def _check_table(table: Table) -> None:
    points, values = f"{table.group}.{table.points_name}", f"{table.group}.{table.values_name}"
    if len(table.values) != len(table.points):
        raise SceneError(
            f"{values} = {show(table.values)}: must be as many numbers as {points} "
            f"({len(table.values)} and {len(table.points)} given)"
        )
    if not table.points:
        return
    if not 2 <= len(table.points) <= MOST_POINTS:
        raise SceneError(
            f"{points} = {show(table.points)}: must be 2 to {MOST_POINTS} numbers "
            f"({len(table.points)} given)"
        )
    if any(not low < high for low, high in itertools.pairwise(table.points)):
        raise SceneError(f"{points} = {show(table.points)}: must be ascending")


def _check_opposes(table: Table) -> None:
    """A damper whose force does not oppose the rate would feed the motion."""
    name = f"{table.group}.{table.values_name} = {show(table.values)}"
    if any(x * y < 0.0 for x, y in zip(table.points, table.values, strict=True)):
        raise SceneError(f"{name}: must have the sign of the rate, so that it takes energy")
    first, last = (table.points[0], table.values[0]), (table.points[-1], table.values[-1])
    rising = zip((table.slopes[0], table.slopes[-1]), (first, last), strict=True)
    ends = [(0.0, y if table.constant else y - slope * x) for slope, (x, y) in rising]
    at_rest = float(np.interp(0.0, table.points, table.values))
    at_rest = ends[0][1] if table.points[0] > 0.0 else at_rest
    at_rest = ends[1][1] if table.points[-1] < 0.0 else at_rest
    if abs(at_rest) > 1e-12 * max(map(abs, table.values)):
        raise SceneError(f"{name}: must be 0 at rate 0 ({at_rest:g} there)")
    if not table.constant and min(table.slopes[0], table.slopes[-1]) < 0.0:
        raise SceneError(
            f"{name}: must not fall towards an end with {table.group}.extrapolation linear: beyond "
            "it the force would change its sign and feed the motion"
        )


def _check_compliant(stops: Stops) -> None:
    for k, (prefix, low, high, ends) in enumerate((
        ("", stops.l_min, stops.l_max, "stops.l_min or stops.l_max"),
        ("rotational_", stops.theta_min, stops.theta_max, "stops.theta_min or stops.theta_max"),
    )):  # fmt: skip
        damping = getattr(stops, f"{prefix}damping")
        name = f"stops.{prefix}stiffness"
        if not stops.compliant[k]:
            if not math.isnan(damping):
                raise SceneError(
                    f"stops.{prefix}damping = {show(damping)}: needs {name}; a rigid stop has "
                    "stops.restitution"
                )
        elif math.isnan(low) and math.isnan(high):
            raise SceneError(f"{name} = {show(getattr(stops, f'{prefix}stiffness'))}: needs {ends}")
    rigid = [x for k, x in enumerate((stops.l_min, stops.l_max)) if not stops.compliant[0]]
    rigid += [x for x in (stops.theta_min, stops.theta_max) if not stops.compliant[1]]
    if any(stops.compliant) and stops.restitution > 0.0 and all(map(math.isnan, rigid)):
        raise SceneError(
            f"stops.restitution = {show(stops.restitution)}: is that of rigid stops, and there is "
            "none; a compliant stop loses energy by its damping"
        )


def _check_period(scene: SceneFields) -> None:
    """What the period carries; unknown masses are not checked, nor methods without a period."""
    method = "impulse" if scene.method == "auto" else scene.method
    unknown = "unknown" in (scene.body_a.kind, scene.body_b.kind)
    sampled = TRAITS[method].samples_elements
    if unknown or scene.period == 0.0 or not (sampled or method == "impulse"):
        return
    if sampled:
        for k in (0, 1):
            _check_sampled(scene, method, k)
        return
    stiff, damp = SOLVED
    for k in (0, 1):
        mass = moved(scene, k)
        given = [(e, stiff if e.order == 2 else damp) for e in _nonlinear(scene, k)]
        if scene.plant_integration == "semi_implicit":
            given.append((_linear(scene, k)[0], SEMI_IMPLICIT))
        for element, share in given:
            most = share * mass / scene.period**element.order
            if element.value > most:
                what = "mass that slides" if k == 0 else "inertia that turns"
                square = " squared" if element.order == 2 else ""
                raise SceneError(
                    f"{_too_much(element, k)}: must be at most {most:g} {_unit(element, k)}, "
                    f"{share:g} times the {what} ({mass:g}) over the period "
                    f"({show(scene.period)} s){square} with the method {method}"
                    f"{_on_the_plant(share)}; give a shorter period or a softer element"
                )


def _check_sampled(scene: SceneFields, method: str, k: int) -> None:
    """Springs and dampers of slide (k = 0) or spin (1) whose forces are those of the sample."""
    mass, h = moved(scene, k), scene.period
    given = [(e, e.value * h**e.order / mass) for e in (*_linear(scene, k), *_nonlinear(scene, k))]
    shares = [x if e.order == 2 else 2.0 * x for e, x in given]
    if sum(shares) <= FROM_THE_SAMPLE * (1.0 + 1e-12):
        return
    worst = max(range(len(given)), key=shares.__getitem__)
    element = given[worst][0]
    left = FROM_THE_SAMPLE - (sum(shares) - shares[worst])
    most = max(left, 0.0) * element.value / shares[worst]
    beside = " beside the other springs and dampers" if left < FROM_THE_SAMPLE else ""
    raise SceneError(
        f"{_too_much(element, k)}: must be at most {most:g} {_unit(element, k)}{beside} with the "
        f"method {method}, so that k h^2/m + 2 c h/m <= {FROM_THE_SAMPLE:g} "
        f"({'m' if k == 0 else 'inertia m'} {mass:g}, period h {show(h)} s); "
        "give a shorter period or a softer element, or use impulse"
    )


class _Element(NamedTuple):
    """Greatest stiffness (order 2) or damping (order 1) that a parameter gives."""

    name: str
    value: float
    order: int


def _linear(scene: SceneFields, k: int) -> tuple[_Element, _Element]:
    spring, damper = (("k1", "c1"), ("kr1", "cr1"))[k]
    return (
        _Element(f"elasticity.{spring}", getattr(scene.elasticity, spring), 2),
        _Element(f"damping.{damper}", getattr(scene.damping, damper), 1),
    )


def _nonlinear(scene: SceneFields, k: int) -> tuple[_Element, ...]:
    stop, prefix = compliant_stops(scene.stops, k), ("", "rotational_")[k]
    spring, damper = spring_tables(scene)[k], damper_tables(scene)[k]
    return (
        _Element(f"stops.{prefix}stiffness", stop.stiffness, 2),
        _Element(f"stops.{prefix}damping", stop.damping, 1),
        _Element(f"{spring.group}.{spring.values_name}", spring.steepest, 2),
        _Element(f"{damper.group}.{damper.values_name}", damper.steepest, 1),
    )


def _unit(element: _Element, k: int) -> str:
    return (("N/m", "N.s/m"), ("N.m/rad", "N.m.s/rad"))[k][2 - element.order]


def _too_much(element: _Element, k: int) -> str:
    what = "stiffness" if element.order == 2 else "damping"
    return (
        f"{element.name}: a {what} of {element.value:g} {_unit(element, k)} is more than the "
        "period carries"
    )


def _on_the_plant(share: float) -> str:
    return " and plant_integration semi_implicit" if share == SEMI_IMPLICIT else ""


def moved(scene: SceneFields, k: int) -> float:
    """Mass (k = 0) or inertia (1) that the component moves, from above."""
    free = [n for n, body in enumerate(scene.bodies) if body.kind == "free"]
    return 1.0 / sum(1.0 / inertia_of(scene, n, k) for n in free)


def inertia_of(scene: SceneFields, n: int, k: int) -> float:
    """Mass (k = 0) of body A (n = 0) or B, or its greatest inertia about its node (1)."""
    body, node = scene.bodies[n], (scene.node_a, scene.node_b)[n].position
    return body.mass if k == 0 else _greatest_inertia(body, node)


def _greatest_inertia(body: Body, node: tuple[float, ...]) -> float:
    """Greatest inertia about an axis through the node."""
    ixx, ixy, ixz, iyy, iyz, izz = body.inertia
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    arm = np.subtract(node, body.com)
    return float(np.linalg.eigvalsh(tensor)[-1] + body.mass * arm @ arm)
