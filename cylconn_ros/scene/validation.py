"""Rules between the parameters of a scene; the schema checks each value by itself."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.traits import AUTO, TRAITS, MethodTraits
from cylconn_ros.scene.behaviour import Friction, Stops
from cylconn_ros.scene.bodies import Body
from cylconn_ros.scene.elements import check_elements
from cylconn_ros.scene.fields import SceneFields
from cylconn_ros.scene.over_time import check_over_time
from cylconn_ros.scene.schema import show

# Parameters of limits and imposed motion, which not every method models.
BOUNDS = ("stops.", "lock.", "command.slide.position", "command.slide.velocity",
          "command.slide.max_force", "command.slide.approach_speed",
          "command.spin.position", "command.spin.velocity",
          "command.spin.max_force", "command.spin.approach_speed")  # fmt: skip

GREATEST_DELAY = 1000  # samples that a plant delays wrenches at most: it keeps them all


def check(scene: SceneFields) -> None:
    """Raise :class:`SceneError` if parameters contradict each other or physics."""
    _check_bodies(scene)
    _check_method(scene)
    _check_friction(scene.friction)
    _check_stops(scene)
    check_elements(scene)
    _check_lock(scene)
    _check_command(scene)
    check_over_time(scene)
    _check_tolerance(scene)
    _check_observe(scene)
    _check_served(scene)
    _check_constraint(scene)
    _check_joint_names(scene)
    if scene.period > 0.0 and scene.stamp_tolerance >= 0.5 * scene.period:
        raise SceneError(
            f"stamp_tolerance = {show(scene.stamp_tolerance)}: must be less than half the period "
            f"({show(scene.period)} s), or two samples could not be distinguished"
        )


def _check_joint_names(scene: SceneFields) -> None:
    names = scene.joint_names
    for component in ("slide", "spin"):
        if not getattr(names, component):
            raise SceneError(f"joint_names.{component} = '': must not be empty")
    if names.slide == names.spin:
        raise SceneError(f"joint_names: slide and spin must differ, both are {show(names.slide)}")


def _traits(scene: SceneFields) -> MethodTraits:
    return AUTO if scene.method == "auto" else TRAITS[scene.method]


def _check_served(scene: SceneFields) -> None:
    if _traits(scene).has_limits:  # nothing is ignored; the search below takes most of the time
        _check_latency(scene)
        return
    rules, bounds = scene.schema(), _bounds(scene)
    for name, value in scene.parameters().items():
        if name == "latency":
            _check_latency(scene)
        if name.startswith(bounds) and show(value) != show(rules[name].default):
            raise SceneError(
                f"{name} = {show(value)}: the method {scene.method} has no stops, locks or imposed "
                "motion; remove it, or use impulse"
            )


def _bounds(scene: SceneFields) -> tuple[str, ...]:
    """What a method without limits does not model: compliant stops are forces, which all have."""
    slide, spin = scene.stops.compliant
    compliant = ["stops.l_", "stops.stiffness", "stops.damping"] if slide else []
    compliant += ["stops.theta_", "stops.rotational_"] if spin else []
    rigid = [f"stops.{f.name}" for f in dataclasses.fields(scene.stops)]
    return (*BOUNDS[1:], *(name for name in rigid if not name.startswith(tuple(compliant))))


def _check_observe(scene: SceneFields) -> None:
    if _traits(scene).sends_wrench:
        return
    if "free" not in (scene.body_a.kind, scene.body_b.kind):
        raise SceneError(
            f"method = {show(scene.method)}: needs mass and inertia of a body (kind free) to "
            "compute forces from its motion"
        )
    if scene.latency > 0:
        raise SceneError(
            f"latency = {scene.latency}: must be 0 or -1 for {scene.method}, which sends no wrench"
        )


def _check_constraint(scene: SceneFields) -> None:
    """Friction needs the reactions of the step, which only a solved step has without violations."""
    if scene.constraint == "connector":
        return
    rule = f"constraint = {show(scene.constraint)}: needs the method impulse, which computes the "
    rule += "reactions of the simulator's joint from mass and inertia"
    for name, body in zip(("body_a", "body_b"), scene.bodies, strict=True):
        if body.kind == "unknown":
            raise SceneError(f"{rule}; {name}.kind is unknown")
    if scene.method not in ("auto", "impulse", "minimal"):
        raise SceneError(f"{rule}; method is {scene.method}")


def _check_tolerance(scene: SceneFields) -> None:
    if scene.tolerance == 0.0:
        return
    for name, body in zip(("body_a", "body_b"), scene.bodies, strict=True):
        if body.kind == "unknown":
            raise SceneError(
                f"tolerance = {show(scene.tolerance)}: no accuracy can be stated while the "
                f"inertia of {name} is unknown; remove it, or give mass and inertia"
            )
    if scene.method != "auto" and _traits(scene).live:
        raise SceneError(
            f"tolerance = {show(scene.tolerance)}: goes with the methods auto and minimal; the "
            f"accuracy of {scene.method} follows from the period"
        )


def _check_latency(scene: SceneFields) -> None:
    if scene.latency > layout.MAX_LATENCY:
        raise SceneError(
            f"latency = {scene.latency}: must be at most {layout.MAX_LATENCY} samples; "
            "a longer delay needs a longer period"
        )
    if scene.plant.latency > GREATEST_DELAY:  # False if it is not given
        raise SceneError(
            f"plant.latency = {show(scene.plant.latency)}: must be at most {GREATEST_DELAY} samples"
        )


def _check_bodies(scene: SceneFields) -> None:
    a, b = scene.bodies
    if a.kind == b.kind == "fixed":
        raise SceneError("body_b.kind = 'fixed': body_a is fixed too; at least one body must move")
    if not {a.kind, b.kind} & {"free", "unknown"}:
        raise SceneError(
            f"body_b.kind = {show(b.kind)}: body_a is {a.kind}; "
            "at least one body must be free or unknown, so that a force can move it"
        )
    names = (scene.world_frame, a.frame, b.frame)
    if len(set(names)) < len(names):
        raise SceneError(
            f"body_b.frame = {show(b.frame)}: world_frame, body_a.frame and body_b.frame "
            f"must differ (they are {', '.join(names)})"
        )
    for name, body in zip(("body_a", "body_b"), scene.bodies, strict=True):
        _check_mass(name, body)


def _check_mass(name: str, body: Body) -> None:
    if body.kind == "free":
        if math.isnan(body.mass):
            raise SceneError(f"{name}.mass = .nan: must be given, as {name}.kind is free")
        if not body.inertia:
            raise SceneError(f"{name}.inertia = []: must be given, as {name}.kind is free")
    if body.inertia:
        moments = principal_moments(body.inertia)
        largest = max(moments)
        why = f"its principal moments are {', '.join(f'{moment:g}' for moment in moments)}"
        if min(moments) <= 1e-12 * largest:
            raise SceneError(
                f"{name}.inertia = {show(body.inertia)}: must be positive definite ({why})"
            )
        if 2.0 * largest > sum(moments) * (1.0 + 1e-9):
            raise SceneError(
                f"{name}.inertia = {show(body.inertia)}: no rigid body has it: no principal moment "
                f"may exceed the sum of the other two ({why})"
            )


def principal_moments(inertia: Sequence[float]) -> list[float]:
    """Eigenvalues of the tensor with elements ixx, ixy, ixz, iyy, iyz, izz, ascending."""
    ixx, ixy, ixz, iyy, iyz, izz = inertia
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    return [float(moment) for moment in np.linalg.eigvalsh(tensor)]


def _check_method(scene: SceneFields) -> None:
    if _traits(scene).needs_inertia:
        for name, body in zip(("body_a", "body_b"), scene.bodies, strict=True):
            if body.kind == "unknown":
                raise SceneError(
                    f"method = {show(scene.method)}: needs the inertia of both bodies, but "
                    f"{name}.kind is unknown; use penalty, or make the body free and "
                    "give its mass and inertia"
                )


def _check_friction(friction: Friction) -> None:
    static = friction.static_coefficient
    table = friction.table
    if table is not None:
        rows, columns = len(table.rates), len(table.forces)
        for name, axis in (("rates", table.rates), ("forces", table.forces)):
            if not axis or any(not low < high for low, high in itertools.pairwise(axis)):
                raise SceneError(
                    f"friction.table.{name} = {show(axis)}: must be ascending and not empty"
                )
        if len(table.values) != rows * columns:
            raise SceneError(
                f"friction.table.values = {show(table.values)}: must be {rows * columns} numbers, "
                f"{rows} rates times {columns} forces ({len(table.values)} given)"
            )
        if friction.coefficient > 0.0 or not math.isnan(static):
            raise SceneError(
                f"friction.coefficient = {show(friction.coefficient)}: must not be given, nor "
                "friction.static_coefficient, together with friction.table"
            )
    _check_direction(friction)
    mean = friction.mean_coefficient
    if not math.isnan(static):
        if static < mean:
            of_both = "" if friction.direction == 0.0 else ", the mean of both directions of slide"
            raise SceneError(
                f"friction.static_coefficient = {show(static)}: must be >= friction.coefficient "
                f"({show(mean)}{of_both})"
            )
        if static > mean and friction.decay == 0.0:
            raise SceneError(
                "friction.decay = 0.0: must be > 0 s/m if friction.static_coefficient differs "
                "from friction.coefficient; otherwise the kinetic coefficient is never reached"
            )
    _check_overlap(friction)
    if friction.on and math.isnan(friction.radius):
        raise SceneError(
            "friction.radius = .nan: must be given with friction "
            "(the effective radius R of the shaft, > 0 m)"
        )


def _check_direction(friction: Friction) -> None:
    given = [
        name
        for name in ("coefficient_forward", "coefficient_backward")
        if not math.isnan(getattr(friction, name))
    ]
    if given and friction.table is not None:
        raise SceneError(
            f"friction.{given[0]} = {show(getattr(friction, given[0]))}: must not be given "
            "together with friction.table"
        )
    if len(given) == 2 and friction.coefficient > 0.0:
        raise SceneError(
            f"friction.coefficient = {show(friction.coefficient)}: must not be given together with "
            "both friction.coefficient_forward and friction.coefficient_backward, which replace it"
        )


def _check_overlap(friction: Friction) -> None:
    changes = friction.overlap_change != "constant"
    if friction.overlap == 0.0 and (changes or friction.contact_centre != "auto"):
        name = "overlap_change" if changes else "contact_centre"
        raise SceneError(
            f"friction.{name} = {show(getattr(friction, name))}: needs friction.overlap > 0, the "
            "overlap at friction.overlap_at"
        )
    if changes and not friction.overlap_min <= friction.overlap <= friction.overlap_max:
        raise SceneError(
            f"friction.overlap = {show(friction.overlap)}: must be from friction.overlap_min "
            f"({show(friction.overlap_min)} m) to friction.overlap_max "
            f"({show(friction.overlap_max)} m) if it changes"
        )


def _check_stops(scene: SceneFields) -> None:
    stops = scene.stops
    bounds = (
        ("l", stops.l_min, stops.l_max, "m"),
        ("theta", stops.theta_min, stops.theta_max, "rad"),
    )
    for name, low, high, unit in bounds:
        if low >= high:  # False if either is not set
            raise SceneError(
                f"stops.{name}_max = {show(high)}: must be > stops.{name}_min ({show(low)} {unit})"
            )


def _check_command(scene: SceneFields) -> None:
    for name, imposed in (("slide", scene.command.slide), ("spin", scene.command.spin)):
        moves = not (math.isnan(imposed.position) and math.isnan(imposed.velocity))
        if moves and not math.isnan(imposed.force):
            raise SceneError(
                f"command.{name}.force = {show(imposed.force)}: must not be given with a motion "
                f"(command.{name}.position or command.{name}.velocity)"
            )
        limited = math.isfinite(imposed.max_force)
        if limited and not math.isnan(imposed.force):
            raise SceneError(
                f"command.{name}.max_force = {show(imposed.max_force)}: must not be given with "
                f"command.{name}.force ({show(imposed.force)}); it is the limit of a motion"
            )
        if limited:
            method = scene.method
            if method == "auto" and "unknown" in (scene.body_a.kind, scene.body_b.kind):
                method = "penalty"
            limit = f"command.{name}.max_force"
            check_drive(method, limit, imposed.max_force, imposed.position)
        if scene.method == "minimal" and not math.isnan(imposed.velocity):
            _check_unstopped(scene, name, imposed.velocity)
        check_within_stops(scene.stops, name, f"command.{name}.position", imposed.position)


def check_drive(method: str, name: str, value: float, position: float) -> None:
    """Raise :class:`SceneError` if the method has no drives with a greatest force.

    A drive that does not know what it moves cannot brake in time: it has no position.
    """
    traits = AUTO if method == "auto" else TRAITS[method]
    if not traits.limits_drives:
        why = (
            "sends no wrench, so that it has no drive"
            if not traits.sends_wrench
            else "has no drive that gives way; remove it, or use impulse"
        )
        raise SceneError(f"{name} = {show(value)}: the method {method} {why}")
    if traits.uses_gains and not math.isnan(position):
        raise SceneError(
            f"{name} = {show(value)}: with the method {method} must not be given with a position "
            f"({show(position)}), at which a drive can stop only if it knows mass and inertia; "
            "give a velocity alone, or use impulse"
        )


def check_within_stops(stops: Stops, component: str, name: str, position: float) -> None:
    """Raise :class:`SceneError` if a position of slide or spin lies beyond a rigid stop."""
    low, high, prefix = (
        (stops.l_min, stops.l_max, "l")
        if component == "slide"
        else (stops.theta_min, stops.theta_max, "theta")
    )
    if stops.compliant[0 if component == "slide" else 1]:
        return
    for stop, beyond, end, sign in (
        (low, position < low, "min", ">="), (high, position > high, "max", "<="),
    ):  # fmt: skip
        if beyond:  # False if either is not set
            raise SceneError(
                f"{name} = {show(position)}: must be {sign} stops.{prefix}_{end} ({show(stop)}), "
                "which cannot be passed"
            )


def _check_unstopped(scene: SceneFields, name: str, velocity: float) -> None:
    """Method minimal has no drive that a stop holds back."""
    stops = scene.stops
    if stops.compliant[0 if name == "slide" else 1]:
        return
    given = (
        (("stops.l_min", stops.l_min), ("stops.l_max", stops.l_max))
        if name == "slide"
        else (("stops.theta_min", stops.theta_min), ("stops.theta_max", stops.theta_max))
    )
    for stop, value in given:
        ahead = velocity > 0.0 if stop.endswith("max") else velocity < 0.0
        if ahead and not math.isnan(value):
            raise SceneError(
                f"command.{name}.velocity = {show(velocity)}: the method minimal has no drive that "
                f"a stop holds back, and it moves towards {stop} ({show(value)}); use impulse"
            )


def _check_lock(scene: SceneFields) -> None:
    lock = scene.lock
    given = not (math.isnan(lock.position) and math.isnan(lock.force))
    if lock.component == "none" and given:
        raise SceneError(
            "lock.component = 'none': must be slide or spin if lock.position or lock.force is given"
        )
    if lock.component != "none" and not given:
        raise SceneError(
            f"lock.component = {show(lock.component)}: needs a criterion, "
            "lock.position or lock.force"
        )
    if lock.component != "none":
        check_within_stops(scene.stops, lock.component, "lock.position", lock.position)
