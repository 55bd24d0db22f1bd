"""Method penalty, unknown inertia: spring-dampers on the constraints, elastic stick.

    f_c = -k e - c w_c                     e the constraint's error, w_c its rate
    phi = -ks d - cs s,  |phi| <= mu FN    d the elastic slip, integrated from s
    p   = -k (x - xc) - c (w - vc)         of a lock or a drive (methods/drives/spring.py); of a
                                           rigid stop: pushing only

FN follows from this sample's f_c, so that friction and reactions belong to the same step. Neither
depends on the other through the (unknown) inertia, so that no system is solved. If phi is outside
the disc, it is returned radially, and d becomes the elongation at which the spring alone carries
phi. The wrench acts in the configuration at the half of the step: held as at its start, the force
that turns a body round points ahead of it on the mean and feeds its rotation, by (|w| h)^2 of the
energy in each step. A semi-implicit plant takes it as at the start.

Gains that put in energy are lowered (methods/passivity_controller.py): of the constraint, and of
stick, stops, locks and drives on slide and spin. Gains that suit one position can be too great in
another, where the slide has lengthened an arm. They stay where known wrenches act late, as the
energy that late springs return is not theirs.

A sampled spring is stable for k <= m/h^2 and c of the order of m/h, with m the mass of the lighter
body. The user chooses the gains, since the connector does not know m. Restitution follows from the
damper.
"""

import math

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import adapts_gains, feedback_gain
from cylconn_ros.core.friction import Array, coefficient, contact, cosine, limit, share_of
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import (
    advance_imposed_motion,
    imposed_force,
    is_motion_imposed,
    start_imposed_motion,
    stop_bits,
    update_lock,
)
from cylconn_ros.core.kinematics import frame
from cylconn_ros.core.output_wrenches import write_contact, write_forces, write_wrenches
from cylconn_ros.core.relative_state import RelativeState, measure
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.vectors import add_scaled, scale, turned
from cylconn_ros.methods import passivity_controller
from cylconn_ros.methods.drives.spring import drive_force, is_moved_from
from cylconn_ros.methods.passivity_controller import OUT_OF_NOISE, Two
from cylconn_ros.methods.sampled_elements import elongation, sampled_elements


@device_function
def step(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Compute one step: sample (NSAMPLE,), out (NOUT,), ``mem`` updated; returns the flags."""
    o = measure(par, mem, sample, h, out)
    at = model.PENALTY
    e, v, w = o.error, o.twist.v, o.twist.w
    watch_free_axes(par, mem, o)
    watch_constraint(par, mem, o, 0.0)
    if adapts_gains(par, mem):
        passivity_controller.watch_reversals(mem, passivity_controller.section(0), (v[1], v[2]))
        passivity_controller.watch_reversals(mem, passivity_controller.section(1), (w[1], w[2]))
    y, z, low = _block(par, mem, 0, par[at], par[at + 2], (e[0], e[1]), (v[1], v[2]))
    m2, m3, low_too = _block(par, mem, 1, par[at + 1], par[at + 3], (e[2], e[3]), (w[1], w[2]))
    flags = write_outputs(par, mem, out, o, (y, z, m2, m3), h)
    if low or low_too:
        flags |= layout.GAINS_LOWERED
    return flags


@inline_function
def shares(par: Array, mem: Array, block: int) -> tuple[float, float]:
    """Shares of stiffness and damping in use, of offsets (block 0) or swings (1)."""
    alpha = feedback_gain(par, mem)
    k, c = alpha * alpha, alpha
    if adapts_gains(par, mem):
        lowered = passivity_controller.shares(mem, passivity_controller.section(block))
        k, c = lowered[0] * k, lowered[1] * c
    return k, c


@inline_function
def _free_axis_shares(par: Array, mem: Array, k: int) -> tuple[float, float]:
    """Shares of stiffness and damping in use on slide (k = 0) or spin (1)."""
    stiff, damp = shares(par, mem, k)
    if adapts_gains(par, mem):
        lowered = passivity_controller.shares(mem, passivity_controller.section(2 + k))
        stiff, damp = lowered[0] * stiff, lowered[1] * damp
    return stiff, damp


@device_function
def watch_constraint(par: Array, mem: Array, o: RelativeState, least: float) -> None:
    """Lower the gains of the constraint if an oscillation of an offset or a swing grows.

    The rate must reach OUT_OF_NOISE times ``least`` (m/s, rad/s).
    """
    if adapts_gains(par, mem):
        v, w, grows = o.twist.v, o.twist.w, False
        for k in range(4):
            rate = v[1 + k] if k < 2 else w[k - 1]
            at = passivity_controller.section(4 + k)
            grows = passivity_controller.watch(mem, at, rate, OUT_OF_NOISE**2, least) or grows
        if grows:
            passivity_controller.lower(mem, passivity_controller.section(0))
            passivity_controller.lower(mem, passivity_controller.section(1))
            for k in range(4):  # what grew before the gains were lowered does not count again
                at = passivity_controller.section(4 + k)
                mem[at + passivity_controller.GROWN] = mem[at + passivity_controller.LAST_PEAK] = (
                    0.0
                )


@inline_function
def watch_free_axes(par: Array, mem: Array, o: RelativeState) -> None:
    """Lower the gains of stick, stops, locks and drives on slide and spin if they put in energy."""
    if adapts_gains(par, mem):
        slide, spin = passivity_controller.section(2), passivity_controller.section(3)
        passivity_controller.watch_reversals(mem, slide, (o.twist.v[0], 0.0))
        passivity_controller.watch_reversals(mem, spin, (o.twist.w[0], 0.0))


@inline_function
def _are_lowered(par: Array, mem: Array) -> bool:
    """Whether gains on slide or spin are lowered."""
    slide, spin = passivity_controller.section(2), passivity_controller.section(3)
    at = passivity_controller.DAMPING_REDUCTION
    return adapts_gains(par, mem) and (mem[slide + at] > 0.0 or mem[spin + at] > 0.0)


@inline_function
def _block(
    par: Array, mem: Array, block: int, k: float, c: float, e: Two, w: Two
) -> tuple[float, float, bool]:
    """Constraint force on offsets (block 0) or swings (1); whether gains were lowered."""
    soft, damp = shares(par, mem, block)
    k, c = soft * k, damp * c
    low = adapts_gains(par, mem) and (soft < 1.0 or damp < 1.0)
    return -k * e[0] - c * w[0], -k * e[1] - c * w[1], low


@device_function
def write_outputs(
    par: Array, mem: Array, out: Array, o: RelativeState, constraint: Four, h: float
) -> int:
    """Write friction, wrenches and state for a constraint force (f2 f3 m2 m3); the flags."""
    v, w = o.twist.v, o.twist.w
    elastic = model.ELASTICITY
    u1, ur = elongation(par, mem, o, h, 0)[0], elongation(par, mem, o, h, 1)[0]
    spring = (-par[elastic] * u1, -par[elastic + 1] * ur)
    damper = (-par[elastic + 2] * v[0], -par[elastic + 3] * w[0])
    one, two = sampled_elements(par, mem, o, h, 0), sampled_elements(par, mem, o, h, 1)
    spring = (spring[0] + one.spring, spring[1] + two.spring)
    damper = (damper[0] + one.damper, damper[1] + two.damper)
    friction, regime = _friction(par, mem, out, o, constraint, h)
    p1, stop1, lock1, moved1, blocked1 = _limit_force(par, mem, 0, o.length, v[0], h)
    p2, stop2, lock2, moved2, blocked2 = _limit_force(par, mem, 1, o.angle, w[0], h)
    p1, p2 = p1 + one.stop, p2 + two.stop
    stop1, stop2 = stop1 | stop_bits(one.side), stop2 | stop_bits(two.side)
    drive1, drive2 = imposed_force(par, 0), imposed_force(par, 1)
    advance_imposed_motion(par, mem, h)

    f1 = spring[0] + damper[0] + friction[0] + drive1 + p1
    m1 = spring[1] + damper[1] + friction[1] + drive2 + p2
    mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1] = f1, m1
    mem[model.LAST_ACTUATION] = drive1 + moved1
    mem[model.LAST_ACTUATION + 1] = drive2 + moved2
    force = (f1, constraint[0], constraint[1])
    moment = (m1, constraint[2], constraint[3])
    write_forces(out, force, moment)
    out[layout.FORCE_ELASTIC], out[layout.MOMENT_ELASTIC] = spring
    out[layout.FORCE_VISCOUS], out[layout.MOMENT_VISCOUS] = damper
    out[layout.FORCE_FRICTION], out[layout.MOMENT_FRICTION] = friction
    out[layout.FORCE_ACTUATION], out[layout.MOMENT_ACTUATION] = drive1, drive2
    out[layout.FORCE_REACTION], out[layout.MOMENT_REACTION] = p1, p2
    out[layout.STOP], out[layout.LOCK] = stop1 | stop2 << 2, lock1 | lock2 << 1
    out[layout.REGIME] = regime
    out[layout.ACCUMULATED_SLIP] = mem[model.ACCUMULATED_SLIP]
    out[layout.STOP_TIME] = -1.0
    out[layout.RESIDUAL] = 0.0
    flags = o.flags
    if blocked1 or blocked2:
        flags |= layout.DRIVE_BLOCKED
    if _are_lowered(par, mem):
        flags |= layout.GAINS_LOWERED
    if mem[model.STICK_SAMPLES] >= layout.STOPPED_SAMPLES:
        flags |= layout.STOPPED
    a, b, acting = o.a, o.b, o.frame
    half_a = turned(a.orientation, scale(0.5 * h, a.spin))
    half_b = turned(b.orientation, scale(0.5 * h, b.spin))
    if not model.output(par).semi_implicit:  # in the middle of the step, see above
        acting = frame(
            o.nodes,
            Motion(add_scaled(a.com, 0.5 * h, a.velocity), half_a, a.velocity, a.spin),
            Motion(add_scaled(b.com, 0.5 * h, b.velocity), half_b, b.velocity, b.spin),
        )
    return flags | write_wrenches(
        par, mem, out, acting, force, moment, o.body_a, o.body_b, a, b, half_a, half_b, 1.0
    )


@device_function
def _limit_force(
    par: Array, mem: Array, k: int, x: float, w: float, h: float
) -> tuple[float, int, int, float, bool]:
    """Force of stops, lock and drive on component k.

    Also which stop (1, 2) and lock (1) acts, the part of the drive, and whether stop or lock holds
    the component against it.
    """
    soft, slow = _free_axis_shares(par, mem, k)
    stiff, damp = soft * par[model.PENALTY + k], slow * par[model.PENALTY + 2 + k]
    if int(par[model.LOCK]) == k + 1 and update_lock(par, mem, x, w, h):
        at = mem[model.LOCK_POSITION]
        blocked = is_motion_imposed(par, k) and is_moved_from(par, k, at)
        return -stiff * (x - at) - damp * w, 0, 1, 0.0, blocked
    start_imposed_motion(par, mem, k, x)
    if is_motion_imposed(par, k):
        held = drive_force(par, mem, k, x, w, h, stiff, damp)
        stop, side = _stop_force(par, k, x, w, stiff, damp)
        if abs(stop) > abs(held.force):
            against = stop * model.value_or(par[model.COMMAND + 3 * k + 1], 0.0) < 0.0
            return stop, side, 0, 0.0, held.blocked or against
        return held.force, held.stop, 0, held.force, held.blocked
    force, side = _stop_force(par, k, x, w, stiff, damp)
    return force, side, 0, 0.0, False


@inline_function
def _stop_force(
    par: Array, k: int, x: float, w: float, stiff: float, damp: float
) -> tuple[float, int]:
    """Force of the stops of component k, and which one acts (1, 2)."""
    below, above = x - par[model.STOPS + 2 * k], par[model.STOPS + 2 * k + 1] - x
    if below < 0.0:
        return max(-stiff * below - damp * w, 0.0), 1
    if above < 0.0:
        return -max(-stiff * above + damp * w, 0.0), 2
    return 0.0, 0


@device_function
def _friction(
    par: Array,
    mem: Array,
    out: Array,
    o: RelativeState,
    constraint: Four,
    h: float,
) -> tuple[tuple[float, float], int]:
    """(f1f, m1f) and the regime by a return mapping onto the friction disc."""
    law = model.law(par)
    pressed = contact(law, constraint)
    if not law.on:
        write_contact(out, pressed, 0.0, 0.0, 0.0)
        return (0.0, 0.0), layout.FRICTIONLESS
    (soft, slow), of_spin = _free_axis_shares(par, mem, 0), _free_axis_shares(par, mem, 1)
    soft, slow = min(soft, of_spin[0]), min(slow, of_spin[1])
    ks, cs = soft * par[model.PENALTY + 4], slow * par[model.PENALTY + 5]
    s1, s2 = o.twist.v[0], law.radius * o.twist.w[0]
    rate = math.sqrt(s1 * s1 + s2 * s2)
    last = mem[model.LAST_PERIOD]
    d1 = mem[model.ELASTIC_SLIP] + last * s1
    d2 = mem[model.ELASTIC_SLIP + 1] + last * s2
    p, q = -ks * d1 - cs * s1, -ks * d2 - cs * s2
    size = math.sqrt(p * p + q * q)
    c = cosine(law, (p, q))
    greatest = limit(law, par, 0.0, pressed.normal, c)
    regime = layout.STICK
    if size > greatest:
        regime = layout.SLIP
        greatest = limit(law, par, rate, pressed.normal, c)
        back = greatest / size
        p, q = back * p, back * q
        d1, d2 = -p / ks, -q / ks
        mem[model.ACCUMULATED_SLIP] += rate * h
    mem[model.ELASTIC_SLIP], mem[model.ELASTIC_SLIP + 1] = d1, d2
    mem[model.STICK_SAMPLES] = mem[model.STICK_SAMPLES] + 1.0 if regime == layout.STICK else 0.0
    mu = coefficient(law, par, rate if regime == layout.SLIP else 0.0, pressed.normal)
    mu *= share_of(law, c)
    write_contact(out, pressed, mu, greatest, math.sqrt(p * p + q * q))
    return (p, law.radius * q), regime
