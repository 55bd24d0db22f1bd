"""Stick or slip: the selection rule for friction and constraint reactions on the friction disc.

The solutions lie on a one-parameter curve from phi = 0 to stick (core/slip_curve.py). If several
exist, the rule is: after stick, stick if admissible; otherwise the root of least traction, and
stick only if there is no root. theta = 1/2 (second order) if the slip velocity does not turn too
far, s-.s+ > |s-|^2/4, else theta = 1.
"""

import math
from typing import NamedTuple

from cylconn_ros.core.friction import Array, Law, coefficient, contact, cosine, share_of
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.layout import JAMMED, SEVERAL_ROOTS, SLIP, STICK
from cylconn_ros.core.slip_curve import (
    DiscProblem,
    SlipCandidates,
    Two,
    first_root,
    last_root,
    phi_at,
    reaction,
    slip_candidates,
    stick_excess,
)


class DiscSolution(NamedTuple):
    """Friction phi, the slip velocity that it opposes, the regime and the flags."""

    phi: Two
    s_end: Two
    s_mean: Two  # s~
    regime: int
    flags: int


@inline_function
def solve_disc(law: Law, par: Array, d: DiscProblem, was_stick: bool) -> DiscSolution:
    """The solution by the selection rule."""
    end = slip_candidates(d, 1.0)
    if end.size == 0.0:
        return DiscSolution((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), STICK, 0)
    stick_admissible = stick_excess(law, par, d, end) >= 0.0
    if not (was_stick and stick_admissible):
        before = d.s_minus[0] ** 2 + d.s_minus[1] ** 2
        for attempt in range(2):
            theta = 0.5 if attempt == 0 else 1.0
            if theta < 1.0 and (was_stick or before == 0.0):
                continue
            c = slip_candidates(d, theta)
            if c.size == 0.0:
                continue
            r = first_root(law, par, d, c, stick_excess(law, par, d, c))
            if r == 0.0:
                continue
            phi, s_end, s_mean = _slip(d, c, theta, r)
            forward = d.s_minus[0] * s_end[0] + d.s_minus[1] * s_end[1]
            if theta < 1.0 and not forward > 0.25 * before:
                continue
            return DiscSolution(phi, s_end, s_mean, SLIP, SEVERAL_ROOTS if stick_admissible else 0)
    return _stick(law, par, d, end)


@inline_function
def solve_alternative(law: Law, par: Array, d: DiscProblem, slides: bool) -> DiscSolution:
    """The solution nearest to stick, or with ``slides`` that of least traction; theta = 1."""
    end = slip_candidates(d, 1.0)
    if end.size == 0.0:
        return DiscSolution((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), STICK, 0)
    excess = stick_excess(law, par, d, end)
    r = first_root(law, par, d, end, excess) if slides else 0.0
    if r == 0.0:
        if excess >= 0.0:
            return _stick(law, par, d, end)
        r = last_root(law, par, d, end)
    phi, s_end, s_mean = _slip(d, end, 1.0, r)
    return DiscSolution(phi, s_end, s_mean, SLIP, SEVERAL_ROOTS if excess >= 0.0 else 0)


@inline_function
def _slip(d: DiscProblem, c: SlipCandidates, theta: float, r: float) -> tuple[Two, Two, Two]:
    """phi, s+ and s~ of the root r."""
    phi = phi_at(d, c, r) if r < math.inf else (0.0, 0.0)
    # s+ from s~ if theta = 1: no cancellation as slip ends
    p, q = d.cos * phi[0] + d.sin * phi[1], d.cos * phi[1] - d.sin * phi[0]
    p, q = d.greater * p, d.lesser * q
    s_end = (d.s_free[0] + d.cos * p - d.sin * q, d.s_free[1] + d.sin * p + d.cos * q)
    s_mean = (
        (1.0 - theta) * d.s_minus[0] + theta * s_end[0],
        (1.0 - theta) * d.s_minus[1] + theta * s_end[1],
    )
    return phi, s_end, s_mean


@inline_function
def _stick(law: Law, par: Array, d: DiscProblem, end: SlipCandidates) -> DiscSolution:
    """The stick solution, s+ = 0; JAMMED if friction has no finite solution."""
    flags = 0
    phi = phi_at(d, end, 0.0)
    size = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1])
    grown = contact(law, reaction(d, phi)).normal - contact(law, d.base).normal
    mu = coefficient(law, par, 0.0, grown) * share_of(law, cosine(law, phi))
    if mu * grown >= size > 0.0:
        flags = JAMMED
    half = (0.5 * d.s_minus[0], 0.5 * d.s_minus[1])
    return DiscSolution(phi, (0.0, 0.0), half, STICK, flags)
