"""A step of a rigid body under a held wrench and a load that turns with it, and the wrench's work.

A load acts at the origin of the body frame, so that its torque about the mass centre,

    T(q) = torque - (R(q) com) x force

changes while the body turns. A wrench is held about the mass centre, in world axes or in body axes.
The exact plant integrates orientation q, angular momentum L, velocity and position together,

    L' = tau(q) + T(q),   m v' = f(q) + force + weight,   work' = f(q).v + tau(q).w

with the fourth-order Runge-Kutta-Munthe-Kaas method in steps of at most MAX_TURN, of the turn and
of the swing of the load's pendulum. Held in world axes, f and tau are constant. The semi-implicit
plant evaluates all of them at the start.
"""

import math
from typing import NamedTuple

from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.rigid_body import (
    Body,
    Motion,
    angular_acceleration,
    rotation_vector_rate,
    spin_of,
)
from cylconn_ros.core.vectors import (
    Quaternion,
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

MAX_TURN = 0.1  # rad, of one Runge-Kutta step
MAX_STEPS = 1000
NONE: Vector = (0.0, 0.0, 0.0)


class Load(NamedTuple):
    """A known load in world axes: force and torque at the body frame's origin, and the weight."""

    force: Vector
    torque: Vector
    weight: Vector


class HeldStep(NamedTuple):
    """The motion after a step, and the work of the held wrench on it, J."""

    end: Motion
    work: float


@inline_function
def load_torque(body: Body, q: Quaternion, load: Load) -> Vector:
    """Torque of a load about the mass centre in the orientation q, world axes."""
    return sub(load.torque, cross(out_of(matrix(q), body.com), load.force))


@inline_function
def load_turns(body: Body, load: Load) -> bool:
    """Whether the torque of a load about the mass centre changes while the body turns."""
    force, com = load.force, body.com
    pulls = force[0] != 0.0 or force[1] != 0.0 or force[2] != 0.0
    return body.free and pulls and (com[0] != 0.0 or com[1] != 0.0 or com[2] != 0.0)


@inline_function
def _held(q: Quaternion, start: Quaternion, v: Vector, in_body: bool) -> Vector:
    """A vector given in world axes at orientation ``start``, at q, if it is held in body axes."""
    if not in_body:
        return v
    return out_of(matrix(q), into(matrix(start), v))


@device_function
def held_step(
    body: Body, m: Motion, force: Vector, torque: Vector, load: Load, h: float, in_body: bool
) -> HeldStep:
    """One step of the exact plant under a wrench about the mass centre, world axes at its start.

    in_body: the wrench is held in body axes. A body that is not free keeps its twist.
    """
    if not body.free:
        q = turned(m.orientation, scale(h, m.spin))
        com = add_scaled(m.com, h, m.velocity)
        power = dot(force, m.velocity) + dot(torque, m.spin)
        if in_body:  # Simpson's rule
            half = turned(m.orientation, scale(0.5 * h, m.spin))
            for at, weight in ((half, 4.0), (q, 1.0)):
                power += weight * dot(_held(at, m.orientation, force, True), m.velocity)
                power += weight * dot(_held(at, m.orientation, torque, True), m.spin)
            power /= 6.0
        return HeldStep(Motion(com, q, m.velocity, m.spin), h * power)
    start, q = m.orientation, m.orientation
    axes = matrix(q)
    momentum = out_of(axes, times(body.inertia, into(axes, m.spin)))
    first = add(torque, load_torque(body, q, load))
    rate = norm(m.spin) + 0.5 * h * norm(angular_acceleration(body, q, m.spin, first))
    j = body.inverse_inertia
    swings = norm(load.force) * norm(body.com) * (j[0] + j[3] + j[5])  # of a pendulum, 1/s^2
    n = 1 + int(min(h * (rate + math.sqrt(swings)) / MAX_TURN, MAX_STEPS))
    dt = h / n
    outer = add(load.force, load.weight)
    x, v, work = m.com, m.velocity, 0.0
    for _ in range(n):
        w1 = spin_of(body, q, momentum)
        f1, t1 = _held(q, start, force, in_body), _held(q, start, torque, in_body)
        l1 = add(t1, load_torque(body, q, load))
        k1 = w1
        q2 = turned(q, scale(0.5 * dt, k1))
        w2 = spin_of(body, q2, add_scaled(momentum, 0.5 * dt, l1))
        f2, t2 = _held(q2, start, force, in_body), _held(q2, start, torque, in_body)
        l2 = add(t2, load_torque(body, q2, load))
        k2 = rotation_vector_rate(scale(0.5 * dt, k1), w2)
        u = scale(0.5 * dt, k2)
        q3 = turned(q, u)
        w3 = spin_of(body, q3, add_scaled(momentum, 0.5 * dt, l2))
        f3, t3 = _held(q3, start, force, in_body), _held(q3, start, torque, in_body)
        l3 = add(t3, load_torque(body, q3, load))
        k3 = rotation_vector_rate(u, w3)
        u = scale(dt, k3)
        q4 = turned(q, u)
        w4 = spin_of(body, q4, add_scaled(momentum, dt, l3))
        f4, t4 = _held(q4, start, force, in_body), _held(q4, start, torque, in_body)
        l4 = add(t4, load_torque(body, q4, load))
        k4 = rotation_vector_rate(u, w4)

        c = dt * body.inverse_mass
        v2 = add_scaled(v, 0.5 * c, add(f1, outer))
        v3 = add_scaled(v, 0.5 * c, add(f2, outer))
        v4 = add_scaled(v, c, add(f3, outer))
        work += (dt / 6.0) * (
            dot(f1, v) + dot(t1, w1) + dot(f4, v4) + dot(t4, w4)
            + 2.0 * (dot(f2, v2) + dot(t2, w2) + dot(f3, v3) + dot(t3, w3))
        )  # fmt: skip
        x = add_scaled(x, dt / 6.0, add(add(v, v4), scale(2.0, add(v2, v3))))
        v = add_scaled(v, c, outer)
        v = add_scaled(v, c / 6.0, add(add(f1, f4), scale(2.0, add(f2, f3))))
        momentum = add_scaled(momentum, dt / 6.0, add(add(l1, l4), scale(2.0, add(l2, l3))))
        q = turned(q, scale(dt / 6.0, add(add(k1, k4), scale(2.0, add(k2, k3)))))
    return HeldStep(Motion(x, q, v, spin_of(body, q, momentum)), work)


@inline_function
def rotational_energy(body: Body, q: Quaternion, spin: Vector) -> float:
    """Kinetic energy of rotation, J."""
    w = into(matrix(q), spin)
    return 0.5 * dot(w, times(body.inertia, w))


@device_function
def semi_implicit_step(
    body: Body, m: Motion, force: Vector, torque: Vector, load: Load, h: float
) -> HeldStep:
    """One step of the semi-implicit plant: positions follow the new velocities; first order.

    The work is the change of kinetic energy without the work of gravity and load on the mean
    velocity, and without the energy that the rotation of the free body gains by its own in this
    integration.
    """
    outer = add(load.force, load.weight)
    velocity = add_scaled(m.velocity, h * body.inverse_mass, add(force, outer))
    q = turned(m.orientation, scale(h, m.spin))
    if not body.free:
        power = dot(force, m.velocity) + dot(torque, m.spin)
        return HeldStep(Motion(add_scaled(m.com, h, m.velocity), q, m.velocity, m.spin), h * power)
    known = load_torque(body, m.orientation, load)
    rate = angular_acceleration(body, m.orientation, m.spin, add(torque, known))
    spin = add_scaled(m.spin, h, rate)
    rate = angular_acceleration(body, m.orientation, m.spin, known)
    alone = add_scaled(m.spin, h, rate)
    q = turned(m.orientation, scale(h, spin))
    before = rotational_energy(body, m.orientation, m.spin)
    gained = rotational_energy(body, q, spin) - before
    gained -= 0.5 * h * dot(known, add(m.spin, spin))
    own = rotational_energy(body, turned(m.orientation, scale(h, alone)), alone) - before
    own -= 0.5 * h * dot(known, add(m.spin, alone))
    work = 0.5 * h * dot(force, add(m.velocity, velocity)) + gained - max(own, 0.0)
    return HeldStep(Motion(add_scaled(m.com, h, velocity), q, velocity, spin), work)
