"""Rules between the parameters of a scene: what each value by itself cannot show to be wrong."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.schema import show

if TYPE_CHECKING:
    from cylconn_ros.scene.scene import Body, Friction, Scene


# Bounds on slide and spin, and the method that has none.
BOUNDS = ("stops.", "lock.", "command.slide.position", "command.slide.velocity",
          "command.spin.position", "command.spin.velocity")  # fmt: skip
WITHOUT_BOUNDS = "baumgarte"


def check(scene: Scene) -> None:
    """Raise :class:`SceneError` where parameters contradict each other or physics."""
    _check_bodies(scene)
    _check_method(scene)
    _check_friction(scene.friction)
    _check_stops(scene)
    _check_lock(scene)
    _check_command(scene)
    _check_tolerance(scene)
    _check_observe(scene)
    _check_served(scene)
    if scene.period > 0.0 and scene.stamp_tolerance >= 0.5 * scene.period:
        raise SceneError(
            f"stamp_tolerance = {show(scene.stamp_tolerance)}: must be less than half the period "
            f"({show(scene.period)} s), or two samples could not be told apart"
        )


def _check_served(scene: Scene) -> None:
    rules = scene.schema()
    for name, value in scene.parameters().items():
        if name == "latency":
            _check_latency(scene)
        bound = scene.method == WITHOUT_BOUNDS and name.startswith(BOUNDS)
        if bound and show(value) != show(rules[name].default):
            raise SceneError(
                f"{name} = {show(value)}: the method {scene.method} has no stops, locks or imposed "
                "motion; leave it out, or use impulse"
            )


def _check_observe(scene: Scene) -> None:
    if scene.method != "observe":
        return
    if "free" not in (scene.body_a.kind, scene.body_b.kind):
        raise SceneError(
            "method = 'observe': needs mass and inertia of a body (kind free), which its forces "
            "are made of"
        )
    if scene.latency != 0:
        raise SceneError(f"latency = {scene.latency}: must be 0 for observe, which sends no wrench")


def _check_tolerance(scene: Scene) -> None:
    if scene.tolerance == 0.0:
        return
    for name, body in zip(("body_a", "body_b"), scene.bodies, strict=True):
        if body.kind == "unknown":
            raise SceneError(
                f"tolerance = {show(scene.tolerance)}: no accuracy can be promised while the "
                f"inertia of {name} is unknown; leave it out, or give mass and inertia"
            )
    if scene.method not in ("auto", "minimal"):
        raise SceneError(
            f"tolerance = {show(scene.tolerance)}: goes with the methods auto and minimal; the "
            f"accuracy of {scene.method} follows from the period"
        )


def _check_latency(scene: Scene) -> None:
    if scene.latency > layout.MOST_LATE:
        raise SceneError(
            f"latency = {scene.latency}: must be at most {layout.MOST_LATE} samples; "
            "a longer delay wants a longer period"
        )
    unknown = [body.frame for body in scene.bodies if body.kind == "unknown"]
    if scene.latency < 0 and unknown:
        raise SceneError(
            f"latency = -1: cannot be measured with a body of unknown inertia ({unknown[0]}); "
            "give the number of samples, or mass and inertia"
        )


def _check_bodies(scene: Scene) -> None:
    a, b = scene.bodies
    if a.kind == b.kind == "fixed":
        raise SceneError("body_b.kind = 'fixed': body_a is fixed too; at least one body must move")
    if not {a.kind, b.kind} & {"free", "unknown"}:
        raise SceneError(
            f"body_b.kind = {show(b.kind)}: body_a is {a.kind}; "
            "at least one body must be free or unknown, or no force can do anything"
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
                f"{name}.inertia = {show(body.inertia)}: no body has it, as none of the principal "
                f"moments may exceed the sum of the other two ({why})"
            )


def principal_moments(inertia: Sequence[float]) -> list[float]:
    """Eigenvalues of the tensor with elements ixx, ixy, ixz, iyy, iyz, izz, ascending."""
    ixx, ixy, ixz, iyy, iyz, izz = inertia
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    return [float(moment) for moment in np.linalg.eigvalsh(tensor)]


def _check_method(scene: Scene) -> None:
    if scene.method in ("impulse", "minimal", "baumgarte"):
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
                f"friction.coefficient = {show(friction.coefficient)}: must be left out, with "
                "friction.static_coefficient, where friction.table gives the coefficient"
            )
    if not math.isnan(static):
        if static < friction.coefficient:
            raise SceneError(
                f"friction.static_coefficient = {show(static)}: must be >= friction.coefficient "
                f"({show(friction.coefficient)})"
            )
        if static > friction.coefficient and friction.decay == 0.0:
            raise SceneError(
                "friction.decay = 0.0: must be > 0 s/m where friction.static_coefficient differs "
                "from friction.coefficient, or the kinetic one is never reached"
            )
    if friction.on and math.isnan(friction.radius):
        raise SceneError(
            "friction.radius = .nan: must be given with friction "
            "(the effective radius R of the shaft, > 0 m)"
        )


def _check_stops(scene: Scene) -> None:
    stops = scene.stops
    bounds = (
        ("l", stops.l_min, stops.l_max, "m"),
        ("theta", stops.theta_min, stops.theta_max, "rad"),
    )
    for name, low, high, unit in bounds:
        if low >= high:  # False where either is not set
            raise SceneError(
                f"stops.{name}_max = {show(high)}: must be > stops.{name}_min ({show(low)} {unit})"
            )

    for name, at, (end, low, high, unit) in zip(
        ("length", "angle"), (scene.reference.length, scene.reference.angle), bounds, strict=True
    ):
        if at < low or at > high:  # False where any is not set
            ends = [" none" if math.isnan(x) else f" {show(x)}" for x in (low, high)]
            raise SceneError(
                f"reference.{name} = {show(at)}: must be within stops.{end}_min and "
                f"stops.{end}_max ({ends[0].strip()} to{ends[1]} {unit})"
            )


def _check_command(scene: Scene) -> None:
    for name, imposed in (("slide", scene.command.slide), ("spin", scene.command.spin)):
        moves = not (math.isnan(imposed.position) and math.isnan(imposed.velocity))
        if moves and not math.isnan(imposed.force):
            raise SceneError(
                f"command.{name}.force = {show(imposed.force)}: must not be given with a motion "
                f"(command.{name}.position or command.{name}.velocity)"
            )


def _check_lock(scene: Scene) -> None:
    lock = scene.lock
    given = not (math.isnan(lock.position) and math.isnan(lock.force))
    if lock.component == "none" and given:
        raise SceneError(
            "lock.component = 'none': must be slide or spin "
            "where lock.position or lock.force is given"
        )
    if lock.component != "none" and not given:
        raise SceneError(
            f"lock.component = {show(lock.component)}: needs a criterion, "
            "lock.position or lock.force"
        )
