"""The end of a step foreseen: what the geometry of fast turning adds, beyond q^ = q + h v.

q^ takes the spins as constant over the step, an error of (|w| h)^3 times the arms. Between TURNS
and MOST_TURNS of |w| h the end is foreseen as the plant will compute it (core/rigid_body.py), PASSES
times over, each time under

    Lambda_p = the wrench for the target so far, with f1 and m1 of the last answer

so that w_p = J~ v_p has w_p,c = target_c. With q_p, v_p the end and e_p its violation,

    bracket  = J(q_p) v_p - w_p
    target_c = w_p,c - [J(q_p) v_p + k e_p / h]_c / (1 + k/2)

is a step of Newton's method for J(q+) v+ + k e(q+) / h = 0, asked of the true end, with the matrix
of q~. For slow turning and k = 2 it is the target that it replaces; a violation is multiplied by
(1 - k/2) / (1 + k/2) a step. -k e_p/h is limited as every correction is.

Beyond, with both bodies turning faster, no wrench a sample holds the constraint: the bracket, which
would feed the motion there, is left out, and -e/h alone is the target.
"""

from typing import NamedTuple

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import Frame, Twist, frame, out_of_swung, relative_twist
from cylconn_ros.core.relative_state import Observed, violation
from cylconn_ros.core.rigid_body import Body, Motion, angular_acceleration, exact_step
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.vectors import (
    Vector,
    add,
    cross,
    matrix,
    norm,
    out_of,
    scale,
    sub,
)

TURNS = 0.1  # |w| h from which on it is worth its cost
MOST_TURNS = 0.6  # and up to which it helps
MOST_IN_STEP = 1.5  # rad by which a body may turn under Lambda_p; beyond, the target so far stays
PASSES = 3
GAIN = 5.0  # k


class End(NamedTuple):
    """The end of the step: J(q_p) v_p and e_p; ``known``: whether it could be foreseen."""

    twist: Twist
    error: Four
    known: bool


@inline_function
def _pushed(
    par: Array, body: Body, m: Motion, sample: Array, at: int, force: Vector, torque: Vector
) -> tuple[Vector, Vector]:
    """Force and torque about the mass centre with gravity and the load at ``at``."""
    load = model.vector(sample, at)
    arm = out_of(matrix(m.orientation), body.com)
    torque = add(torque, sub(model.vector(sample, at + 3), cross(arm, load)))
    weight = scale(body.mass if body.free else 0.0, model.vector(par, model.GRAVITY))
    return add(add(force, load), weight), torque


@inline_function
def _turn(body: Body, m: Motion, torque: Vector, h: float) -> float:
    """By how much the body turns in the step, rad, roughly."""
    if not body.free:
        return h * norm(m.spin)
    rate = angular_acceleration(body, m.orientation, m.spin, torque)
    return h * (norm(m.spin) + 0.5 * h * norm(rate))


@device_function
def end_of(
    par: Array, mem: Array, sample: Array, o: Observed, f: Frame, force: Vector, moment: Vector,
    h: float,
) -> End:  # fmt: skip
    """The end under a force (axes of a) and a moment (N) on B at node b, applied as in ``f``."""
    push, turn = out_of(f.axes, force), out_of_swung(f, moment)
    turn_a = scale(-1.0, add(cross(f.arm_a, push), turn))
    turn_b = add(cross(f.arm_b, push), turn)
    push_a, turn_a = _pushed(par, o.body_a, o.a, sample, out_at.A_LOAD, scale(-1.0, push), turn_a)
    push_b, turn_b = _pushed(par, o.body_b, o.b, sample, out_at.B_LOAD, push, turn_b)
    if not max(_turn(o.body_a, o.a, turn_a, h), _turn(o.body_b, o.b, turn_b, h)) < MOST_IN_STEP:
        return End(o.twist, o.error, False)
    a = exact_step(o.body_a, o.a, push_a, turn_a, h)
    b = exact_step(o.body_b, o.b, push_b, turn_b, h)
    twist = relative_twist(frame(o.nodes, a, b), a, b)
    return End(twist, violation(mem, o.nodes, a, b), True)
