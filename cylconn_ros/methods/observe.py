"""Method observe: inverse dynamics of a measured motion, for a joint that exists in the simulator.

No wrench is sent. The force and torque on a body of known inertia over the last interval, from
t_k - dt to t_k, in addition to gravity and its load, are

    F = m (v_k - v_(k-1))/dt - m g - load           about its mass centre, world axes
    T = (L_k - L_(k-1))/dt - torque of the load     L = I w, in the axes of each sample;
                                                    the load's at the middle

and the connector's wrench is F, T transferred to node b in the configuration at the middle of the
interval. If both inertias are known, the two estimates are weighted by 1/m^2, since velocity noise
is multiplied by m/dt. The parts of springs and dampers in (f1, m1) follow from their formulas; the
rest is friction, at a stop including the force of the stop. Forces belong to the middle of the
interval, positions and rates to its end.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.elements import elements_over_step
from cylconn_ros.core.friction import Array, coefficient, contact, cosine, limit, share_of
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import stop_bits
from cylconn_ros.core.kinematics import frame, into_swung
from cylconn_ros.core.output_wrenches import write_contact, write_forces
from cylconn_ros.core.relative_state import measure
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


class PreviousSample(NamedTuple):
    """A body at the previous sample and the load held since, at its origin, world axes."""

    com: Vector
    spin: Vector
    velocity: Vector
    momentum: Vector  # I w
    push: Vector
    turn: Vector


@inline_function
def _previous_sample(mem: Array, k: int) -> PreviousSample:
    """The previous sample of body A (k = 0) or B (1)."""
    last = model.LAST_A if k == 0 else model.LAST_B
    held = model.LAST_LOADS + 6 * k
    return PreviousSample(
        model.vector(mem, last + 6),
        model.vector(mem, last + 9),
        model.vector(mem, model.LAST_VELOCITIES + 3 * k),
        model.vector(mem, model.ANGULAR_MOMENTUM + 3 * k),
        model.vector(mem, held),
        model.vector(mem, held + 3),
    )


@inline_function
def _store_sample(mem: Array, k: int, body: Body, m: Motion, sample: Array) -> None:
    """Store momentum and load for the next sample, in addition to what `measure` stores."""
    axes = matrix(m.orientation)
    load = layout.A_LOAD + 6 * k
    model.write_vector(
        mem, model.ANGULAR_MOMENTUM + 3 * k, out_of(axes, times(body.inertia, into(axes, m.spin)))
    )
    model.write_vector(mem, model.LAST_LOADS + 6 * k, model.vector(sample, load))
    model.write_vector(mem, model.LAST_LOADS + 6 * k + 3, model.vector(sample, load + 3))


@inline_function
def _mid_configuration(m: Motion, before: PreviousSample, dt: float) -> Motion:
    """The configuration at the middle of the interval; the velocity is not used."""
    com, back = scale(0.5, add(m.com, before.com)), scale(-0.25 * dt, add(m.spin, before.spin))
    return Motion(com, turned(m.orientation, back), m.velocity, m.spin)


@inline_function
def _inverse_dynamics(
    par: Array,
    mem: Array,
    k: int,
    body: Body,
    m: Motion,
    before: PreviousSample,
    middle: Motion,
    arm: Vector,
    dt: float,
) -> tuple[Vector, Vector]:
    """Force and moment at node b on body A (k = 0) or B (1), whose mass centre is ``arm`` away.

    ``middle``: the configuration in which the held load acts at the origin of the body.
    """
    force = scale(body.mass / dt, sub(m.velocity, before.velocity))
    force = add_scaled(force, -body.mass, model.vector(par, model.GRAVITY))
    force = sub(force, before.push)
    gained = sub(model.vector(mem, model.ANGULAR_MOMENTUM + 3 * k), before.momentum)
    load = sub(before.turn, cross(out_of(matrix(middle.orientation), body.com), before.push))
    turn = sub(scale(1.0 / dt, gained), load)
    return force, sub(turn, cross(arm, force))


@device_function
def step(par: Array, mem: Array, sample: Array, _h: float, out: Array) -> int:
    """Compute one step: sample (NSAMPLE,), out (NOUT,), ``mem`` updated; returns the flags."""
    began, dt = mem[model.HAS_REFERENCE] != 0.0, mem[model.LAST_PERIOD]
    place = (mem[model.LAST_POSITION], mem[model.LAST_ANGLE])
    rates = (mem[model.LAST_VELOCITY], mem[model.LAST_SPIN])
    a, b = _previous_sample(mem, 0), _previous_sample(mem, 1)
    o = measure(par, mem, sample, -dt, out)
    body_a, body_b = o.body_a, o.body_b
    _store_sample(mem, 0, body_a, o.a, sample)
    _store_sample(mem, 1, body_b, o.b, sample)
    out[layout.STOP_TIME] = -1.0
    if not (began and dt > 0.0):
        return o.flags

    middle_a, middle_b = _mid_configuration(o.a, a, dt), _mid_configuration(o.b, b, dt)
    f = frame(o.nodes, middle_a, middle_b)
    force, moment, weight = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0
    if body_b.free:
        push, turn = _inverse_dynamics(par, mem, 1, body_b, o.b, b, middle_b, f.arm_b, dt)
        weight = 1.0 / (body_b.mass * body_b.mass)
        force, moment = scale(weight, push), scale(weight, turn)
    if body_a.free:
        push, turn = _inverse_dynamics(par, mem, 0, body_a, o.a, a, middle_a, f.arm_a, dt)
        share = 1.0 / (body_a.mass * body_a.mass)
        weight += share
        force, moment = add_scaled(force, -share, push), add_scaled(moment, -share, turn)
    force = into(f.axes, scale(1.0 / weight, force))
    moment = into_swung(f, scale(1.0 / weight, moment))
    return o.flags | _write_state(par, mem, out, force, moment, place, rates, dt)


@inline_function
def _write_state(
    par: Array, mem: Array, out: Array, force: Vector, moment: Vector,
    before: tuple[float, float], rates: tuple[float, float], dt: float,
) -> int:  # fmt: skip
    """Write the wrench, its components and the friction; returns STOPPED or 0."""
    write_forces(out, force, moment)
    at, ref = model.ELASTICITY, model.REFERENCE
    rest_length = model.value_or(par[ref + 2], mem[model.LENGTH0])
    rest_angle = model.value_or(par[ref + 3], mem[model.ANGLE0])
    u1 = 0.5 * (out[layout.LENGTH] + before[0]) - rest_length
    ur = 0.5 * (out[layout.ANGLE] + before[1]) - rest_angle
    w1 = 0.5 * (out[layout.VELOCITY] + rates[0])
    wr = 0.5 * (out[layout.ANGULAR_VELOCITY] + rates[1])
    out[layout.FORCE_ELASTIC], out[layout.MOMENT_ELASTIC] = -par[at] * u1, -par[at + 1] * ur
    out[layout.FORCE_VISCOUS], out[layout.MOMENT_VISCOUS] = -par[at + 2] * w1, -par[at + 3] * wr
    out[layout.FORCE_ACTUATION] = -par[model.OFFSET]
    out[layout.FORCE_REACTION] = out[layout.MOMENT_REACTION] = 0.0
    stop = 0
    for k in range(2):
        if par[model.ELEMENTS + k] != 0.0:  # their means over the path, core/elements.py
            x, v = before[k], ((out[layout.LENGTH], out[layout.ANGLE])[k] - before[k]) / dt
            rest, first = (rest_length, rest_angle)[k], layout.FORCE_ELASTIC + 5 * k
            e = elements_over_step(par, model.ELEMENTS, k, x - rest, x, v, v, dt, False)
            out[first] += e.spring
            out[first + 1] += e.damper
            out[first + 4] = e.stop
            stop |= stop_bits(e.side) << 2 * k
    p = force[0] - out[layout.FORCE_ELASTIC] - out[layout.FORCE_VISCOUS] + par[model.OFFSET]
    q = moment[0] - out[layout.MOMENT_ELASTIC] - out[layout.MOMENT_VISCOUS]
    p, q = p - out[layout.FORCE_REACTION], q - out[layout.MOMENT_REACTION]
    out[layout.FORCE_FRICTION], out[layout.MOMENT_FRICTION] = p, q
    for k in range(2):
        place, bound = (out[layout.LENGTH], 0) if k == 0 else (out[layout.ANGLE], 2)
        if place <= par[model.STOPS + bound]:
            stop |= 1 << bound
        if place >= par[model.STOPS + bound + 1]:
            stop |= 2 << bound
    out[layout.STOP] = stop

    law = model.law(par)
    pressed = contact(law, (force[1], force[2], moment[1], moment[2]))
    radius = law.radius
    traction = math.sqrt(p * p + (q / radius) ** 2) if radius > 0.0 else abs(p)
    rate = math.sqrt(w1 * w1 + (radius * wr) ** 2)
    regime = layout.SLIP if rate > par[model.REST_RATE] else layout.STICK
    mu = traction / pressed.normal if pressed.normal > 0.0 else 0.0
    greatest = 0.0
    if law.on:
        if regime == layout.SLIP:
            greatest = limit(law, par, rate, pressed.normal, w1 / rate)
        else:
            c = cosine(law, (p, q / radius))
            greatest = limit(law, par, 0.0, pressed.normal, c)
            mu = coefficient(law, par, 0.0, pressed.normal) * share_of(law, c)
    write_contact(out, pressed, mu, greatest, traction)
    if regime == layout.SLIP:
        mem[model.ACCUMULATED_SLIP] += rate * dt
        mem[model.STICK_SAMPLES] = 0.0
    else:
        mem[model.STICK_SAMPLES] += 1.0
    out[layout.REGIME] = regime
    out[layout.ACCUMULATED_SLIP] = mem[model.ACCUMULATED_SLIP]
    return layout.STOPPED if mem[model.STICK_SAMPLES] >= layout.STOPPED_SAMPLES else 0
