"""The least traction that goes with a slip direction at one instant: P = share limit(FN(P)).

FN = |F|, F = Fr + Fbend + FCint, is made of reactions that are linear in the traction, (f m)c =
base + P by, so that F is convex in P. Of g = share mu FN - P, positive at P = 0, the first zero:

    F(0) >= 0    g is convex up to it: Newton's method comes up from P = 0 and does not pass it;
                 where g stops falling first there is none (jam)
    F(0) < 0     -share mu F - P is concave and has no other zero: Newton's method comes down to it
    mu over FN   a table: steps of g/(1 + greatest slope) come up to it and do not pass it
"""

import math

from cylconn_ros.core.friction import Array, Contact, Law, coefficient, contact
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import Four

MOST_STEPS = 200
EXACT = 1e-15


@inline_function
def moved(base: Four, by: Four, p: float) -> Four:
    """The reactions at the traction p."""
    return (base[0] + p * by[0], base[1] + p * by[1], base[2] + p * by[2], base[3] + p * by[3])


@inline_function
def _slope(law: Law, at: Contact, reaction: Four, by: Four) -> float:
    """DF/dP."""
    slope = 0.0
    if at.radial > 0.0:
        slope += (reaction[0] * by[0] + reaction[1] * by[1]) / at.radial
    if at.moment > 0.0:
        slope += law.bending * (reaction[2] * by[2] + reaction[3] * by[3]) / at.moment
    return slope


@device_function
def least_traction(
    law: Law, par: Array, base: Four, by: Four, share: float, rate: float, most: float
) -> tuple[float, bool, float]:
    """The least P with P = share limit(FN(P)), at most ``most``; whether there is none (jam).

    Last comes its relative residual. ``rate``: the slip rate |s| for the coefficient.
    """
    most = min(most, share * law.cap)
    at = contact(law, base)
    if law.force_slope > 0.0:
        return _over_table(law, par, base, by, share, rate, most)
    factor = share * coefficient(law, par, rate, at.normal)
    if at.radial + at.bending + law.preload < 0.0:
        return _relieved(law, base, by, factor, most)
    p, residual = 0.0, 0.0
    for _ in range(MOST_STEPS):
        reaction = moved(base, by, p)
        at = contact(law, reaction)
        wanted = factor * at.normal
        residual = (wanted - p) / (wanted + p) if wanted + p > 0.0 else 0.0
        if residual <= EXACT:
            break
        falling = 1.0 - factor * _slope(law, at, reaction, by)
        if falling <= 0.0:
            return most, most != share * law.cap, 0.0
        p += (wanted - p) / falling
        if p >= most:
            return most, False, 0.0
    return p, False, abs(residual)


@device_function
def _relieved(
    law: Law, base: Four, by: Four, factor: float, most: float
) -> tuple[float, bool, float]:
    """As `least_traction`, where the preload relieves the contact, F(0) < 0."""
    p, residual = min(most, -factor * law.preload), 0.0  # beyond the zero, since F >= FCint
    for _ in range(MOST_STEPS):
        reaction = moved(base, by, p)
        at = contact(law, reaction)
        wanted = -factor * (at.radial + at.bending + law.preload)
        gap = p - wanted
        residual = gap / (abs(wanted) + p) if p > 0.0 else 0.0
        if residual <= EXACT:
            break  # also where it is not reached at all: p is still ``most``
        p -= gap / (1.0 + factor * _slope(law, at, reaction, by))
    return p, False, max(residual, 0.0)


@device_function
def _over_table(
    law: Law, par: Array, base: Four, by: Four, share: float, rate: float, most: float
) -> tuple[float, bool, float]:
    """As `least_traction`, for a coefficient that depends on FN."""
    growth = math.sqrt(by[0] * by[0] + by[1] * by[1])
    growth += law.bending * math.sqrt(by[2] * by[2] + by[3] * by[3])
    p, residual = 0.0, 0.0
    for _ in range(MOST_STEPS):
        normal = contact(law, moved(base, by, p)).normal
        mu = coefficient(law, par, rate, normal)
        gap = share * mu * normal - p
        residual = gap / (gap + 2.0 * p) if gap + p > 0.0 else 0.0
        if residual <= EXACT:
            break
        grown = growth * gap  # the step is shorter than gap
        steepest = mu + law.force_slope * grown + law.force_slope * (normal + grown)
        p += gap / (1.0 + share * steepest * growth)
        if p >= most:
            return most, False, 0.0
    return p, False, max(residual, 0.0)
