"""``observe``: the reactions and the friction that a motion seen has had, for a joint that exists.

Nothing is commanded. What a body of known inertia has been given over the last interval, from
t_k - dt to t_k, beside gravity and its load, is

    F = m (v_k - v_(k-1))/dt - m g - load           about its mass centre, world axes
    T = (L_k - L_(k-1))/dt - torque of the load     L = I w, in the axes of each sample

and the connector's wrench is F, T taken to node b in the configuration of the interval's middle.
Where both inertias are known the two estimates are weighted by 1/m^2, as a velocity's noise makes
an error of m/dt. Of (f1, m1) springs and dampers get what their formulas say of the interval; the
rest is friction, and at a stop the stop's force with it. Forces belong to the interval's middle,
positions and rates to its end.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, coefficient, contact, limit
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import frame, into_swung
from cylconn_ros.core.output_wrenches import write_contact, write_forces
from cylconn_ros.core.relative_state import observe
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.vectors import (
    Vector,
    add,
    add_scaled,
    cross,
    into,
    matrix,
    out_of,
    scale,
    sub,
    times,
    turned,
)

STOPPED_AFTER = 3


class Before(NamedTuple):
    """A body at the last sample, and the load held since, about its mass centre; world axes."""

    com: Vector
    spin: Vector
    velocity: Vector
    momentum: Vector  # I w
    push: Vector
    turn: Vector


@inline_function
def _before(mem: Array, k: int) -> Before:
    """Of body A (k = 0) or B (1)."""
    last = model.LAST_A if k == 0 else model.LAST_B
    held = model.HELD_LOADS + 6 * k
    return Before(
        model.vector(mem, last + 6),
        model.vector(mem, last + 9),
        model.vector(mem, model.LAST_VELOCITIES + 3 * k),
        model.vector(mem, model.MOMENTUM + 3 * k),
        model.vector(mem, held),
        model.vector(mem, held + 3),
    )


@inline_function
def _keep(mem: Array, k: int, body: Body, m: Motion, sample: Array) -> None:
    """What the next sample asks of this one, beside what `observe` keeps."""
    axes = matrix(m.orientation)
    load = out_at.A_LOAD + 6 * k
    push = model.vector(sample, load)
    turn = sub(model.vector(sample, load + 3), cross(out_of(axes, body.com), push))
    model.put(mem, model.MOMENTUM + 3 * k, out_of(axes, times(body.inertia, into(axes, m.spin))))
    model.put(mem, model.HELD_LOADS + 6 * k, push)
    model.put(mem, model.HELD_LOADS + 6 * k + 3, turn)


@inline_function
def _between(m: Motion, before: Before, dt: float) -> Motion:
    """The configuration at the middle of the interval; its velocity is not used."""
    com, back = scale(0.5, add(m.com, before.com)), scale(-0.25 * dt, add(m.spin, before.spin))
    return Motion(com, turned(m.orientation, back), m.velocity, m.spin)


@inline_function
def _given(
    par: Array, mem: Array, k: int, body: Body, m: Motion, before: Before, arm: Vector, dt: float
) -> tuple[Vector, Vector]:
    """Force and moment at node b on body A (k = 0) or B (1), whose mass centre is ``arm`` away."""
    force = scale(body.mass / dt, sub(m.velocity, before.velocity))
    force = add_scaled(force, -body.mass, model.vector(par, model.GRAVITY))
    force = sub(force, before.push)
    gained = sub(model.vector(mem, model.MOMENTUM + 3 * k), before.momentum)
    turn = sub(scale(1.0 / dt, gained), before.turn)
    return force, sub(turn, cross(arm, force))


@device_function
def step(par: Array, mem: Array, sample: Array, _h: float, out: Array) -> int:
    """One sample: (NSAMPLE,) in, (NOUT,) out, ``mem`` advanced; returns the flags."""
    began, dt = mem[model.STARTED] != 0.0, mem[model.LAST_PERIOD]
    place = (mem[model.LAST_POSITION], mem[model.LAST_ANGLE])
    rates = (mem[model.LAST_VELOCITY], mem[model.LAST_SPIN])
    a, b = _before(mem, 0), _before(mem, 1)
    o = observe(par, mem, sample, out)
    body_a, body_b = o.body_a, o.body_b
    _keep(mem, 0, body_a, o.a, sample)
    _keep(mem, 1, body_b, o.b, sample)
    out[out_at.STOP_TIME] = -1.0
    if not (began and dt > 0.0):
        return o.flags

    f = frame(o.nodes, _between(o.a, a, dt), _between(o.b, b, dt))
    force, moment, weight = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    if body_b.free:
        push, turn = _given(par, mem, 1, body_b, o.b, b, f.arm_b, dt)
        weight = 1.0 / (body_b.mass * body_b.mass)
        force, moment = scale(weight, push), scale(weight, turn)
    if body_a.free:
        push, turn = _given(par, mem, 0, body_a, o.a, a, f.arm_a, dt)
        share = 1.0 / (body_a.mass * body_a.mass)
        weight += share
        force, moment = add_scaled(force, -share, push), add_scaled(moment, -share, turn)
    force = into(f.axes, scale(1.0 / weight, force))
    moment = into_swung(f, scale(1.0 / weight, moment))
    return o.flags | _report(par, mem, out, force, moment, place, rates, dt)


@inline_function
def _report(
    par: Array, mem: Array, out: Array, force: Vector, moment: Vector,
    before: tuple[float, float], rates: tuple[float, float], dt: float,
) -> int:  # fmt: skip
    """Write the wrench, its parts and the friction that it shows."""
    write_forces(out, force, moment)
    at, ref = model.ELASTICITY, model.REFERENCE
    rest_length = model.given(par[ref + 2], mem[model.LENGTH0])
    rest_angle = model.given(par[ref + 3], mem[model.ANGLE0])
    u1 = 0.5 * (out[out_at.LENGTH] + before[0]) - rest_length
    ur = 0.5 * (out[out_at.ANGLE] + before[1]) - rest_angle
    w1 = 0.5 * (out[out_at.VELOCITY] + rates[0])
    wr = 0.5 * (out[out_at.ANGULAR_VELOCITY] + rates[1])
    out[out_at.FORCE_ELASTIC], out[out_at.MOMENT_ELASTIC] = -par[at] * u1, -par[at + 1] * ur
    out[out_at.FORCE_VISCOUS], out[out_at.MOMENT_VISCOUS] = -par[at + 2] * w1, -par[at + 3] * wr
    p = force[0] - out[out_at.FORCE_ELASTIC] - out[out_at.FORCE_VISCOUS]
    q = moment[0] - out[out_at.MOMENT_ELASTIC] - out[out_at.MOMENT_VISCOUS]
    out[out_at.FORCE_FRICTION], out[out_at.MOMENT_FRICTION] = p, q
    stop = 0
    for k in range(2):
        place, bound = (out[out_at.LENGTH], 0) if k == 0 else (out[out_at.ANGLE], 2)
        if place <= par[model.STOPS + bound]:
            stop |= 1 << bound
        if place >= par[model.STOPS + bound + 1]:
            stop |= 2 << bound
    out[out_at.STOP] = stop

    law = model.law(par)
    pressed = contact(law, (force[1], force[2], moment[1], moment[2]))
    radius = law.radius
    traction = math.sqrt(p * p + (q / radius) ** 2) if radius > 0.0 else abs(p)
    rate = math.sqrt(w1 * w1 + (radius * wr) ** 2)
    regime = out_at.SLIP if rate > par[model.REST_RATE] else out_at.STICK
    mu = traction / pressed.normal if pressed.normal > 0.0 else 0.0
    greatest = 0.0
    if law.on:
        greatest = limit(law, par, rate if regime == out_at.SLIP else 0.0, pressed.normal)
        if regime == out_at.STICK:
            mu = coefficient(law, par, 0.0, pressed.normal)
    write_contact(out, pressed, mu, greatest, traction)
    if regime == out_at.SLIP:
        mem[model.SLIPPED] += rate * dt
        mem[model.STUCK] = 0.0
    else:
        mem[model.STUCK] += 1.0
    out[out_at.REGIME] = regime
    out[out_at.ACCUMULATED_SLIP] = mem[model.SLIPPED]
    return out_at.STOPPED if mem[model.STUCK] >= STOPPED_AFTER else 0
