r"""Fixed-base reduction: closed-form equations of motion for B aligned on a non-rotating A.

In B's own axes T, which rotate about e1 with the angle alpha, the mass properties of B are
constant. The terms of gravity and loads are first harmonics of alpha, those of the spin are
proportional to its square, and the mobility is constant:

    (l'', alpha'')  = free + S (f1, m1)                      S, by_f1, by_m1 constant
    (f2 f3 m2 m3)_T = base + by_f1 f1 + by_m1 m1
    (free, base)    = k0 + k1 cos alpha + k2 sin alpha + k3 w1^2

The constants are evaluated from the general equations (methods/minimal/coordinates.py) at four
configurations, so that there is one derivation. FN, a function of the norms of (f2 f3) and (m2 m3),
is the same in T as in the axes of a.
"""

import math

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function, inline_function
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.coordinates import (
    ReducedEquations,
    configuration,
    reduced_equations,
)

HIGH_SPIN = 1e8  # rad/s, at which the terms of the spin dominate


@inline_function
def _into_body_axes(c: float, s: float, x: Four) -> Four:
    """Two vectors normal to e1, from the axes of a to the axes rotated by the angle of c, s."""
    return (
        c * x[0] + s * x[1], c * x[1] - s * x[0], c * x[2] + s * x[3], c * x[3] - s * x[2],
    )  # fmt: skip


@allocating_function
def prepare(par: Array, joint: Array, y: Array) -> None:
    """Fill the constants in ``joint`` if the reduction holds."""
    joint[coordinates.FIXED_SHAFT] = 0.0
    turning = (
        joint[coordinates.PRESCRIBED + 10],
        joint[coordinates.PRESCRIBED + 11],
        joint[coordinates.PRESCRIBED + 12],
    )
    tilt = joint[coordinates.SWING + 1], joint[coordinates.SWING + 2]
    if (
        joint[coordinates.MODE] != coordinates.A_PRESCRIBED
        or joint[coordinates.OVER_TIME] != 0.0
        or turning != (0.0, 0.0, 0.0)
        or tilt != (0.0, 0.0)
    ):
        return
    angle, slide, spin = y[coordinates.ANGLE], y[coordinates.SLIDE], y[coordinates.SPIN]
    y[coordinates.SLIDE] = 0.0
    for case in range(4):  # alpha = 0, pi/2, pi, and 0 at great spin
        y[coordinates.ANGLE] = 0.5 * math.pi * (case % 3)
        y[coordinates.SPIN] = HIGH_SPIN if case == 3 else 0.0
        r = reduced_equations(par, joint, y, configuration(par, joint, 0.0, y))
        c, s = (1.0, 0.0) if case % 3 == 0 else ((0.0, 1.0) if case == 1 else (-1.0, 0.0))
        base = _into_body_axes(c, s, r.base)
        for k in range(6):
            row = coordinates.HARMONICS + 4 * k
            x = r.free[k] if k < 2 else base[k - 2]
            if case == 0:
                joint[row] = x
            elif case == 1:
                joint[row + 2] = x
            elif case == 2:
                joint[row], joint[row + 1] = 0.5 * (joint[row] + x), 0.5 * (joint[row] - x)
                joint[row + 2] -= joint[row]
            else:
                joint[row + 3] = (x - joint[row] - joint[row + 1]) / (HIGH_SPIN * HIGH_SPIN)
        if case == 0:
            for k in range(3):
                joint[coordinates.MOBILITY + k] = r.s[k]
            for k in range(4):
                joint[coordinates.BY_F1 + k], joint[coordinates.BY_M1 + k] = r.by_f1[k], r.by_m1[k]
    y[coordinates.ANGLE], y[coordinates.SLIDE], y[coordinates.SPIN] = angle, slide, spin
    joint[coordinates.FIXED_SHAFT] = 1.0


@inline_function
def _harmonic(joint: Array, k: int, c: float, s: float, square: float) -> float:
    row = coordinates.HARMONICS + 4 * k
    return joint[row] + joint[row + 1] * c + joint[row + 2] * s + joint[row + 3] * square


@inline_function
def reduced_on_shaft(joint: Array, y: Array) -> ReducedEquations:
    """The equations of motion, with the constraint reactions in B's axes T."""
    c, s = math.cos(y[coordinates.ANGLE]), math.sin(y[coordinates.ANGLE])
    square = y[coordinates.SPIN] * y[coordinates.SPIN]
    return ReducedEquations(
        (_harmonic(joint, 0, c, s, square), _harmonic(joint, 1, c, s, square)),
        model.vector(joint, coordinates.MOBILITY),
        (
            _harmonic(joint, 2, c, s, square),
            _harmonic(joint, 3, c, s, square),
            _harmonic(joint, 4, c, s, square),
            _harmonic(joint, 5, c, s, square),
        ),
        model.quaternion(joint, coordinates.BY_F1),
        model.quaternion(joint, coordinates.BY_M1),
    )
