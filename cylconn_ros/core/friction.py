"""Coulomb friction of the cylindrical connector: one friction disc for sliding and spinning.

Fr    = sqrt(f2^2 + f3^2)              radial force
Mbend = sqrt(m2^2 + m3^2)              bending moment
Fbend = 2 Mbend / L                    L: overlap length of shaft and sleeve; L = 0: Mbend ignored
FN    = |Fr + Fbend + FCint|           FCint: self-equilibrated preload force, of either sign
P     = sqrt(f1f^2 + (m1f/R)^2)        traction; R: effective radius of the shaft
limit = min(cap, mu (1 + d c) FN)      P < limit: stick; P = limit: slip, against the slip velocity

The bending moment is about the middle of the contact, which may move along the slot
(core/overlap.py): at the distance d before node b it is (m2 - d f3, m3 + d f2).

mu    = mu_k + (mu_s - mu_k) exp(-dc |s|), or a table over slip rate |s| and normal force FN
s     = (v1, R w1), the work-conjugate of phi = (f1f, m1f/R)
c     = v1/|s|, which is -f1f/P: the cosine of the slip direction. d: half of the difference of mu
        between positive and negative slide over their mean, 0: the same in all directions

With d the limits of all directions are no circle, but the curve P = limit(c) about the origin;
friction still opposes the slip velocity, so that its work is never positive. It sticks while phi is
within the curve. FN may leave out Fr, Fbend or FCint (weight 0 of Fr, 2/L = 0, FCint = 0).

This module alone knows the order of the law's numbers in the parameter array: ``pack`` writes them,
``unpack`` reads them. The search for roots (core/slip_curve.py, core/traction.py) relies on bounds
of mu that are stated here: ``least_coefficient``, ``greatest_coefficient`` and the slopes
``rate_slope``, ``force_slope``. A change of the law has to keep them valid, or roots are missed.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import Four

Array = NDArray[np.float64]


_GREAT_COEFFICIENT: Final = 1e9


class Law(NamedTuple):
    """Constants of the friction law; the values of a table are in the parameter array."""

    on: bool
    kinetic: float  # mu_k, or the least value of the table
    static: float  # mu_s, or the greatest value of the table; never less than kinetic
    decay: float  # dc, s/m
    cap: float  # N, on P
    radius: float  # R, m
    bending: float  # 2/L, 1/m; 0 if L = 0
    preload: float  # FCint, N
    rate_slope: float  # Lipschitz bound of mu over |s|, s/m
    force_slope: float  # Lipschitz bound of mu over FN, 1/N
    rates: int  # number of slip rates in the table; 0: no table
    forces: int  # number of normal forces in the table
    centre: float  # of the contact before node b along the slot, m (core/overlap.py)
    radial: float  # weight of the radial force in FN, 1 or 0
    direction: float  # d, from -1 to 1
    table: int  # index of the table's first number in the parameter array


SIZE: Final = len(Law._fields) - 1
"""Numbers of a packed law: all fields but the index of the table."""
PRELOAD: Final = Law._fields.index("preload")
"""Index of the preload in a packed law."""


class Table(NamedTuple):
    """Mu over slip rate and normal force: values row by row, one row per rate."""

    rates: Sequence[float]  # m/s, ascending
    forces: Sequence[float]  # N, ascending
    values: Sequence[float]


def make_law(
    *, on: bool, coefficient: float, static_coefficient: float, decay: float, cap: float,
    radius: float, overlap: float, preload: float, table: Table | None, radial: bool = True,
    direction: float = 0.0,
) -> Law:  # fmt: skip
    """The law for the parameters ``friction.*`` of a scene (NaN: not given), slopes included.

    ``overlap``, ``preload``: 0 where they do not press; ``radial``: whether the radial force does.
    """
    least = coefficient
    greatest = coefficient if math.isnan(static_coefficient) else static_coefficient
    rate_slope, force_slope = decay * abs(greatest - least), 0.0
    if table is not None:
        least, greatest = min(table.values), max(table.values)
        rate_slope, force_slope = _slopes(table)
    return Law(
        on, least, greatest, decay, cap,
        0.0 if math.isnan(radius) else radius,
        2.0 / overlap if overlap > 0.0 else 0.0,
        preload, rate_slope, force_slope,
        0 if table is None else len(table.rates),
        0 if table is None else len(table.forces),
        0.0,
        1.0 if radial else 0.0,
        direction,
        0,
    )  # fmt: skip


def _slopes(table: Table) -> tuple[float, float]:
    """Greatest slopes of the table over slip rate (s/m) and normal force (1/N)."""
    grid = np.array(table.values).reshape(len(table.rates), len(table.forces))
    over_rate = np.abs(np.diff(grid, axis=0)) / np.diff(table.rates)[:, None]
    over_force = np.abs(np.diff(grid, axis=1)) / np.diff(table.forces)[None, :]
    return float(over_rate.max(initial=0.0)), float(over_force.max(initial=0.0))


class Contact(NamedTuple):
    """Contact forces between shaft and sleeve, N, and the bending moment, N.m."""

    radial: float  # Fr, 0 if it does not press
    moment: float  # Mbend
    bending: float  # Fbend
    normal: float  # FN


@inline_function
def set_limit(par: Array, at: int, limit: float) -> None:
    """Fix the limit of a packed law, N, whatever the contact: a cap, and a coefficient beyond it.

    Contact forces stay those of the law.
    """
    par[at + 1] = par[at + 2] = _GREAT_COEFFICIENT
    par[at + 3] = par[at + 8] = par[at + 9] = par[at + 10] = par[at + 11] = 0.0
    par[at + 14] = 0.0
    par[at + 4] = limit


@inline_function
def set_contact(par: Array, at: int, overlap: float, centre: float) -> None:
    """Set overlap (> 0, m) and middle of the contact (m) of a packed law."""
    par[at + 12] = centre
    if par[at + 6] != 0.0:  # else bending does not press
        par[at + 6] = 2.0 / overlap


def pack(law: Law) -> tuple[float, ...]:
    """(SIZE,) the law's numbers as they are in the parameter array, without the table's values."""
    return tuple(map(float, law[:SIZE]))


@inline_function
def unpack(par: Array, at: int, table: int) -> Law:
    """The law whose numbers begin at index ``at`` of ``par`` and its table at index ``table``."""
    return Law(
        par[at] != 0.0,
        par[at + 1],
        par[at + 2],
        par[at + 3],
        par[at + 4],
        par[at + 5],
        par[at + 6],
        par[at + 7],
        par[at + 8],
        par[at + 9],
        int(par[at + 10]),
        int(par[at + 11]),
        par[at + 12],
        par[at + 13],
        par[at + 14],
        table,
    )


@inline_function
def without_preload(law: Law) -> Law:
    """The same law with FCint = 0: a finite force has no impulse in an impact."""
    return Law(
        law.on, law.kinetic, law.static, law.decay, law.cap, law.radius, law.bending, 0.0,
        law.rate_slope, law.force_slope, law.rates, law.forces, law.centre, law.radial,
        law.direction, law.table,
    )  # fmt: skip


@inline_function
def with_contact(law: Law, overlap: float, centre: float) -> Law:
    """The same law with another overlap (> 0, m) and middle of the contact (m)."""
    bending = 2.0 / overlap if law.bending != 0.0 else 0.0
    return Law(
        law.on, law.kinetic, law.static, law.decay, law.cap, law.radius, bending, law.preload,
        law.rate_slope, law.force_slope, law.rates, law.forces, centre, law.radial, law.direction,
        law.table,
    )  # fmt: skip


@inline_function
def least_coefficient(law: Law) -> float:
    """A lower bound of mu at any slip rate and normal force, without the share of direction."""
    return law.kinetic


@inline_function
def greatest_coefficient(law: Law) -> float:
    """An upper bound of mu at any slip rate and normal force, without the share of direction."""
    return law.static


@inline_function
def at_middle(law: Law, reaction: Four) -> Four:
    """Reactions (f2, f3, m2, m3) at node b, with the moments about the middle of the contact."""
    f2, f3, m2, m3 = reaction
    return (f2, f3, m2 - law.centre * f3, m3 + law.centre * f2)


@inline_function
def contact(law: Law, reaction: Four) -> Contact:
    """Contact forces of the constraint reactions (f2, f3, m2, m3) at node b."""
    f2, f3, m2, m3 = at_middle(law, reaction)
    radial = law.radial * math.sqrt(f2 * f2 + f3 * f3)
    moment = math.sqrt(m2 * m2 + m3 * m3)
    bending = law.bending * moment
    return Contact(radial, moment, bending, abs(radial + bending + law.preload))


@inline_function
def coefficient(law: Law, par: Array, rate: float, force: float) -> float:
    """Mu at a slip rate |s| (m/s) and a normal force (N), the mean of both directions of slide."""
    if law.rates > 0:
        return _interpolated(law, par, rate, force)
    if law.static == law.kinetic:
        return law.kinetic
    return law.kinetic + (law.static - law.kinetic) * math.exp(-law.decay * rate)


@inline_function
def last_force(law: Law, par: Array) -> float:
    """The last normal force of the table: above it mu does not depend on the force."""
    return float(par[law.table + law.rates + law.forces - 1])


@inline_function
def cosine(law: Law, phi: tuple[float, float]) -> float:
    """Cosine of the slip direction that the friction phi opposes; 0 if the law needs none."""
    if law.direction == 0.0:
        return 0.0
    size = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1])
    return -phi[0] / size if size > 0.0 else 0.0


@inline_function
def share_of(law: Law, c: float) -> float:
    """1 + d c: mu in a slip direction with the cosine c over the mean of both directions."""
    return 1.0 + law.direction * c


@inline_function
def limit(law: Law, par: Array, rate: float, force: float, c: float) -> float:
    """The friction limit, N: the greatest traction P at a slip rate |s| and a normal force FN.

    c: cosine of the slip direction, see :func:`cosine`.
    """
    mu = coefficient(law, par, rate, force)
    if law.direction != 0.0:
        mu *= share_of(law, c)
    return min(law.cap, mu * force)


@device_function
def _interval(par: Array, first: int, n: int, x: float) -> tuple[int, float]:
    """The interval of an ascending axis and the fraction within it; clamped at both ends."""
    if n == 1 or x <= par[first]:
        return 0, 0.0
    i = n - 2
    while i > 0 and par[first + i] > x:
        i -= 1
    t = (x - par[first + i]) / (par[first + i + 1] - par[first + i])
    return i, min(t, 1.0)


@device_function
def _interpolated(law: Law, par: Array, rate: float, force: float) -> float:
    """Mu by bilinear interpolation in the table."""
    i, t = _interval(par, law.table, law.rates, rate)
    j, u = _interval(par, law.table + law.rates, law.forces, force)
    values = law.table + law.rates + law.forces
    di = law.forces if law.rates > 1 else 0
    dj = 1 if law.forces > 1 else 0
    k = values + i * law.forces + j
    low = (1.0 - u) * par[k] + u * par[k + dj]
    high = (1.0 - u) * par[k + di] + u * par[k + di + dj]
    return float((1.0 - t) * low + t * high)
