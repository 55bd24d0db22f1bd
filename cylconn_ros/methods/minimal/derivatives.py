"""Derivatives of the coordinates, and of six integrals after them: |s|, FN, f1f, m1f, f1, m1."""

from typing import Final

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function, inline_function
from cylconn_ros.core.vectors import add, cross, scale
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.coordinates import (
    Configuration,
    acceleration,
    configuration,
    reduced_equations,
    wrench_on_b,
)
from cylconn_ros.methods.minimal.fixed_shaft import reduced_on_shaft
from cylconn_ros.methods.minimal.forces import Instant, Sides, instant, instant_of
from cylconn_ros.methods.minimal.over_time import set_time

# integrals after the coordinates: |s|, FN, f1f, m1f, f1, m1
SLIP_INTEGRAL: Final = 0
INTEGRALS: Final = 6


@inline_function
def size_of(joint: Array) -> int:
    """Number of coordinates."""
    return 17 if joint[coordinates.MODE] == coordinates.BOTH_FREE else 4


@allocating_function
def _write_body_a(par: Array, joint: Array, p: Configuration, i: Instant, k: Array) -> None:
    """Write the derivatives of pose and twist of A to ``k``."""
    x, y, z, w = p.a.orientation
    sx, sy, sz = p.a.spin
    model.write_vector(k, coordinates.A_COM, p.a.velocity)
    k[coordinates.A_ORIENTATION] = 0.5 * (sx * w + sy * z - sz * y)
    k[coordinates.A_ORIENTATION + 1] = 0.5 * (sy * w + sz * x - sx * z)
    k[coordinates.A_ORIENTATION + 2] = 0.5 * (sz * w + sx * y - sy * x)
    k[coordinates.A_ORIENTATION + 3] = -0.5 * (sx * x + sy * y + sz * z)
    force, moment = wrench_on_b(p, i.total, i.constraint)
    torque = add(cross(p.frame.arm_a, force), moment)
    body = model.body(par, model.BODY_A)
    va, wa = acceleration(par, joint, body, p.a, 0, scale(-1.0, force), scale(-1.0, torque))
    model.write_vector(k, coordinates.A_VELOCITY, va)
    model.write_vector(k, coordinates.A_SPIN, wa)


@inline_function
def _write_free_axes(y: Array, n: int, i: Instant, k: Array) -> None:
    """Write the derivatives of slide and spin, and of the integrals after n coordinates."""
    k[coordinates.LENGTH], k[coordinates.ANGLE] = y[coordinates.SLIDE], y[coordinates.SPIN]
    k[coordinates.SLIDE], k[coordinates.SPIN] = i.acceleration
    k[n], k[n + 1] = i.slip, i.normal
    k[n + 2], k[n + 3] = i.friction
    k[n + 4], k[n + 5] = i.total


@allocating_function
def derivatives_at(
    par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides, k: Array
) -> Instant:
    """Write dy/dt to ``k``; returns accelerations and forces."""
    set_time(par, joint, t)
    if joint[coordinates.MODE] == coordinates.BOTH_FREE:
        p = configuration(par, joint, t, y)
        i = instant_of(par, joint, y, reduced_equations(par, joint, y, p), stuck, sides)
        _write_body_a(par, joint, p, i, k)
        _write_free_axes(y, 17, i, k)
    else:
        i = instant(par, joint, t, y, stuck, sides)
        _write_free_axes(y, 4, i, k)
    return i


@allocating_function
def stage_derivatives(
    par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides, k: Array
) -> bool:
    """Write dy/dt to ``k`` for a stage; returns whether slip jams."""
    set_time(par, joint, t)
    if joint[coordinates.FIXED_SHAFT] == 0.0:
        return derivatives_at(par, joint, t, y, stuck, sides, k).jammed
    i = instant_of(par, joint, y, reduced_on_shaft(joint, y), stuck, sides)
    _write_free_axes(y, 4, i, k)
    return i.jammed
