"""The rates of the coordinates, and of six integrals behind them: |s|, FN, f1f, m1f, f1, m1."""

from typing import Final

from cylconn_ros.core import model
from cylconn_ros.core.compiled import inline, jit
from cylconn_ros.core.friction import Array
from cylconn_ros.core.vectors import add, cross, scale
from cylconn_ros.methods import minimal_place as at
from cylconn_ros.methods.minimal_forces import Instant, Sides, instant
from cylconn_ros.methods.minimal_place import acceleration, wrench_on_b

# integrals behind the coordinates
SLIPPED: Final = 0
NORMAL: Final = 1
FRICTION: Final = 2  # f1f, m1f
TOTAL: Final = 4  # f1, m1
INTEGRALS: Final = 6


@inline
def size_of(joint: Array) -> int:
    """Number of coordinates."""
    return 17 if joint[at.MODE] == at.BOTH_FREE else 4


@jit
def rates_at(
    par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides, k: Array
) -> Instant:
    """dy/dt into ``k``."""
    i = instant(par, joint, t, y, stuck, sides)
    k[at.LENGTH], k[at.ANGLE] = y[at.SLIDE], y[at.SPIN]
    k[at.SLIDE], k[at.SPIN] = i.acceleration
    n = 4
    if joint[at.MODE] == at.BOTH_FREE:
        n = 17
        a = i.place.a
        x, y_, z, w = a.orientation
        sx, sy, sz = a.spin
        model.put(k, at.A_COM, a.velocity)
        k[at.A_TURN] = 0.5 * (sx * w + sy * z - sz * y_)
        k[at.A_TURN + 1] = 0.5 * (sy * w + sz * x - sx * z)
        k[at.A_TURN + 2] = 0.5 * (sz * w + sx * y_ - sy * x)
        k[at.A_TURN + 3] = -0.5 * (sx * x + sy * y_ + sz * z)
        force, moment = wrench_on_b(i.place, i.total, i.constraint)
        torque = add(cross(i.place.frame.arm_a, force), moment)
        body = model.body(par, model.BODY_A)
        va, wa = acceleration(par, joint, body, a, 0, scale(-1.0, force), scale(-1.0, torque))
        model.put(k, at.A_VELOCITY, va)
        model.put(k, at.A_SPIN, wa)
    k[n], k[n + 1] = i.slip, i.normal
    k[n + 2], k[n + 3] = i.friction
    k[n + 4], k[n + 5] = i.total
    return i
