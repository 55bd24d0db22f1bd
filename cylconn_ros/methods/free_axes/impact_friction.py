"""Friction of an impact: the impulses at the instant of contact, divided over its two steps.

An impulse of a stop presses the joint against its shaft wherever it does not pass through the mass
centres: friction then has an impulse too, on the disc of the impulsive FN, against the slip after
the impact. The preload is finite and has no impulse; neither has friction whose force is capped.

Within the two steps that follow an impact (core/impacts.py) slip is not that of the ideal motion,
whose rates change at once. Friction is therefore that of the ideal motion,

    phi = phi- before the impact, phi+ after it, by their shares of the step,  + rho p

with the stop's force p, which the rate at the end of the step determines, and rho the ratio of
friction to the stop's impulse at the impact. The first moments of both impulses are then those of
the ideal motion, so that slide and spin are second order, as is the time of the impact.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array, without_preload
from cylconn_ros.core.friction_disc import solve_disc
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import Bounds, Two, eliminate_limits
from cylconn_ros.core.slip_curve import make_disc_problem
from cylconn_ros.methods.free_axes.complementarity import (
    FreeAxesSolution,
    ReducedStep,
    StepWithSprings,
    free_reactions,
)

BISECTIONS = 50
ROUNDING = 1e-14  # of the terms of the work: an elastic impact without friction gains none
SLACK = 1e-13  # relative, of rates that are compared with bounds


class Impulses(NamedTuple):
    """Impulses of an impact, and what follows from them."""

    restitution: float  # eps'
    ratio: Two  # rho: friction by the stop's impulse, N/N and N.m/N (N/(N.m), 1 for spin)
    after: Two  # rates of slide and spin after the impact
    certain: bool  # whether the stop pushes


class ImpactFriction(NamedTuple):
    """Friction of a step of an impact."""

    acts: bool
    smooth: Two  # N, N.m: without the impact's share
    ratio: Two  # rho
    rates: Two  # of slide and spin at the impact
    before: Two  # phi-, N and N.m
    after: Two  # phi+


NO_IMPACT = ImpactFriction(False, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


@device_function
def _impulses_with(
    par: Array, r: ReducedStep, rates: Two, k: int, eps: float, other_fixed: bool
) -> tuple[float, Two, Two, float]:
    """The stop's impulse and that of friction (N.s/h, N.m.s/h), rates after it, and their work."""
    law = model.law(par)
    sides = (1, 1) if other_fixed else ((1, 0) if k == 0 else (0, 1))
    target = (-eps * rates[0], rates[1]) if k == 0 else (rates[0], -eps * rates[1])
    active = eliminate_limits(rates, r.a, sides, target)
    f, m = 0.0, 0.0
    if law.on and law.cap == math.inf:
        radius = law.radius
        base = free_reactions(r, active.q0[0], active.q0[1])
        by_p = free_reactions(r, active.q1[0], active.q1[1])
        by_q = free_reactions(r, radius * active.q2[0], radius * active.q2[1])
        s_free = (active.free[0], radius * active.free[1])
        d = make_disc_problem(
            (0.0, 0.0), s_free, active.s[0], radius * active.s[1],
            radius * radius * active.s[2], base, by_p, by_q,
        )  # fmt: skip
        found = solve_disc(without_preload(law), par, d, False)
        f, m = found.phi[0], radius * found.phi[1]
    x = (
        active.q0[0] + active.q1[0] * f + active.q2[0] * m,
        active.q0[1] + active.q1[1] * f + active.q2[1] * m,
    )
    after = (
        active.free[0] + active.s[0] * f + active.s[1] * m,
        active.free[1] + active.s[1] * f + active.s[2] * m,
    )
    stop = x[0] - f if k == 0 else x[1] - m
    work = x[0] * (rates[0] + after[0]) + x[1] * (rates[1] + after[1])
    terms = abs(x[0]) * (abs(rates[0]) + abs(after[0])) + abs(x[1]) * (
        abs(rates[1]) + abs(after[1])
    )
    return stop, (f, m), after, work - ROUNDING * terms


@device_function
def impulses(
    par: Array, r: ReducedStep, rates: Two, k: int, side: int, eps: float, other_fixed: bool
) -> Impulses:
    """The impact of component k at its lower (side -1) or upper (1) stop, with ``rates`` before it.

    Its restitution is the largest <= eps for which the impact does not increase the kinetic
    energy: friction and coupled inertias could otherwise add some.
    """
    low, high, now = 0.0, eps, eps
    stop, friction, after, work = _impulses_with(par, r, rates, k, now, other_fixed)
    for _ in range(BISECTIONS):
        if work <= 0.0:
            low = now
        else:
            high = now
        if low == eps or eps == 0.0 or high - low <= 1e-15 * eps:
            break
        now = 0.5 * (low + high)
        stop, friction, after, work = _impulses_with(par, r, rates, k, now, other_fixed)
    pushes = stop * side < 0.0
    ratio = (friction[0] / stop, friction[1] / stop) if pushes else (0.0, 0.0)
    return Impulses(now, ratio, after, pushes)


@inline_function
def shared(share: float, before: Two, after: Two) -> Two:
    """Friction of a step of which ``share`` passes before the impact."""
    share = min(max(share, 0.0), 1.0)
    return (
        share * before[0] + (1.0 - share) * after[0],
        share * before[1] + (1.0 - share) * after[1],
    )


@inline_function
def _is_held(b: Bounds) -> bool:
    return b.low == b.high


@device_function
def solve_impact(
    par: Array, rates: Two, sp: StepWithSprings, k: int, b1: Bounds, b2: Bounds, c: ImpactFriction
) -> tuple[FreeAxesSolution, tuple[int, int], bool]:
    """The step of an impact of component k with its friction.

    Returns the solution, the side of each component, and whether it holds: not where the stop would
    have to pull, or where the other component is at a stop as well.
    """
    s11, s12, s22 = sp.s
    b, other = (b1, b2) if k == 0 else (b2, b1)
    side = b.impact
    t = b.low if side < 0 else b.high
    fixed = _is_held(other)
    f0 = (
        sp.free[0] + s11 * c.smooth[0] + s12 * c.smooth[1],
        sp.free[1] + s12 * c.smooth[0] + s22 * c.smooth[1],
    )
    u = (c.ratio[0] + 1.0, c.ratio[1]) if k == 0 else (c.ratio[0], c.ratio[1] + 1.0)
    by = (s11 * u[0] + s12 * u[1], s12 * u[0] + s22 * u[1])  # rates by the stop's force
    if not fixed:
        p = (t - f0[k]) / by[k]
        x = 0.0
    else:
        j = 1 - k
        own = s11 if j == 0 else s22
        d_k, d_j = t - f0[k], other.low - f0[j]
        det = by[k] * own - s12 * by[j]
        p, x = (d_k * own - s12 * d_j) / det, (by[k] * d_j - by[j] * d_k) / det
    reaction = (p, x) if k == 0 else (x, p)
    friction = (c.smooth[0] + c.ratio[0] * p, c.smooth[1] + c.ratio[1] * p)
    end = (
        f0[0] + by[0] * p + (s11 if k == 1 else s12) * x,
        f0[1] + by[1] * p + (s12 if k == 1 else s22) * x,
    )
    end = (t, end[1]) if k == 0 else (end[0], t)
    if fixed:
        end = (end[0], other.low) if k == 0 else (other.low, end[1])
    law = model.law(par)
    mean = (0.5 * (rates[0] + end[0]), 0.5 * law.radius * (rates[1] + end[1]))
    away = end[1] if k == 0 else end[0]
    slack = SLACK * abs(away)
    free = fixed or (other.low - slack <= away <= other.high + slack)
    sides = (side, -1 if fixed else 0) if k == 0 else (-1 if fixed else 0, side)
    found = FreeAxesSolution(end, friction, reaction, layout.SLIP, 0, mean, 0.0)
    return found, sides, free and by[k] > 0.0 and p * side < 0.0
