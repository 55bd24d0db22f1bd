"""The constrained rows of method impulse where the simulator keeps the constraint.

With ``constraint: simulator`` the reactions are those of a constraint that holds exactly, at both
ends of the step. They are known to the connector and are not sent:

    w+_c = -[J(q^) v^ - J~ v^]_c        J(q^) v+ = 0, without feedback of measured violations

q^, v^ is the end of the step as predicted with the whole wrench of the last step, its reactions
included. As no violation is fed back, what q + h v leaves out is not corrected by the next step:
FN would be first order only.
"""

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import Frame, Twist, frame, relative_twist
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.vectors import (
    add,
    add_scaled,
    into,
    matrix,
    out_of,
    scale,
    sub,
    times,
    turned,
)


@inline_function
def _end(body: Body, m: Motion, free: Motion, mem: Array, last: int, h: float) -> Motion:
    """q^, v^: the free step's end velocity plus the last wrench at ``last``."""
    velocity, spin = free.velocity, free.spin
    if body.free:
        axes = matrix(free.orientation)
        torque = into(axes, model.vector(mem, last + 3))
        velocity = add_scaled(velocity, h * body.inverse_mass, model.vector(mem, last))
        spin = add_scaled(spin, h, out_of(axes, times(body.inverse_inertia, torque)))
    return Motion(
        add_scaled(m.com, 0.5 * h, add(m.velocity, velocity)),
        turned(m.orientation, scale(0.5 * h, add(m.spin, spin))),
        velocity,
        spin,
    )


@device_function
def predicted_jacobian_change(
    mem: Array, o: RelativeState, f: Frame, free_a: Motion, free_b: Motion, h: float, explicit: bool
) -> Twist:
    """J(q^) v^ - J~ v^. f: q~. free_a, free_b: orientations in q~, velocities at the free end.

    Zero for a semi-implicit plant (``explicit``), whose q~ is the configuration q.
    """
    if explicit:
        return Twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    a = _end(o.body_a, o.a, free_a, mem, model.LAST_A, h)
    b = _end(o.body_b, o.b, free_b, mem, model.LAST_B, h)
    there, here = relative_twist(frame(o.nodes, a, b), a, b), relative_twist(f, a, b)
    return Twist(sub(there.v, here.v), sub(there.w, here.w))


@inline_function
def kept_target(jacobian_change: Twist) -> Four:
    """target_c."""
    v, w = jacobian_change.v, jacobian_change.w
    return (-v[1], -v[2], -w[1], -w[2])
