r"""The lean equations: B aligned on an A that does not turn. A rotation and a few products.

Seen from B's own axes T, which turn about e1 with the angle alpha, nothing of B changes. What
gravity and loads do turns once around with alpha, what the spin does goes with its square, and the
wrench meets the same inertia everywhere:

    (l'', alpha'')  = free + S (f1, m1)                      S, by_f1, by_m1 constant
    (f2 f3 m2 m3)_T = base + by_f1 f1 + by_m1 m1
    (free, base)    = k0 + k1 cos alpha + k2 sin alpha + k3 w1^2

The constants are read off the general equations (methods/minimal/coordinates.py) at four places, so that
there is one derivation. FN, of the lengths of (f2 f3) and (m2 m3), is the same in T as in the axes
of a.
"""

import math

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.coordinates import Reduced, place, reduced

FAST = 1e8  # rad/s: beside what it does, nothing else counts


@inline_function
def _turned_back(c: float, s: float, x: Four) -> Four:
    """Two vectors across e1, from the axes of a to those that are turned by the angle of c, s."""
    return (
        c * x[0] + s * x[1], c * x[1] - s * x[0], c * x[2] + s * x[3], c * x[3] - s * x[2],
    )  # fmt: skip


@device_function
def prepare(par: Array, joint: Array, y: Array) -> None:
    """Fill the constants in ``joint`` where the lean equations hold."""
    joint[at.SHAFT] = 0.0
    turning = joint[at.PRESCRIBED + 10], joint[at.PRESCRIBED + 11], joint[at.PRESCRIBED + 12]
    tilt = joint[at.SWING + 1], joint[at.SWING + 2]
    if joint[at.MODE] != at.A_MOVES or turning != (0.0, 0.0, 0.0) or tilt != (0.0, 0.0):
        return
    angle, slide, spin = y[at.ANGLE], y[at.SLIDE], y[at.SPIN]
    y[at.SLIDE] = 0.0
    for case in range(4):  # alpha = 0, pi/2, pi, and 0 at great spin
        y[at.ANGLE] = 0.5 * math.pi * (case % 3)
        y[at.SPIN] = FAST if case == 3 else 0.0
        r = reduced(par, joint, y, place(par, joint, 0.0, y))
        c, s = (1.0, 0.0) if case % 3 == 0 else ((0.0, 1.0) if case == 1 else (-1.0, 0.0))
        base = _turned_back(c, s, r.base)
        for k in range(6):
            row = at.TURNING + 4 * k
            x = r.free[k] if k < 2 else base[k - 2]
            if case == 0:
                joint[row] = x
            elif case == 1:
                joint[row + 2] = x
            elif case == 2:
                joint[row], joint[row + 1] = 0.5 * (joint[row] + x), 0.5 * (joint[row] - x)
                joint[row + 2] -= joint[row]
            else:
                joint[row + 3] = (x - joint[row] - joint[row + 1]) / (FAST * FAST)
        if case == 0:
            for k in range(3):
                joint[at.MOBILITY + k] = r.s[k]
            for k in range(4):
                joint[at.BY_F1 + k], joint[at.BY_M1 + k] = r.by_f1[k], r.by_m1[k]
    y[at.ANGLE], y[at.SLIDE], y[at.SPIN] = angle, slide, spin
    joint[at.SHAFT] = 1.0


@inline_function
def _sum(joint: Array, k: int, c: float, s: float, square: float) -> float:
    row = at.TURNING + 4 * k
    return joint[row] + joint[row + 1] * c + joint[row + 2] * s + joint[row + 3] * square


@inline_function
def reduced_on_shaft(joint: Array, y: Array) -> Reduced:
    """The equations of motion, the constraint's reactions in B's axes T."""
    c, s = math.cos(y[at.ANGLE]), math.sin(y[at.ANGLE])
    square = y[at.SPIN] * y[at.SPIN]
    return Reduced(
        (_sum(joint, 0, c, s, square), _sum(joint, 1, c, s, square)),
        model.vector(joint, at.MOBILITY),
        (
            _sum(joint, 2, c, s, square),
            _sum(joint, 3, c, s, square),
            _sum(joint, 4, c, s, square),
            _sum(joint, 5, c, s, square),
        ),
        model.quaternion(joint, at.BY_F1),
        model.quaternion(joint, at.BY_M1),
    )
