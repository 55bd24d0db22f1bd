"""The plant: two rigid bodies under gravity, loads and wrenches held over a period."""

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function, kernel
from cylconn_ros.core.rigid_body import Body, Motion, angular_acceleration, at_com, exact_step
from cylconn_ros.core.vectors import (
    Vector,
    add,
    add_scaled,
    cross,
    dot,
    into,
    matrix,
    norm,
    out_of,
    scale,
    sub,
    times,
    turned,
)


@kernel
def step(
    par: Array, state: Array, wrench_a: Array, wrench_b: Array, loads: Array, h: float
) -> None:
    """Advance ``state`` (26,) in place by h (s).

    ``wrench_a``, ``wrench_b`` (6,) as published; ``loads`` (12,) on A and B as in a sample: force
    and torque about the body frame's origin, world axes. All of them are held over the period.
    """
    body_a, body_b = model.body(par, model.BODY_A), model.body(par, model.BODY_B)
    _advance_published(par, body_a, state, layout.A_POSE, wrench_a, loads, 0, h)
    _advance_published(par, body_b, state, layout.B_POSE, wrench_b, loads, 6, h)


@inline_function
def motion_of(body: Body, state: Array, at: int) -> Motion:
    """A body's motion at its mass centre, from its pose and twist in ``state``."""
    return at_com(
        body,
        model.vector(state, at),
        model.quaternion(state, at + 3),
        model.vector(state, at + 7),
        model.vector(state, at + 10),
    )


@device_function
def _advance_published(
    par: Array, body: Body, state: Array, at: int, wrench: Array, loads: Array, load: int, h: float
) -> None:
    """Advance a body under a wrench as published."""
    o = model.output(par)
    m = motion_of(body, state, at)
    force, torque = model.vector(wrench, 0), model.vector(wrench, 3)
    axes = matrix(m.orientation)
    if not o.world_axes:
        force, torque = out_of(axes, force), out_of(axes, torque)
    if not o.at_com:
        torque = sub(torque, cross(out_of(axes, body.com), force))
    advance_body(par, body, state, at, force, torque, loads, load, h)


@device_function
def advance_body(
    par: Array,
    body: Body,
    state: Array,
    at: int,
    force: Vector,
    torque: Vector,
    loads: Array,
    load: int,
    h: float,
) -> None:
    """Advance the body at ``at`` in ``state`` by h under a wrench about its mass centre.

    The wrench is in world axes; the load at ``load`` in ``loads`` acts besides gravity.
    """
    o = model.output(par)
    m = motion_of(body, state, at)
    axes = matrix(m.orientation)
    force = add(force, model.vector(loads, load))
    torque = add(torque, model.vector(loads, load + 3))
    torque = sub(torque, cross(out_of(axes, body.com), model.vector(loads, load)))
    weight = scale(body.mass if body.free else 0.0, model.vector(par, model.GRAVITY))
    if o.semi_implicit:
        m = _semi_implicit_step(body, m, add(force, weight), torque, h)
    elif o.held_in_body and body.free:
        m = _turning_step(body, m, weight, into(axes, force), into(axes, torque), h)
    else:
        m = exact_step(body, m, add(force, weight), torque, h)
    arm = out_of(matrix(m.orientation), body.com)
    model.write_vector(state, at, sub(m.com, arm))
    for k in range(4):
        state[at + 3 + k] = m.orientation[k]
    model.write_vector(state, at + 7, sub(m.velocity, cross(m.spin, arm)))
    model.write_vector(state, at + 10, m.spin)


@device_function
def _semi_implicit_step(body: Body, m: Motion, force: Vector, torque: Vector, h: float) -> Motion:
    """Semi-implicit Euler: positions follow the new velocities; first order."""
    velocity = add_scaled(m.velocity, h * body.inverse_mass, force)
    spin = m.spin
    if body.free:
        spin = add_scaled(m.spin, h, angular_acceleration(body, m.orientation, m.spin, torque))
    return Motion(
        add_scaled(m.com, h, velocity), turned(m.orientation, scale(h, spin)), velocity, spin
    )


@device_function
def _turning_step(
    body: Body, m: Motion, weight: Vector, force: Vector, torque: Vector, h: float
) -> Motion:
    """A wrench held in body axes: short steps, each with the wrench rotated to its middle."""
    n = 8 + int(min(norm(m.spin) * h * 400.0, 1000.0))
    dt = h / n
    for _ in range(n):
        half = exact_step(
            body, m, weight, out_of(matrix(m.orientation), torque), 0.5 * dt
        ).orientation
        axes = matrix(half)
        m = exact_step(body, m, add(weight, out_of(axes, force)), out_of(axes, torque), dt)
    return m


@kernel
def energy(par: Array, state: Array) -> float:
    """Kinetic and gravitational energy of both bodies, J."""
    total = 0.0
    for body, at in (
        (model.body(par, model.BODY_A), layout.A_POSE),
        (model.body(par, model.BODY_B), layout.B_POSE),
    ):
        if body.free:
            m = motion_of(body, state, at)
            w = into(matrix(m.orientation), m.spin)
            total += 0.5 * body.mass * dot(m.velocity, m.velocity)
            total += 0.5 * dot(w, times(body.inertia, w))
            total -= body.mass * dot(model.vector(par, model.GRAVITY), m.com)
    return total


@kernel
def momentum(par: Array, state: Array) -> tuple[float, float, float, float, float, float]:
    """Linear momentum and angular momentum about the world's origin, world axes."""
    p, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for body, at in (
        (model.body(par, model.BODY_A), layout.A_POSE),
        (model.body(par, model.BODY_B), layout.B_POSE),
    ):
        if body.free:
            m = motion_of(body, state, at)
            axes = matrix(m.orientation)
            spin = out_of(axes, times(body.inertia, into(axes, m.spin)))
            p = add_scaled(p, body.mass, m.velocity)
            moment = add(moment, add_scaled(spin, body.mass, cross(m.com, m.velocity)))
    return (p[0], p[1], p[2], moment[0], moment[1], moment[2])
