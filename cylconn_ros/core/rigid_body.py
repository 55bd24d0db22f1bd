"""A rigid body: mass properties, motion, and one exact step under a held wrench."""

from typing import NamedTuple

from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.vectors import (
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    add,
    add_scaled,
    cross,
    into,
    matrix,
    norm,
    out_of,
    scale,
    sub,
    times,
    turned,
)


class Body(NamedTuple):
    """Mass properties, body axes, about the mass centre; infinite inertia: inverses zero."""

    free: bool  # mass and inertia are known: forces accelerate it
    mass: float
    inverse_mass: float
    com: Vector  # mass centre from the body frame's origin
    inertia: Symmetric
    inverse_inertia: Symmetric


class Motion(NamedTuple):
    """Pose and twist of a body at its mass centre, world axes."""

    com: Vector
    orientation: Quaternion
    velocity: Vector
    spin: Vector  # angular velocity


@inline_function
def at_com(body: Body, position: Vector, orientation: Quaternion, v: Vector, w: Vector) -> Motion:
    """The motion of the mass centre for position and velocity ``v`` of the body frame's origin."""
    arm = out_of(matrix(orientation), body.com)
    return Motion(add(position, arm), orientation, add(v, cross(w, arm)), w)


@inline_function
def angular_acceleration(body: Body, orientation: Quaternion, w: Vector, torque: Vector) -> Vector:
    """I dw/dt = torque - w x I w, world axes."""
    axes: Matrix = matrix(orientation)
    wb = into(axes, w)
    momentum_rate = sub(into(axes, torque), cross(wb, times(body.inertia, wb)))
    return out_of(axes, times(body.inverse_inertia, momentum_rate))


@device_function
def exact_step(body: Body, motion: Motion, force: Vector, torque: Vector, h: float) -> Motion:
    """The motion after h under a force and a torque about the mass centre, both held in world axes.

    Translation and the angular momentum, L + h torque, are exact. The orientation is integrated
    with the fourth-order Runge-Kutta-Munthe-Kaas method in steps of at most 0.1 rad.
    """
    if not body.free:  # keeps its twist
        return Motion(
            add_scaled(motion.com, h, motion.velocity),
            turned(motion.orientation, scale(h, motion.spin)),
            motion.velocity,
            motion.spin,
        )
    a = scale(body.inverse_mass, force)
    q = motion.orientation
    axes = matrix(q)
    momentum = out_of(axes, times(body.inertia, into(axes, motion.spin)))
    wanted = h * (
        norm(motion.spin) + 0.5 * h * norm(angular_acceleration(body, q, motion.spin, torque))
    )
    n = 1 + int(min(wanted * 10.0, 1000.0))
    dt = h / n
    for _ in range(n):
        half = add_scaled(momentum, 0.5 * dt, torque)
        end = add_scaled(momentum, dt, torque)
        k1 = spin_of(body, q, momentum)
        u = scale(0.5 * dt, k1)
        k2 = rotation_vector_rate(u, spin_of(body, turned(q, u), half))
        u = scale(0.5 * dt, k2)
        k3 = rotation_vector_rate(u, spin_of(body, turned(q, u), half))
        u = scale(dt, k3)
        k4 = rotation_vector_rate(u, spin_of(body, turned(q, u), end))
        u = scale(dt / 6.0, add(add(k1, k4), scale(2.0, add(k2, k3))))
        q = turned(q, u)
        momentum = end
    return Motion(
        add_scaled(add_scaled(motion.com, h, motion.velocity), 0.5 * h * h, a),
        q,
        add_scaled(motion.velocity, h, a),
        spin_of(body, q, momentum),
    )


@inline_function
def rotation_vector_rate(u: Vector, w: Vector) -> Vector:
    """du/dt of the rotation exp(u) at angular velocity w (world axes), to fourth order in u.

    u' = w - u x w / 2 + u x (u x w) / 12 (Iserles et al., Lie-group methods, Acta Numerica 2000).
    """
    c = cross(u, w)
    return add_scaled(add_scaled(w, -0.5, c), 1.0 / 12.0, cross(u, c))


@inline_function
def spin_of(body: Body, q: Quaternion, momentum: Vector) -> Vector:
    """The angular velocity for an angular momentum about the mass centre, world axes."""
    axes = matrix(q)
    return out_of(axes, times(body.inverse_inertia, into(axes, momentum)))
