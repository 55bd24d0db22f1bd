"""The two halves of a step of ``impulse`` for connectors that share bodies.

With several connectors the wrench of each moves the others' bodies. So the step is split where it
needs to know of them: :func:`look` says what a connector is before anybody acts, as numbers, and
:func:`answer` finishes its step once the constraints of all are eliminated together and the others'
friction is known (connector/group.py). Everything between is what one alone does.
"""

from typing import Final

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function, kernel
from cylconn_ros.core.kinematics import Frame, Twist, relative_twist
from cylconn_ros.core.relative_state import observe
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.vectors import Quaternion, Vector, into, matrix, out_of, times
from cylconn_ros.methods import impulse
from cylconn_ros.methods.complementarity import Reduced
from cylconn_ros.methods.dispatch import begun, ended
from cylconn_ros.methods.free_axes import available

# --- LOOKED: what a connector is before anybody acts
JACOBIAN_A: Final = 0  # 6 x 6, J~ of A: columns are its velocity and spin, world axes
JACOBIAN_B: Final = 36
INVERSE_A: Final = 72  # 3 x 3, inverse inertia about the mass centre, world axes, at q~
INVERSE_B: Final = 81
FREE: Final = 90  # J~ vf, 6
TURNING: Final = 96  # 6
TARGET: Final = 102  # 4
MEASURED: Final = 106  # v1, w1 of the sample, 2
NLOOKED: Final = 108

# --- GIVEN: the constraints eliminated and the others' part in, as methods/complementarity.py has it
BASE: Final = 0  # 4
BY_F1: Final = 4  # 4
BY_M1: Final = 8  # 4
FREE_SLIP: Final = 12  # 2
A: Final = 14  # 3
NGIVEN: Final = 17

_ZERO: Final = (0.0, 0.0, 0.0)
_STILL_AT: Final = (0.0, 0.0, 0.0, 1.0)


@inline_function
def _unit(k: int) -> Vector:
    """The axis number k of three; none for another number."""
    return (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)


@inline_function
def _write_jacobians(f: Frame, looked: Array) -> None:
    still = Motion(_ZERO, _STILL_AT, _ZERO, _ZERO)
    for k in range(6):
        unit = Motion(_ZERO, _STILL_AT, _unit(k), _unit(k - 3))
        a, b = relative_twist(f, unit, still), relative_twist(f, still, unit)
        for i in range(3):
            looked[JACOBIAN_A + 6 * i + k], looked[JACOBIAN_A + 6 * (i + 3) + k] = a.v[i], a.w[i]
            looked[JACOBIAN_B + 6 * i + k], looked[JACOBIAN_B + 6 * (i + 3) + k] = b.v[i], b.w[i]


@inline_function
def _write_inverse(body: Body, q: Quaternion, looked: Array, at: int) -> None:
    axes = matrix(q)
    for k in range(3):
        column = out_of(axes, times(body.inverse_inertia, into(axes, _unit(k))))
        for i in range(3):
            looked[at + 3 * i + k] = column[i] if body.free else 0.0


@inline_function
def _put_twist(a: Array, at: int, twist: Twist) -> None:
    model.put(a, at, twist.v)
    model.put(a, at + 3, twist.w)


@kernel
def look(par: Array, mem: Array, sample: Array, h: float, out: Array, looked: Array) -> int:
    """Write ``looked`` (NLOOKED,) for a sample; the status, as of a step.

    ``mem`` is advanced as by a step and is to be a copy, ``out`` is for its own use.
    """
    status = begun(par, mem, sample, h, out)
    if status != out_at.OK:
        return status
    o = observe(par, mem, sample, out)
    s = impulse.frozen(par, mem, sample, o, h, False)
    _write_jacobians(s.acting, looked)
    _write_inverse(o.body_a, s.a.middle.orientation, looked, INVERSE_A)
    _write_inverse(o.body_b, s.b.middle.orientation, looked, INVERSE_B)
    _put_twist(looked, FREE, s.free)
    _put_twist(looked, TURNING, s.turning)
    for k in range(4):
        looked[TARGET + k] = s.target[k]
    looked[MEASURED], looked[MEASURED + 1] = o.twist.v[0], o.twist.w[0]
    return out_at.OK


@kernel
def answer(par: Array, mem: Array, sample: Array, h: float, given: Array, out: Array) -> int:
    """Answer a sample with the constraints of all eliminated: ``given`` (NGIVEN,); the status.

    ``mem`` and ``out`` as of a step; on a copy of ``mem`` it is a trial.
    """
    status = begun(par, mem, sample, h, out)
    if status != out_at.OK:
        return status
    o = observe(par, mem, sample, out)
    s = impulse.frozen(par, mem, sample, o, h, False)
    r = Reduced(
        (given[0], given[1], given[2], given[3]),
        (given[4], given[5], given[6], given[7]),
        (given[8], given[9], given[10], given[11]),
        (given[12], given[13]),
        (given[14], given[15], given[16]),
    )
    av = available(par, mem, o, r, h, model.output(par).semi_implicit)
    flags = impulse.answer(par, mem, out, o, s, av, h)
    out[out_at.RESIDUAL] = av.solved.residual  # of its own part; the constraints are the group's
    return ended(par, mem, sample, h, flags, out)
