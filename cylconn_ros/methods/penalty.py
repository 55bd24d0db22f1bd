"""Unknown inertia: spring-dampers on the constraints, elastic stick on the available components.

    f_c = -k e - c w_c                     e the constraint's error, w_c its rate
    phi = -ks d - cs s,  |phi| <= mu FN    d the elastic slip, carried along by s
    p   = -k (x - xc) - c (w - vc)         of a lock or an imposed motion; of a stop pushing only

FN is made of this sample's f_c, so friction and reactions are of the same step; as neither depends
on the other through the (unknown) inertia, no system is solved. When phi leaves the disc it is
brought back radially and d is what the spring alone then holds. The wrench acts where it was
measured.

What a sampled spring can be: k <= m/h^2 and c of the order of m/h, with m the lighter body's mass.
It is the user's to choose, since only the user may know m. Restitution is what the damper makes it.
"""

import math

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, coefficient, contact, limit
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.joint_limits import (
    advance_imposed,
    imposed,
    imposed_force,
    locks,
    start_imposed,
)
from cylconn_ros.core.output_wrenches import write_contact, write_forces, write_wrenches
from cylconn_ros.core.relative_state import Observed, observe
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.vectors import scale, turned

STOPPED_AFTER = 3


@device_function
def step(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """One sample: (NSAMPLE,) in, (NOUT,) out, ``mem`` advanced; returns the flags."""
    o = observe(par, mem, sample, out)
    at = model.PENALTY
    k, kr, c, cr = par[at], par[at + 1], par[at + 2], par[at + 3]
    e, v, w = o.error, o.twist.v, o.twist.w
    constraint = (
        -k * e[0] - c * v[1],
        -k * e[1] - c * v[2],
        -kr * e[2] - cr * w[1],
        -kr * e[3] - cr * w[2],
    )
    return answer(par, mem, out, o, constraint, h)


@device_function
def answer(par: Array, mem: Array, out: Array, o: Observed, constraint: Four, h: float) -> int:
    """What goes with a constraint force (f2 f3 m2 m3) of unknown inertia: friction, wrenches."""
    v, w = o.twist.v, o.twist.w
    elastic = model.ELASTICITY
    ref = model.REFERENCE
    u1 = o.length - model.given(par[ref + 2], mem[model.LENGTH0])
    ur = o.angle - model.given(par[ref + 3], mem[model.ANGLE0])
    spring = (-par[elastic] * u1, -par[elastic + 1] * ur)
    damper = (-par[elastic + 2] * v[0], -par[elastic + 3] * w[0])
    friction, regime = _friction(par, mem, out, o, constraint, h)
    p1, stop1, lock1 = _reaction(par, mem, 0, o.length, v[0], h)
    p2, stop2, lock2 = _reaction(par, mem, 1, o.angle, w[0], h)
    drive1, drive2 = imposed_force(par, 0), imposed_force(par, 1)
    advance_imposed(par, mem, h)

    f1 = spring[0] + damper[0] + friction[0] + drive1 + p1
    m1 = spring[1] + damper[1] + friction[1] + drive2 + p2
    mem[model.LAST_TOTAL], mem[model.LAST_TOTAL + 1] = f1, m1
    mem[model.LAST_ACTUATION] = drive1 + (p1 if imposed(par, 0) else 0.0)
    mem[model.LAST_ACTUATION + 1] = drive2 + (p2 if imposed(par, 1) else 0.0)
    force = (f1, constraint[0], constraint[1])
    moment = (m1, constraint[2], constraint[3])
    write_forces(out, force, moment)
    out[out_at.FORCE_ELASTIC], out[out_at.MOMENT_ELASTIC] = spring
    out[out_at.FORCE_VISCOUS], out[out_at.MOMENT_VISCOUS] = damper
    out[out_at.FORCE_FRICTION], out[out_at.MOMENT_FRICTION] = friction
    out[out_at.FORCE_ACTUATION], out[out_at.MOMENT_ACTUATION] = drive1, drive2
    out[out_at.FORCE_REACTION], out[out_at.MOMENT_REACTION] = p1, p2
    out[out_at.STOP], out[out_at.LOCK] = stop1 | stop2 << 2, lock1 | lock2 << 1
    out[out_at.REGIME] = regime
    out[out_at.ACCUMULATED_SLIP] = mem[model.SLIPPED]
    out[out_at.STOP_TIME] = -1.0
    out[out_at.RESIDUAL] = 0.0
    flags = o.flags
    if mem[model.STUCK] >= STOPPED_AFTER:
        flags |= out_at.STOPPED
    body_a, body_b = o.body_a, o.body_b
    return flags | write_wrenches(
        par, mem, out, o.frame, force, moment, body_a, body_b, o.a, o.b,
        turned(o.a.orientation, scale(0.5 * h, o.a.spin)),
        turned(o.b.orientation, scale(0.5 * h, o.b.spin)),
    )  # fmt: skip


@device_function
def _reaction(
    par: Array, mem: Array, k: int, x: float, w: float, h: float
) -> tuple[float, int, int]:
    """Force of stops, lock or imposed motion on component k; which stop (1, 2) and lock (1)."""
    stiff, damp = par[model.PENALTY + k], par[model.PENALTY + 2 + k]
    rate = model.given(par[model.COMMAND + 3 * k + 1], 0.0)
    if int(par[model.LOCK]) == k + 1 and locks(par, mem, x, w, h):
        return -stiff * (x - mem[model.LOCKED_AT]) - damp * w, 0, 1
    start_imposed(par, mem, k, x)
    if imposed(par, k):
        return -stiff * (x - mem[model.IMPOSED_AT + k]) - damp * (w - rate), 0, 0
    below, above = x - par[model.STOPS + 2 * k], par[model.STOPS + 2 * k + 1] - x
    if below < 0.0:
        return max(-stiff * below - damp * w, 0.0), 1, 0
    if above < 0.0:
        return -max(-stiff * above + damp * w, 0.0), 2, 0
    return 0.0, 0, 0


@device_function
def _friction(
    par: Array,
    mem: Array,
    out: Array,
    o: Observed,
    constraint: Four,
    h: float,
) -> tuple[tuple[float, float], int]:
    """(f1f, m1f) and the regime; the return mapping onto the disc."""
    law = model.law(par)
    pressed = contact(law, constraint)
    if not law.on:
        write_contact(out, pressed, 0.0, 0.0, 0.0)
        return (0.0, 0.0), out_at.FRICTIONLESS
    ks, cs = par[model.PENALTY + 4], par[model.PENALTY + 5]
    s1, s2 = o.twist.v[0], law.radius * o.twist.w[0]
    rate = math.sqrt(s1 * s1 + s2 * s2)
    last = mem[model.LAST_PERIOD]
    d1 = mem[model.ELASTIC_SLIP] + last * s1
    d2 = mem[model.ELASTIC_SLIP + 1] + last * s2
    p, q = -ks * d1 - cs * s1, -ks * d2 - cs * s2
    size = math.sqrt(p * p + q * q)
    greatest = limit(law, par, 0.0, pressed.normal)
    regime = out_at.STICK
    if size > greatest:
        regime = out_at.SLIP
        greatest = limit(law, par, rate, pressed.normal)
        back = greatest / size
        p, q = back * p, back * q
        d1, d2 = -p / ks, -q / ks
        mem[model.SLIPPED] += rate * h
    mem[model.ELASTIC_SLIP], mem[model.ELASTIC_SLIP + 1] = d1, d2
    mem[model.STUCK] = mem[model.STUCK] + 1.0 if regime == out_at.STICK else 0.0
    mu = coefficient(law, par, rate if regime == out_at.SLIP else 0.0, pressed.normal)
    write_contact(out, pressed, mu, greatest, math.sqrt(p * p + q * q))
    return (p, law.radius * q), regime
