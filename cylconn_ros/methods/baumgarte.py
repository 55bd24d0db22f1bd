r"""Method baumgarte, known inertia: accelerations, Baumgarte's feedback, regularised friction.

    M a = applied + J^T Lambda                         at the sample, then held over the period
    (J a + J' v)_c = -2 alpha w_c - beta^2 e           e the constraint's error, w_c its rate
    phi = -mu FN s / sqrt(s^2 + v0^2)                  s the sample's slip velocity

The constraint differentiated twice drifts; the feedback turns the drift into a damped oscillation
(J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1, 1972). alpha = beta = 0.2/h unless given:
critical damping, and within the stability bound of a held force, beta^2 h/4 < alpha < 1/h.

FN follows from the reactions of the same instant, and these depend on friction: one scalar equation
along -s for the traction P, whose least solution is used (core/traction.py).

Limitations: no stick. Below v0 the law is viscous, so that a loaded sleeve creeps. Since the slip
velocity is that of the sample, friction is limited to the force that removes the slip within the
period: with a small v0 a load creeps at the speed that it gains in a period. If no finite P exists
(jam), this bound acts. There are no rigid stops, locks or imposed motion, since events cannot be
expressed by an acceleration. First order, since the wrench is that of the start of the period.
"""

import math

from cylconn_ros.core import layout, model
from cylconn_ros.core.delassus import in_swing_axes, of_body, sum_of_bodies
from cylconn_ros.core.delay import feedback_gain
from cylconn_ros.core.friction import Array, coefficient, contact, limit, share_of
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.joint_limits import imposed_force, stop_bits
from cylconn_ros.core.kinematics import Frame, Twist, into_swung
from cylconn_ros.core.output_wrenches import write_contact, write_forces, write_wrenches
from cylconn_ros.core.relative_state import RelativeState, measure
from cylconn_ros.core.rigid_body import Body, Motion, angular_acceleration
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.traction import least_traction, reactions_at
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
    turned,
)
from cylconn_ros.methods.free_axes.complementarity import ReducedStep, reactions
from cylconn_ros.methods.impulse import constraint_residual, correction_rate, eliminate_constraint
from cylconn_ros.methods.sampled_elements import elongation, sampled_elements

FEEDBACK = 0.2  # default of alpha h and beta h


@device_function
def step(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Compute one step: sample (NSAMPLE,), out (NOUT,), ``mem`` updated; returns the flags."""
    o = measure(par, mem, sample, h, out)
    body_a, body_b = o.body_a, o.body_b
    f = o.frame
    g = in_swing_axes(
        sum_of_bodies(
            of_body(body_a, f.axes, o.a.orientation, f.arm_a),
            of_body(body_b, f.axes, o.b.orientation, f.arm_b),
        ),
        f.swing,
    )
    free = _relative_acceleration(
        f, o,
        _acceleration(par, body_a, o.a, sample, layout.A_LOAD),
        _acceleration(par, body_b, o.b, sample, layout.B_LOAD),
    )  # fmt: skip
    none = Twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    target, far = _target(par, o, h, feedback_gain(par, mem))
    r = eliminate_constraint(g, free, none, target, 1.0)

    at = model.ELASTICITY
    u1, ur = elongation(par, mem, o, h, 0)[0], elongation(par, mem, o, h, 1)[0]
    spring = (-par[at] * u1, -par[at + 1] * ur)
    damper = (-par[at + 2] * o.twist.v[0], -par[at + 3] * o.twist.w[0])
    drive = (imposed_force(par, 0), imposed_force(par, 1))
    mem[model.LAST_ACTUATION], mem[model.LAST_ACTUATION + 1] = drive
    one, two = sampled_elements(par, mem, o, h, 0), sampled_elements(par, mem, o, h, 1)
    spring = (spring[0] + one.spring, spring[1] + two.spring)
    damper = (damper[0] + one.damper, damper[1] + two.damper)
    push = (
        spring[0] + damper[0] + drive[0] + one.stop,
        spring[1] + damper[1] + drive[1] + two.stop,
    )
    friction, flags, residual = _friction(par, mem, out, o, r, push, h)

    f1, m1 = push[0] + friction[0], push[1] + friction[1]
    c = reactions(r, f1, m1)
    force, moment = (f1, c[0], c[1]), (m1, c[2], c[3])
    write_forces(out, force, moment)
    out[layout.FORCE_ELASTIC], out[layout.MOMENT_ELASTIC] = spring
    out[layout.FORCE_VISCOUS], out[layout.MOMENT_VISCOUS] = damper
    out[layout.FORCE_FRICTION], out[layout.MOMENT_FRICTION] = friction
    out[layout.FORCE_ACTUATION], out[layout.MOMENT_ACTUATION] = drive
    out[layout.FORCE_REACTION], out[layout.MOMENT_REACTION] = one.stop, two.stop
    out[layout.STOP] = stop_bits(one.side) | stop_bits(two.side) << 2
    out[layout.ACCUMULATED_SLIP] = mem[model.ACCUMULATED_SLIP]
    out[layout.STOP_TIME] = -1.0
    out[layout.RESIDUAL] = max(
        residual, constraint_residual(g, free, none, target, force, moment, 1.0)
    )
    flags |= o.flags
    if far:
        flags |= layout.MISALIGNED
    if mem[model.STICK_SAMPLES] >= layout.STOPPED_SAMPLES:
        flags |= layout.STOPPED
    return flags | write_wrenches(
        par, mem, out, f, force, moment, body_a, body_b, o.a, o.b,
        turned(o.a.orientation, scale(0.5 * h, o.a.spin)),
        turned(o.b.orientation, scale(0.5 * h, o.b.spin)), 1.0,
    )  # fmt: skip


@device_function
def _acceleration(
    par: Array, body: Body, m: Motion, sample: Array, at: int
) -> tuple[Vector, Vector]:
    """Linear and angular acceleration under gravity and the load at index ``at``."""
    if not body.free:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    load = model.vector(sample, at)
    arm = out_of(matrix(m.orientation), body.com)
    torque = sub(model.vector(sample, at + 3), cross(arm, load))
    linear = add_scaled(model.vector(par, model.GRAVITY), body.inverse_mass, load)
    return linear, angular_acceleration(body, m.orientation, m.spin, torque)


@device_function
def _relative_acceleration(
    f: Frame, o: RelativeState, a: tuple[Vector, Vector], b: tuple[Vector, Vector]
) -> Twist:
    """J a + J' v: the rates of the relative twist."""
    wa, wb = o.a.spin, o.b.spin
    at_b = add(add(b[0], cross(b[1], f.arm_b)), cross(wb, cross(wb, f.arm_b)))
    at_a = add(add(a[0], cross(a[1], f.arm_a)), cross(wa, cross(wa, f.arm_a)))
    coriolis = scale(2.0, cross(wa, out_of(f.axes, o.twist.v)))
    return Twist(
        into(f.axes, sub(sub(at_b, at_a), coriolis)),
        into_swung(f, sub(sub(b[1], a[1]), cross(wa, wb))),
    )


@device_function
def _target(par: Array, o: RelativeState, h: float, gain: float) -> tuple[Four, bool]:
    """-2 alpha w - beta^2 e, with the correction limited to the pull-in speed; whether it is."""
    alpha = gain * model.value_or(par[model.BAUMGARTE], FEEDBACK / h)
    beta = gain * model.value_or(par[model.BAUMGARTE + 1], FEEDBACK / h)
    e, v, w = o.error, o.twist.v, o.twist.w
    settling = 2.0 * alpha / (beta * beta)  # s: e/settling is the speed of the approach
    y, z, far = correction_rate(e[0], e[1], settling, par[model.PULL_IN])
    p2, p3, far_too = correction_rate(e[2], e[3], settling, par[model.PULL_IN + 1])
    return (
        2.0 * alpha * (y - v[1]),
        2.0 * alpha * (z - v[2]),
        2.0 * alpha * (p2 - w[1]),
        2.0 * alpha * (p3 - w[2]),
    ), far or far_too


@device_function
def _friction(
    par: Array,
    mem: Array,
    out: Array,
    o: RelativeState,
    r: ReducedStep,
    push: tuple[float, float],
    h: float,
) -> tuple[tuple[float, float], int, float]:
    """(f1f, m1f), JAMMED if no finite force exists, and the residual of the scalar equation."""
    law = model.law(par)
    base = reactions(r, push[0], push[1])
    if not law.on:
        out[layout.REGIME] = layout.FRICTIONLESS
        write_contact(out, contact(law, base), 0.0, 0.0, 0.0)
        return (0.0, 0.0), 0, 0.0
    radius, v0 = law.radius, par[model.BAUMGARTE + 2]
    s1, s2 = o.twist.v[0], radius * o.twist.w[0]
    rate = math.sqrt(s1 * s1 + s2 * s2)
    traction, flags, residual, most = 0.0, 0, 0.0, 0.0
    along, around = 0.0, 0.0
    if rate > 0.0:
        along, around = s1 / rate, s2 / rate
        x, y = r.by_f1, r.by_m1
        p, q = -along, -around * radius
        by = (
            p * x[0] + q * y[0], p * x[1] + q * y[1], p * x[2] + q * y[2], p * x[3] + q * y[3],
        )  # fmt: skip
        a11, a12, a22 = r.a[0], radius * r.a[1], radius * radius * r.a[2]
        most = rate / (h * (along * (a11 * along + 2.0 * a12 * around) + around * a22 * around))
        share = rate / math.sqrt(rate * rate + v0 * v0)
        traction, jammed, residual = least_traction(law, par, base, by, share, rate, along, most)
        flags = layout.JAMMED if jammed else 0
    pressed = contact(law, reactions_at(base, by, traction) if rate > 0.0 else base)
    holds = rate <= v0 or traction >= most
    out[layout.REGIME] = layout.STICK if holds else layout.SLIP
    mem[model.STICK_SAMPLES] = mem[model.STICK_SAMPLES] + 1.0 if holds else 0.0
    mem[model.ACCUMULATED_SLIP] += rate * h
    mu = coefficient(law, par, rate, pressed.normal) * share_of(law, along)
    greatest = limit(law, par, rate, pressed.normal, along)
    write_contact(out, pressed, mu, greatest, traction)
    return (-traction * along, -traction * around * radius), flags, residual
