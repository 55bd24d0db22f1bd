"""The least traction for a given slip direction at one instant: P = share limit(FN(P)).

FN = |F|, F = Fr + Fbend + FCint. The reactions are linear in the traction, (f m)c = base + P by, so
that F is convex in P. The solution is the first zero of g = share mu FN - P, positive at P = 0:

    F(0) >= 0    g is convex up to the zero: Newton's method from P = 0 rises to it and does not
                 pass it; if g stops falling before, there is no solution (jam)
    F(0) < 0     -share mu F - P is concave and has no other zero: Newton's method falls to it
    mu over FN   a table: steps of g/(1 + greatest slope) rise to the zero and do not pass it
"""

from cylconn_ros.core.friction import (
    Array,
    Contact,
    Law,
    at_middle,
    coefficient,
    contact,
    share_of,
)
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import Four

MAX_STEPS = 200
ROUNDING = 1e-15


@inline_function
def reactions_at(base: Four, by: Four, p: float) -> Four:
    """The reactions at the traction p."""
    return (base[0] + p * by[0], base[1] + p * by[1], base[2] + p * by[2], base[3] + p * by[3])


@inline_function
def _slope(law: Law, at: Contact, reaction: Four, by: Four) -> float:
    """The slope dF/dP."""
    slope = 0.0
    reaction, by = at_middle(law, reaction), at_middle(law, by)
    if at.radial > 0.0:
        slope += (reaction[0] * by[0] + reaction[1] * by[1]) / at.radial
    if at.moment > 0.0:
        slope += law.bending * (reaction[2] * by[2] + reaction[3] * by[3]) / at.moment
    return slope


@device_function
def least_traction(
    law: Law, par: Array, base: Four, by: Four, share: float, rate: float, c: float, most: float
) -> tuple[float, bool, float]:
    """The least P with P = share limit(FN(P)), at most ``most``, N.

    ``rate``, ``c``: slip rate |s| (m/s) and cosine of the slip direction for the limit. Returns P,
    True if there is no solution (jam), and the relative residual.
    """
    capped = share * law.cap
    most, share = min(most, capped), share * share_of(law, c)
    at = contact(law, base)
    if law.force_slope > 0.0:
        return _least_over_table(law, par, base, by, share, rate, most)
    factor = share * coefficient(law, par, rate, at.normal)
    if at.radial + at.bending + law.preload < 0.0:
        return _least_with_relief(law, base, by, factor, most)
    p, residual = 0.0, 0.0
    for _ in range(MAX_STEPS):
        reaction = reactions_at(base, by, p)
        at = contact(law, reaction)
        wanted = factor * at.normal
        residual = (wanted - p) / (wanted + p) if wanted + p > 0.0 else 0.0
        if residual <= ROUNDING:
            break
        falling = 1.0 - factor * _slope(law, at, reaction, by)
        if falling <= 0.0:
            return most, most != capped, 0.0
        p += (wanted - p) / falling
        if p >= most:
            return most, False, 0.0
    return p, False, abs(residual)


@device_function
def _least_with_relief(
    law: Law, base: Four, by: Four, factor: float, most: float
) -> tuple[float, bool, float]:
    """:func:`least_traction` for a preload that relieves the contact, F(0) < 0."""
    p, residual = min(most, -factor * law.preload), 0.0  # beyond the zero, since F >= FCint
    for _ in range(MAX_STEPS):
        reaction = reactions_at(base, by, p)
        at = contact(law, reaction)
        wanted = -factor * (at.radial + at.bending + law.preload)
        gap = p - wanted
        residual = gap / (abs(wanted) + p) if p > 0.0 else 0.0
        if residual <= ROUNDING:
            break  # also if the zero is beyond ``most``: p is still ``most``
        p -= gap / (1.0 + factor * _slope(law, at, reaction, by))
    return p, False, max(residual, 0.0)


@device_function
def _least_over_table(
    law: Law, par: Array, base: Four, by: Four, share: float, rate: float, most: float
) -> tuple[float, bool, float]:
    """:func:`least_traction` for a coefficient that depends on FN."""
    grown_by = contact(law, by)
    growth = grown_by.radial + grown_by.bending
    p, residual = 0.0, 0.0
    for _ in range(MAX_STEPS):
        normal = contact(law, reactions_at(base, by, p)).normal
        mu = coefficient(law, par, rate, normal)
        gap = share * mu * normal - p
        residual = gap / (gap + 2.0 * p) if gap + p > 0.0 else 0.0
        if residual <= ROUNDING:
            break
        grown = growth * gap  # the step is shorter than gap
        steepest = mu + law.force_slope * grown + law.force_slope * (normal + grown)
        p += gap / (1.0 + share * steepest * growth)
        if p >= most:
            return most, False, 0.0
    return p, False, max(residual, 0.0)
