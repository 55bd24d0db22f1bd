"""From the connector's forces to the two published wrenches: what every method does last."""

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, Contact
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.kinematics import Frame, out_of_swung
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.vectors import (
    Quaternion,
    Vector,
    add,
    cross,
    into,
    matrix,
    norm,
    out_of,
    scale,
)


@inline_function
def write_forces(out: Array, f: Vector, m: Vector) -> None:
    """The connector wrench on B at node b: the force in the axes of a, the moment in N."""
    model.put(out, out_at.FORCE, f)
    model.put(out, out_at.MOMENT, m)


@inline_function
def write_contact(out: Array, c: Contact, mu: float, limit: float, traction: float) -> None:
    """The contact and what friction makes of it."""
    out[out_at.RADIAL_FORCE] = c.radial
    out[out_at.BENDING_MOMENT] = c.moment
    out[out_at.BENDING_FORCE] = c.bending
    out[out_at.NORMAL_FORCE] = c.normal
    out[out_at.FRICTION_COEFFICIENT] = mu
    out[out_at.FRICTION_LIMIT] = limit
    out[out_at.TRACTION] = traction


@inline_function
def write_wrenches(
    par: Array,
    mem: Array,
    out: Array,
    acting: Frame,
    f: Vector,
    m: Vector,
    body_a: Body,
    body_b: Body,
    a: Motion,
    b: Motion,
    turned_a: Quaternion,
    turned_b: Quaternion,
) -> int:
    """Write both wrenches as published and remember them; return LIMITED if they were scaled down.

    Args:
        acting: the configuration in which the wrench acts; both bodies get it at the same point
        there. f, m: force (axes of a) and moment (N) on B at node b.
        a, b: the bodies at the sample, where a published wrench is taken to force and torque.
        turned_a, turned_b: orientations half a period on: a wrench that is held in body axes and
        turns
            with them has its mean there.
    """
    o = model.output(par)
    force = out_of(acting.axes, f)
    moment = out_of_swung(acting, m)
    torque_b = add(cross(acting.arm_b, force), moment)
    force_a = scale(-1.0, force)
    torque_a = scale(-1.0, add(cross(acting.arm_a, force), moment))

    factor, flags = 1.0, 0
    if norm(force) > o.force_limit:
        factor = o.force_limit / norm(force)
    greatest = max(norm(torque_a), norm(torque_b))
    if factor * greatest > o.torque_limit:
        factor = o.torque_limit / greatest
    if factor < 1.0:
        flags = out_at.LIMITED
        force, force_a = scale(factor, force), scale(factor, force_a)
        torque_a, torque_b = scale(factor, torque_a), scale(factor, torque_b)
    for k in range(3):
        mem[model.LAST_A + k], mem[model.LAST_A + 3 + k] = force_a[k], torque_a[k]
        mem[model.LAST_B + k], mem[model.LAST_B + 3 + k] = force[k], torque_b[k]
    _publish(o, out, out_at.FORCE_A, body_a, a, turned_a, force_a, torque_a)
    _publish(o, out, out_at.FORCE_B, body_b, b, turned_b, force, torque_b)
    return flags


@inline_function
def _publish(
    o: model.Output,
    out: Array,
    at: int,
    body: Body,
    motion: Motion,
    turned: Quaternion,
    force: Vector,
    torque: Vector,
) -> None:
    """Write force and torque (about the mass centre, world axes) in the form asked for."""
    here = matrix(motion.orientation)
    if (
        o.held_in_body
    ):  # what the body's axes carry with them, expressed in the axes as they are now
        there = matrix(turned)
        force = out_of(here, into(there, force))
        torque = out_of(here, into(there, torque))
    if not o.at_com:
        torque = add(torque, cross(out_of(here, body.com), force))
    if not o.world_axes:
        force, torque = into(here, force), into(here, torque)
    model.put(out, at, force)
    model.put(out, at + 3, torque)
