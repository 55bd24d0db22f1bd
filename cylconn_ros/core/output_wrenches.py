"""Output of a step: the connector's forces as the two published wrenches and in the state."""

from typing import NamedTuple

from cylconn_ros.core import layout, model
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
    """Write the connector wrench on B at node b: force in the axes of a, moment in N."""
    model.write_vector(out, layout.FORCE, f)
    model.write_vector(out, layout.MOMENT, m)


@inline_function
def write_contact(out: Array, c: Contact, mu: float, limit: float, traction: float) -> None:
    """Write contact forces, friction coefficient, friction limit and traction."""
    out[layout.RADIAL_FORCE] = c.radial
    out[layout.BENDING_MOMENT] = c.moment
    out[layout.BENDING_FORCE] = c.bending
    out[layout.NORMAL_FORCE] = c.normal
    out[layout.FRICTION_COEFFICIENT] = mu
    out[layout.FRICTION_LIMIT] = limit
    out[layout.TRACTION] = traction


class ComWrenches(NamedTuple):
    """Force on B and torques about the mass centres of A and B, world axes; -force acts on A."""

    force: Vector
    torque_a: Vector
    torque_b: Vector


@inline_function
def limited_wrenches(par: Array, acting: Frame, f: Vector, m: Vector) -> tuple[ComWrenches, float]:
    """The wrenches about the mass centres, unlimited, and the factor of the output limits.

    acting: the configuration in which the wrench acts. f, m: force (axes of a) and moment (N) on B
    at node b.
    """
    o = model.output(par)
    force = out_of(acting.axes, f)
    moment = out_of_swung(acting, m)
    torque_b = add(cross(acting.arm_b, force), moment)
    torque_a = scale(-1.0, add(cross(acting.arm_a, force), moment))
    factor = 1.0
    if norm(force) > o.force_limit:
        factor = o.force_limit / norm(force)
    greatest = max(norm(torque_a), norm(torque_b))
    if factor * greatest > o.torque_limit:
        factor = o.torque_limit / greatest
    return ComWrenches(force, torque_a, torque_b), factor


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
    share: float,
) -> int:
    """Write both published wrenches and store them in ``mem``; LIMITED if they were scaled down.

    Args:
        acting: the configuration in which the wrench acts, at the same point on both bodies.
        f, m: force (axes of a) and moment (N) on B at node b.
        a, b: the bodies at the sample; published torques refer to their mass centres or origins.
        turned_a, turned_b: orientations after half a period: a wrench that is held in body
            axes has its mean.
        share: factor on both wrenches, beside that of the limits (methods/never_gains.py).
    """
    o, flags = model.output(par), 0
    wrenches, factor = limited_wrenches(par, acting, f, m)
    force, torque_a, torque_b = wrenches
    force_a = scale(-1.0, force)
    if factor < 1.0:
        flags = layout.LIMITED
    factor *= share
    if factor < 1.0:
        force, force_a = scale(factor, force), scale(factor, force_a)
        torque_a, torque_b = scale(factor, torque_a), scale(factor, torque_b)
    for k in range(3):
        mem[model.LAST_A + k], mem[model.LAST_A + 3 + k] = force_a[k], torque_a[k]
        mem[model.LAST_B + k], mem[model.LAST_B + 3 + k] = force[k], torque_b[k]
    turns = o.held_in_body and not o.semi_implicit
    at = model.HELD_WRENCH
    model.write_vector(mem, at, _at_start(a, turned_a, force_a, turns))
    model.write_vector(mem, at + 3, _at_start(a, turned_a, torque_a, turns))
    model.write_vector(mem, at + 6, _at_start(b, turned_b, force, turns))
    model.write_vector(mem, at + 9, _at_start(b, turned_b, torque_b, turns))
    _write_published(o, out, layout.FORCE_A, body_a, a, turned_a, force_a, torque_a)
    _write_published(o, out, layout.FORCE_B, body_b, b, turned_b, force, torque_b)
    return flags


@inline_function
def _at_start(m: Motion, half: Quaternion, v: Vector, turns: bool) -> Vector:
    """A vector with its mean at ``half``, at the start of its step if it turns with the body."""
    return out_of(matrix(m.orientation), into(matrix(half), v)) if turns else v


@inline_function
def add_reactions(mem: Array, acting: Frame, f: Vector, m: Vector) -> None:
    """Add reactions that are not sent to the wrenches in ``mem``, which then move the bodies.

    f, m: reaction on B at node b, force in the axes of a, moment in N.
    """
    force, moment = out_of(acting.axes, f), out_of_swung(acting, m)
    torque_a = add(cross(acting.arm_a, force), moment)
    torque_b = add(cross(acting.arm_b, force), moment)
    for k in range(3):
        mem[model.LAST_A + k] -= force[k]
        mem[model.LAST_A + 3 + k] -= torque_a[k]
        mem[model.LAST_B + k] += force[k]
        mem[model.LAST_B + 3 + k] += torque_b[k]
        mem[model.HELD_WRENCH + k] -= force[k]
        mem[model.HELD_WRENCH + 3 + k] -= torque_a[k]
        mem[model.HELD_WRENCH + 6 + k] += force[k]
        mem[model.HELD_WRENCH + 9 + k] += torque_b[k]


@inline_function
def _write_published(
    o: model.Output,
    out: Array,
    at: int,
    body: Body,
    motion: Motion,
    turned: Quaternion,
    force: Vector,
    torque: Vector,
) -> None:
    """Write force and torque (about the mass centre, world axes) in the published form."""
    here = matrix(motion.orientation)
    if o.held_in_body and not o.semi_implicit:  # rotates with the body from the sample's axes on
        there = matrix(turned)
        force = out_of(here, into(there, force))
        torque = out_of(here, into(there, torque))
    if not o.at_com:
        torque = add(torque, cross(out_of(here, body.com), force))
    if not o.world_axes:
        force, torque = into(here, force), into(here, torque)
    model.write_vector(out, at, force)
    model.write_vector(out, at + 3, torque)
