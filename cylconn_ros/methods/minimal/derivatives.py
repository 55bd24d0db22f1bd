"""The rates of the coordinates, and of six integrals behind them: |s|, FN, f1f, m1f, f1, m1."""

from typing import Final

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.vectors import add, cross, scale
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.coordinates import (
    Place,
    acceleration,
    place,
    reduced,
    wrench_on_b,
)
from cylconn_ros.methods.minimal.fixed_shaft import reduced_on_shaft
from cylconn_ros.methods.minimal.forces import Instant, Sides, instant, instant_of

# integrals behind the coordinates
SLIPPED: Final = 0
NORMAL: Final = 1
FRICTION: Final = 2  # f1f, m1f
TOTAL: Final = 4  # f1, m1
INTEGRALS: Final = 6


@inline_function
def size_of(joint: Array) -> int:
    """Number of coordinates."""
    return 17 if joint[at.MODE] == at.BOTH_FREE else 4


@device_function
def _put_a(par: Array, joint: Array, p: Place, i: Instant, k: Array) -> None:
    """Of pose and twist of A, which the wrench moves too."""
    x, y, z, w = p.a.orientation
    sx, sy, sz = p.a.spin
    model.put(k, at.A_COM, p.a.velocity)
    k[at.A_TURN] = 0.5 * (sx * w + sy * z - sz * y)
    k[at.A_TURN + 1] = 0.5 * (sy * w + sz * x - sx * z)
    k[at.A_TURN + 2] = 0.5 * (sz * w + sx * y - sy * x)
    k[at.A_TURN + 3] = -0.5 * (sx * x + sy * y + sz * z)
    force, moment = wrench_on_b(p, i.total, i.constraint)
    torque = add(cross(p.frame.arm_a, force), moment)
    body = model.body(par, model.BODY_A)
    va, wa = acceleration(par, joint, body, p.a, 0, scale(-1.0, force), scale(-1.0, torque))
    model.put(k, at.A_VELOCITY, va)
    model.put(k, at.A_SPIN, wa)


@inline_function
def _put(y: Array, n: int, i: Instant, k: Array) -> None:
    """Of slide and spin, and of the integrals behind n coordinates."""
    k[at.LENGTH], k[at.ANGLE] = y[at.SLIDE], y[at.SPIN]
    k[at.SLIDE], k[at.SPIN] = i.acceleration
    k[n], k[n + 1] = i.slip, i.normal
    k[n + 2], k[n + 3] = i.friction
    k[n + 4], k[n + 5] = i.total


@device_function
def rates_at(
    par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides, k: Array
) -> Instant:
    """dy/dt into ``k``."""
    if joint[at.MODE] == at.BOTH_FREE:
        p = place(par, joint, t, y)
        i = instant_of(par, joint, y, reduced(par, joint, y, p), stuck, sides)
        _put_a(par, joint, p, i, k)
        _put(y, 17, i, k)
    else:
        i = instant(par, joint, t, y, stuck, sides)
        _put(y, 4, i, k)
    return i


@device_function
def rates_of_stage(
    par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides, k: Array
) -> bool:
    """As :func:`rates_at`, where it only matters whether it jams: the lean equations in haste."""
    if joint[at.SHAFT] == 0.0:
        return rates_at(par, joint, t, y, stuck, sides, k).jammed
    i = instant_of(par, joint, y, reduced_on_shaft(joint, y), stuck, sides)
    _put(y, 4, i, k)
    return i.jammed
