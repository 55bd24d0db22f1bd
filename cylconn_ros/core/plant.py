"""The plant: two rigid bodies under gravity, loads and wrenches held over a period.

A wrench that acts late is taken up at the time of its action: it is converted there, once, and held
(:func:`take_up`, :func:`advance`). With a delay of d = n + r periods, 0 <= r < 1, period k begins
with the wrench of sample k - n - 1 and continues from r h on with that of sample k - n.
"""

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.held_step import (
    Load,
    held_step,
    load_torque,
    load_turns,
    semi_implicit_step,
)
from cylconn_ros.core.jit import device_function, inline_function, kernel
from cylconn_ros.core.rigid_body import Body, Motion, at_com, exact_step
from cylconn_ros.core.vectors import (
    Vector,
    add,
    add_scaled,
    cross,
    dot,
    into,
    matrix,
    out_of,
    scale,
    sub,
    times,
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


@device_function
def step_late(
    par: Array, state: Array, sent: Array, acting: Array, loads: Array, delay: float, h: float
) -> None:
    """Advance ``state`` (26,) in place by h (s); every wrench acts ``delay`` periods late.

    Args:
        sent: (n, 12) wrenches on A and B as published, that of this period's sample first; n >
            ``delay``. Zero where none was sent.
        acting: (12,) the wrenches that act (:func:`take_up`), updated.
        loads: (12,) as of :func:`step`.
    """
    whole = int(delay)
    part = (delay - whole) * h
    if part > 0.0:
        advance(par, state, acting, loads, part)
    take_up(par, state, 0, sent[whole], acting)
    take_up(par, state, 1, sent[whole], acting)
    advance(par, state, acting, loads, h - part)


@kernel
def take_up(par: Array, state: Array, k: int, published: Array, acting: Array) -> None:
    """Convert a wrench for body A (k = 0) or B (1) at its present pose, from which on it acts.

    published: (12,) wrenches on A and B as published. acting: (12,) force and torque about the mass
    centres of A and B in the axes in which they are held, written for body k.
    """
    body = model.body(par, model.BODY_A if k == 0 else model.BODY_B)
    m = motion_of(body, state, layout.A_POSE if k == 0 else layout.B_POSE)
    force, torque = _about_com(par, body, m, published, 6 * k)
    if model.output(par).held_in_body:
        axes = matrix(m.orientation)
        force, torque = into(axes, force), into(axes, torque)
    model.write_vector(acting, 6 * k, force)
    model.write_vector(acting, 6 * k + 3, torque)


@kernel
def advance(par: Array, state: Array, acting: Array, loads: Array, h: float) -> None:
    """Advance ``state`` (26,) in place by h (s) under wrenches that have been taken up."""
    for k in range(2):
        body = model.body(par, model.BODY_A if k == 0 else model.BODY_B)
        at = layout.A_POSE if k == 0 else layout.B_POSE
        force, torque = model.vector(acting, 6 * k), model.vector(acting, 6 * k + 3)
        if model.output(par).held_in_body:
            axes = matrix(motion_of(body, state, at).orientation)
            force, torque = out_of(axes, force), out_of(axes, torque)
        advance_body(par, body, state, at, force, torque, loads, 6 * k, h)


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
    force, torque = _about_com(par, body, motion_of(body, state, at), wrench, 0)
    advance_body(par, body, state, at, force, torque, loads, load, h)


@inline_function
def _about_com(
    par: Array, body: Body, m: Motion, published: Array, at: int
) -> tuple[Vector, Vector]:
    """Force and torque about the mass centre, world axes, of the published wrench at ``at``."""
    o = model.output(par)
    force, torque = model.vector(published, at), model.vector(published, at + 3)
    axes = matrix(m.orientation)
    if not o.world_axes:
        force, torque = out_of(axes, force), out_of(axes, torque)
    if not o.at_com:
        torque = sub(torque, cross(out_of(axes, body.com), force))
    return force, torque


@device_function
def advance_body(
    par: Array,
    body: Body,
    state: Array,
    at: int,
    force: Vector,
    torque: Vector,
    loads: Array,
    load_at: int,
    h: float,
) -> None:
    """Advance the body at ``at`` in ``state`` by h under a wrench about its mass centre.

    The wrench is in world axes; the load at ``load_at`` in ``loads`` acts besides gravity.
    """
    o = model.output(par)
    m = motion_of(body, state, at)
    weight = scale(body.mass if body.free else 0.0, model.vector(par, model.GRAVITY))
    load = Load(model.vector(loads, load_at), model.vector(loads, load_at + 3), weight)
    if o.semi_implicit:
        m = semi_implicit_step(body, m, force, torque, load, h).end
    elif (o.held_in_body and body.free) or load_turns(body, load):
        m = held_step(body, m, force, torque, load, h, o.held_in_body).end
    else:
        torque = add(torque, load_torque(body, m.orientation, load))
        m = exact_step(body, m, add(add(force, load.force), weight), torque, h)
    arm = out_of(matrix(m.orientation), body.com)
    model.write_vector(state, at, sub(m.com, arm))
    for k in range(4):
        state[at + 3 + k] = m.orientation[k]
    model.write_vector(state, at + 7, sub(m.velocity, cross(m.spin, arm)))
    model.write_vector(state, at + 10, m.spin)


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
