"""The least traction that goes with a slip direction at one instant: P = share limit(FN(P)).

FN is made of reactions that are linear in the traction, (f m)c = base + P by, so it is convex where
Fr + Fbend + FCint > 0. Newton's method from P = 0 then comes up to the least solution and does not
pass it; elsewhere steps of gap/(1 + greatest slope) do so. Where FN grows faster with P than
friction uses it up, there is no solution: a jam.
"""

import math

from cylconn_ros.core.compiled import inline, jit
from cylconn_ros.core.friction import Array, Law, coefficient, contact
from cylconn_ros.core.linear import Four

MOST_STEPS = 100


@inline
def moved(base: Four, by: Four, p: float) -> Four:
    """The reactions at the traction p."""
    return (base[0] + p * by[0], base[1] + p * by[1], base[2] + p * by[2], base[3] + p * by[3])


@jit
def least_traction(
    law: Law, par: Array, base: Four, by: Four, share: float, rate: float, most: float
) -> tuple[float, bool, float]:
    """The least P with P = share limit(FN(P)), at most ``most``; whether there is none (jam).

    Last comes its relative residual. ``rate``: the slip rate |s| for the coefficient.
    """
    growth = math.sqrt(by[0] * by[0] + by[1] * by[1])
    growth += law.bending * math.sqrt(by[2] * by[2] + by[3] * by[3])
    p, gap, size = 0.0, 0.0, 1.0
    for _ in range(MOST_STEPS):
        reaction = moved(base, by, p)
        at = contact(law, reaction)
        mu = coefficient(law, par, rate, at.normal)
        wanted = share * min(law.cap, mu * at.normal)
        gap, size = wanted - p, wanted + p
        if gap <= 1e-15 * size:
            break
        slope = -growth  # of FN, from below: for certain
        convex = law.force_slope == 0.0 and at.radial + at.bending + law.preload > 0.0
        if convex and mu * at.normal < law.cap:
            slope = 0.0
            if at.radial > 0.0:
                slope += (reaction[0] * by[0] + reaction[1] * by[1]) / at.radial
            if at.moment > 0.0:
                slope += law.bending * (reaction[2] * by[2] + reaction[3] * by[3]) / at.moment
        if share * mu * slope >= 1.0:  # grows faster than it is used up, ever more so: no root
            capped = share * law.cap
            return (capped, False, 0.0) if capped < most else (most, True, 0.0)
        p += gap / (1.0 - share * mu * slope)
        if p >= most:
            return most, False, 0.0
        p = min(p, share * law.cap)
    return min(p, most), False, max(gap, 0.0) / size if size > 0.0 else 0.0
