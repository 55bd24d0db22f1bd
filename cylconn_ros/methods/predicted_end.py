"""Newton correction of the target by the predicted end of the step, for fast rotation.

The extrapolation q^ = q + h v assumes constant angular velocity, an error of (|w| h)^3 times the
arms. For |w| h between MIN_TURN and MAX_TURN the end of the step is predicted with the integrator
of the plant (core/rigid_body.py), NEWTON_ITERATIONS times, each time under

    Lambda_p = the wrench for the target so far, with f1 and m1 of the last step

so that w_p = J~ v_p has w_p,c = target_c. With the end q_p, v_p and its constraint error e_p,

    bracket  = J(q_p) v_p - w_p
    target_c = w_p,c - [J(q_p) v_p + k e_p / h]_c / (1 + k/2)

is a Newton step for J(q+) v+ + k e(q+) / h = 0 at the true end of the step, with the matrix of q~.
For slow rotation and k = 2 it equals the target that it replaces; an error is multiplied by
(1 - k/2) / (1 + k/2) per step. -k e_p/h is limited like every correction. If a step leaves more of
J(q+) v+ + k e(q+) / h than there was before the first, the target stays as it was then.

If both bodies rotate faster than MAX_TURN, one wrench per sample cannot hold the constraint: the
bracket, which would add energy, is omitted, and the target is -e/h alone.
"""

from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.driven_acceleration import driven_acceleration
from cylconn_ros.core.friction import Array
from cylconn_ros.core.held_step import Load, held_step, load_torque, load_turns
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import Frame, Twist, frame, out_of_swung, relative_twist
from cylconn_ros.core.relative_state import RelativeState, constraint_error
from cylconn_ros.core.rigid_body import Body, Motion, angular_acceleration, exact_step
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.vectors import (
    Vector,
    add,
    add_scaled,
    cross,
    norm,
    out_of,
    scale,
    turned,
)

Two = tuple[Vector, Vector]

MIN_TURN = 0.1  # |w| h, rad, above which the prediction is worth its cost
MAX_TURN = 0.6  # |w| h, rad, up to which it helps
MAX_PREDICTED_TURN = 1.5  # rad, rotation under Lambda_p; above it the target is kept
NEWTON_ITERATIONS = 3
GAIN = 5.0  # k


class PredictedEnd(NamedTuple):
    """The end of the step: J(q_p) v_p and e_p; ``known``: whether it was predicted."""

    twist: Twist
    error: Four
    known: bool


@inline_function
def _load(par: Array, body: Body, sample: Array, at: int) -> Load:
    """The load at ``at`` and gravity."""
    weight = scale(body.mass if body.free else 0.0, model.vector(par, model.GRAVITY))
    return Load(model.vector(sample, at), model.vector(sample, at + 3), weight)


@device_function
def _end(
    body: Body, m: Motion, force: Vector, torque: Vector, load: Load, acceleration: Two, h: float
) -> Motion:
    """The motion after h under a wrench about the mass centre, as the plant moves the body."""
    if load_turns(body, load):
        return held_step(body, m, force, torque, load, h, False).end
    torque = add(torque, load_torque(body, m.orientation, load))
    end = exact_step(body, m, add(add(force, load.force), load.weight), torque, h)
    if body.free:
        return end
    linear, angular = acceleration
    return Motion(
        add_scaled(end.com, 0.5 * h * h, linear),
        turned(m.orientation, scale(h, add_scaled(m.spin, 0.5 * h, angular))),
        add_scaled(m.velocity, h, linear),
        add_scaled(m.spin, h, angular),
    )


@inline_function
def _turn_angle(body: Body, m: Motion, torque: Vector, h: float) -> float:
    """Estimated rotation of the body in the step, rad."""
    if not body.free:
        return h * norm(m.spin)
    rate = angular_acceleration(body, m.orientation, m.spin, torque)
    return h * (norm(m.spin) + 0.5 * h * norm(rate))


@device_function
def predict_end(
    par: Array, mem: Array, sample: Array, o: RelativeState, f: Frame, force: Vector,
    moment: Vector, h: float,
) -> PredictedEnd:  # fmt: skip
    """The end under a force (axes of a) and a moment (N) on B at node b, applied as in ``f``."""
    push, turn = out_of(f.axes, force), out_of_swung(f, moment)
    turn_a = scale(-1.0, add(cross(f.arm_a, push), turn))
    turn_b = add(cross(f.arm_b, push), turn)
    load_a = _load(par, o.body_a, sample, layout.A_LOAD)
    load_b = _load(par, o.body_b, sample, layout.B_LOAD)
    far_a = _turn_angle(
        o.body_a, o.a, add(turn_a, load_torque(o.body_a, o.a.orientation, load_a)), h
    )
    far_b = _turn_angle(
        o.body_b, o.b, add(turn_b, load_torque(o.body_b, o.b.orientation, load_b)), h
    )
    if not max(far_a, far_b) < MAX_PREDICTED_TURN:
        return PredictedEnd(o.twist, o.error, False)
    a = _end(
        o.body_a, o.a, scale(-1.0, push), turn_a, load_a, driven_acceleration(mem, model.LAST_A), h
    )
    b = _end(o.body_b, o.b, push, turn_b, load_b, driven_acceleration(mem, model.LAST_B), h)
    twist = relative_twist(frame(o.nodes, a, b), a, b)
    return PredictedEnd(twist, constraint_error(mem, o.nodes, a, b), True)
