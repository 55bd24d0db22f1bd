"""The step of method impulse in two parts, for connectors that share bodies.

The wrench of each connector moves the bodies of the others, so that the step is split:
:func:`prepare_coupled` computes the quantities of a connector before wrenches act, and
:func:`complete_coupled` completes the step after the constraints of all connectors are eliminated
together and the friction of the others is known (connector/group.py). Both use the functions of the
step of a single connector.
"""

from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.free_gain import store_step, update_gain
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function, kernel
from cylconn_ros.core.kinematics import Frame, Twist, relative_twist
from cylconn_ros.core.relative_state import measure
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.vectors import Quaternion, Vector, into, matrix, out_of, times
from cylconn_ros.methods import impulse
from cylconn_ros.methods.dispatch import begin, finish
from cylconn_ros.methods.free_axes.complementarity import ReducedStep
from cylconn_ros.methods.free_axes.step import solve_free_axes

# --- prepared (NPREPARED,): quantities of a connector before wrenches act ---
JACOBIAN_A: Final = 0  # 6 x 6, J~ of A: columns are its velocity and spin, world axes
JACOBIAN_B: Final = 36
INVERSE_A: Final = 72  # 3 x 3, inverse inertia about the mass centre, world axes, at q~
INVERSE_B: Final = 81
FREE: Final = 90  # J~ vf, 6
JACOBIAN_CHANGE: Final = 96  # 6
TARGET: Final = 102  # 4
MEASURED: Final = 106  # v1, w1 of the sample, 2
NPREPARED: Final = 108

# --- reduced (NREDUCED,): ReducedStep of methods/free_axes/complementarity.py ---
BASE: Final = 0  # 4
BY_F1: Final = 4  # 4
BY_M1: Final = 8  # 4
FREE_SLIP: Final = 12  # 2
A: Final = 14  # 3
NREDUCED: Final = 17

_ZERO: Final = (0.0, 0.0, 0.0)
_IDENTITY: Final = (0.0, 0.0, 0.0, 1.0)


@inline_function
def _unit(k: int) -> Vector:
    """The unit vector k of three; zero for another number."""
    return (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)


@inline_function
def _write_jacobians(f: Frame, prepared: Array) -> None:
    still = Motion(_ZERO, _IDENTITY, _ZERO, _ZERO)
    for k in range(6):
        unit = Motion(_ZERO, _IDENTITY, _unit(k), _unit(k - 3))
        a, b = relative_twist(f, unit, still), relative_twist(f, still, unit)
        for i in range(3):
            prepared[JACOBIAN_A + 6 * i + k], prepared[JACOBIAN_A + 6 * (i + 3) + k] = (
                a.v[i],
                a.w[i],
            )
            prepared[JACOBIAN_B + 6 * i + k], prepared[JACOBIAN_B + 6 * (i + 3) + k] = (
                b.v[i],
                b.w[i],
            )


@inline_function
def _write_inverse(body: Body, q: Quaternion, prepared: Array, at: int) -> None:
    axes = matrix(q)
    for k in range(3):
        column = out_of(axes, times(body.inverse_inertia, into(axes, _unit(k))))
        for i in range(3):
            prepared[at + 3 * i + k] = column[i] if body.free else 0.0


@inline_function
def _put_twist(a: Array, at: int, twist: Twist) -> None:
    model.write_vector(a, at, twist.v)
    model.write_vector(a, at + 3, twist.w)


@kernel
def prepare_coupled(
    par: Array, mem: Array, sample: Array, h: float, out: Array, prepared: Array
) -> int:
    """Write ``prepared`` (NPREPARED,) for a sample; returns the status of a step.

    ``mem`` is updated as by a step, so that the caller passes a copy; ``out`` is scratch space.
    """
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    o = measure(par, mem, sample, out)
    s = impulse.prepare_step(par, mem, sample, o, h, False)
    _write_jacobians(s.acting, prepared)
    _write_inverse(o.body_a, s.a.middle.orientation, prepared, INVERSE_A)
    _write_inverse(o.body_b, s.b.middle.orientation, prepared, INVERSE_B)
    _put_twist(prepared, FREE, s.free)
    _put_twist(prepared, JACOBIAN_CHANGE, s.jacobian_change)
    for k in range(4):
        prepared[TARGET + k] = s.target[k]
    prepared[MEASURED], prepared[MEASURED + 1] = o.twist.v[0], o.twist.w[0]
    return layout.OK


@kernel
def complete_coupled(
    par: Array, mem: Array, sample: Array, h: float, reduced: Array, out: Array
) -> int:
    """Complete the step with the constraints of all eliminated: ``reduced`` (NREDUCED,).

    ``mem`` and ``out`` as of a step; with a copy of ``mem`` it is a trial step. Returns the status.
    """
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    o = measure(par, mem, sample, out)
    s = impulse.prepare_step(par, mem, sample, o, h, False)
    r = ReducedStep(
        (reduced[0], reduced[1], reduced[2], reduced[3]),
        (reduced[4], reduced[5], reduced[6], reduced[7]),
        (reduced[8], reduced[9], reduced[10], reduced[11]),
        (reduced[12], reduced[13]),
        (reduced[14], reduced[15], reduced[16]),
    )
    update_gain(par, mem, o.twist.v[0], o.twist.w[0], h)
    av = solve_free_axes(par, mem, o, r, h, model.output(par).semi_implicit)
    flags = impulse.write_outputs(par, mem, out, o, s, av, h)
    store_step(par, mem, r.free, r.a, flags & layout.LIMITED != 0)
    out[layout.RESIDUAL] = (
        av.solved.residual
    )  # of its own part; connector/group.py adds that of the constraints
    return finish(par, mem, sample, h, flags, out)
