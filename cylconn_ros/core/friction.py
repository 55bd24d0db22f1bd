"""Coulomb friction of the cylindrical connector: one disc for slide and spin.

Fr    = sqrt(f2^2 + f3^2)              radial force
Mbend = sqrt(m2^2 + m3^2)              bending moment
Fbend = 2 Mbend / L                    L: overlap of shaft and sleeve; L = 0: Mbend ignored
FN    = |Fr + Fbend + FCint|           FCint: self-equilibrated contact force, of either sign
P     = sqrt(f1f^2 + (m1f/R)^2)        traction; R: effective radius of the shaft
limit = min(cap, mu FN)                P < limit: stick; P = limit: slip, against the slip velocity

mu    = mu_k + (mu_s - mu_k) exp(-dc |s|), or a table over slip rate |s| and contact force FN
s     = (v1, R w1), the work partner of phi = (f1f, m1f/R)
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import Four

Array = NDArray[np.float64]


class Law(NamedTuple):
    """The constants of the law; the table, where there is one, lies in the parameter array."""

    on: bool
    kinetic: float  # mu_k, or the least of the table
    static: float  # mu_s, or the greatest of the table; never less than kinetic
    decay: float  # dc, s/m
    cap: float  # N, on P
    radius: float  # R, m
    bending: float  # 2/L, 1/m; 0 where L = 0
    preload: float  # FCint, N
    rate_slope: float  # greatest |d mu / d|s||, s/m
    force_slope: float  # greatest |d mu / d FN|, 1/N
    rates: int  # entries of the table, 0: none
    forces: int
    table: int  # index of its first number in the parameter array


class Contact(NamedTuple):
    """What the constraint reactions press together."""

    radial: float  # Fr
    moment: float  # Mbend
    bending: float  # Fbend
    normal: float  # FN


@inline_function
def contact(law: Law, reaction: Four) -> Contact:
    """Contact forces of the constraint reactions (f2, f3, m2, m3)."""
    f2, f3, m2, m3 = reaction
    radial = math.sqrt(f2 * f2 + f3 * f3)
    moment = math.sqrt(m2 * m2 + m3 * m3)
    bending = law.bending * moment
    return Contact(radial, moment, bending, abs(radial + bending + law.preload))


@inline_function
def coefficient(law: Law, par: Array, rate: float, force: float) -> float:
    """Mu at a slip rate |s| (m/s) and a contact force (N)."""
    if law.rates > 0:
        return _interpolated(law, par, rate, force)
    if law.static == law.kinetic:
        return law.kinetic
    return law.kinetic + (law.static - law.kinetic) * math.exp(-law.decay * rate)


@inline_function
def last_force(law: Law, par: Array) -> float:
    """The contact force from which on a table no longer depends on it."""
    return float(par[law.table + law.rates + law.forces - 1])


@inline_function
def limit(law: Law, par: Array, rate: float, force: float) -> float:
    """The greatest traction P (N) at a slip rate |s| and a contact force FN."""
    return min(law.cap, coefficient(law, par, rate, force) * force)


@device_function
def _place(par: Array, first: int, n: int, x: float) -> tuple[int, float]:
    """The interval of an ascending table and the fraction within it; constant beyond its ends."""
    if n == 1 or x <= par[first]:
        return 0, 0.0
    i = n - 2
    while i > 0 and par[first + i] > x:
        i -= 1
    t = (x - par[first + i]) / (par[first + i + 1] - par[first + i])
    return i, min(t, 1.0)


@device_function
def _interpolated(law: Law, par: Array, rate: float, force: float) -> float:
    """Bilinear in the table: rates, then forces, then the values row by row (a row is a rate)."""
    i, t = _place(par, law.table, law.rates, rate)
    j, u = _place(par, law.table + law.rates, law.forces, force)
    values = law.table + law.rates + law.forces
    di = law.forces if law.rates > 1 else 0
    dj = 1 if law.forces > 1 else 0
    k = values + i * law.forces + j
    low = (1.0 - u) * par[k] + u * par[k + dj]
    high = (1.0 - u) * par[k + di] + u * par[k + di + dj]
    return float((1.0 - t) * low + t * high)
