"""Model of friction that is fitted: Coulomb, Stribeck, viscous, by direction, offset; its slopes.

Friction on body B at node b, axes of a, with s = (v1, R w1), cos = v1/|s|, sin = R w1/|s|:

    P   = mu (1 + d cos) (1 + b exp(-dc |s|)) FN,    FN = Fr + 2/L(l) Mbend + FCint
    f1f = -P cos   - c1 v1 - offset
    m1f = -P R sin - cr1 w1

``coefficient`` mu is the mean of both directions and the kinetic one; mu (1 + d) and mu (1 - d) are
those of the positive and the negative slide, mu (1 + b) is the static one. An offset is positive if
it resists a positive slide. 2/L at the slides of the windows is an argument, ``bending`` (n,); it
depends on the law's 2/L0 if the overlap changes (forces/contact.py).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NAMES = (
    "coefficient", "preload", "overlap", "radius", "c1", "cr1", "direction", "offset",
    "stribeck", "decay",
)  # fmt: skip
(
    COEFFICIENT, PRELOAD, OVERLAP, RADIUS, VISCOUS, VISCOUS_SPIN, DIRECTION, OFFSET, STRIBECK, DECAY
) = range(len(NAMES))  # fmt: skip


@dataclasses.dataclass(frozen=True)
class FrictionLaw:
    """Friction parameters; SI units.

    Attributes
    ----------
        coefficient: mu, kinetic, mean of both directions.
        preload: FCint, N.
        bending: 2/L, 1/m; 0: bending is not modelled. If the overlap changes, 2/L0.
        radius: R, m.
        c1, cr1: viscous friction, N.s/m and N.m.s, beyond the damping of the scene.
        direction: half of the difference of mu between the directions of slide, over their mean.
        offset: force that resists a positive slide, N.
        stribeck: (mu static - mu)/mu.
        decay: dc, s/m.
    """

    coefficient: float
    preload: float
    bending: float
    radius: float
    c1: float = 0.0
    cr1: float = 0.0
    direction: float = 0.0
    offset: float = 0.0
    stribeck: float = 0.0
    decay: float = 100.0

    def normal(self, radial: Array, moment: Array, bending: Array) -> Array:
        """Return FN (n,) of radial forces, bending moments and 2/L (n,)."""
        return np.asarray(np.abs(radial + bending * moment + self.preload))

    @property
    def values(self) -> Array:
        """The parameters (10,) in the order of NAMES, with 2/L."""
        return np.array((
            self.coefficient, self.preload, self.bending, self.radius, self.c1, self.cr1,
            self.direction, self.offset, self.stribeck, self.decay,
        ))  # fmt: skip

    @property
    def vector(self) -> Array:
        """The fitted vector (10,) in the order of NAMES, with ln mu, 2/L, ln R and ln dc."""
        v = self.values
        v[[COEFFICIENT, RADIUS, DECAY]] = np.log(v[[COEFFICIENT, RADIUS, DECAY]])
        return v

    def ratio(self, rates: Array) -> Array:
        """Return P/FN (n,) at the rates (n, 2), m/s and rad/s."""
        size, cos, _ = slip(rates, self.radius)
        stribeck = 1.0 + self.stribeck * np.exp(-self.decay * size)
        return np.asarray(self.coefficient * (1.0 + self.direction * cos) * stribeck)

    def without_coulomb(self, rates: Array) -> Array:
        """Return viscous friction and offset (n, 2), as they resist: N, N.m."""
        return np.asarray(rates * [self.c1, self.cr1] + [self.offset, 0.0])


def law_from_vector(x: Array) -> FrictionLaw:
    """Return the law of a fitted vector; the inverse of :attr:`FrictionLaw.vector`."""
    v = np.array(x, dtype=float)
    logarithms = [COEFFICIENT, RADIUS, DECAY]
    v[logarithms] = np.exp(np.clip(v[logarithms], -40.0, 40.0))
    return FrictionLaw(*(float(value) for value in v))


def slip(rates: Array, radius: float) -> tuple[Array, Array, Array]:
    """Return |s| (n,) and the cosine and sine (n,) of its direction on the disc."""
    s = rates * [1.0, radius]
    size = np.maximum(np.hypot(s[:, 0], s[:, 1]), 1e-300)
    return size, s[:, 0] / size, s[:, 1] / size


def friction(law: FrictionLaw, rates: Array, loads: Array, bending: Array) -> Array:
    """Return (f1f, m1f) (n, 2) at rates (n, 2), loads (n, 2) Fr, Mbend, and 2/L (n,)."""
    _, cos, sin = slip(rates, law.radius)
    size = law.ratio(rates) * (loads[:, 0] + bending * loads[:, 1] + law.preload)
    along = np.stack([cos, law.radius * sin], axis=1)
    return np.asarray(-size[:, None] * along - law.without_coulomb(rates))


def slopes(
    law: FrictionLaw, rates: Array, loads: Array, bending: tuple[Array, Array], free: list[int]
) -> Array:
    """Return the derivatives (n, 2, len(free)) of ``friction`` by the fitted vector.

    ``bending``: 2/L (n,), and its derivatives (n,) by that of the law.
    """
    size, cos, sin = slip(rates, law.radius)
    along = -np.stack([cos, law.radius * sin], axis=1)
    ratio = law.ratio(rates)
    normal = loads[:, 0] + bending[0] * loads[:, 1] + law.preload
    way, decayed = 1.0 + law.direction * cos, np.exp(-law.decay * size)
    mu_n = law.coefficient * normal
    found = np.zeros((len(rates), 2, len(free)))
    for column, k in enumerate(free):
        if k == RADIUS:  # by ln R: d|s| = |s| sin^2, dcos = -cos sin^2, dsin = sin cos^2
            square = sin * sin
            turned = law.direction * -cos * square * (1.0 + law.stribeck * decayed)
            faster = -way * law.stribeck * law.decay * size * square * decayed
            change, whole = mu_n * (turned + faster), ratio * normal
            found[:, 0, column] = cos * (whole * square - change)
            found[:, 1, column] = -law.radius * sin * (change + whole * (1.0 + cos * cos))
        elif k in (VISCOUS, VISCOUS_SPIN):
            found[:, k - VISCOUS, column] = -rates[:, k - VISCOUS]
        elif k == OFFSET:
            found[:, 0, column] = -1.0
        else:
            share = {
                COEFFICIENT: lambda: ratio * normal,
                PRELOAD: lambda: ratio,
                OVERLAP: lambda: ratio * bending[1] * loads[:, 1],
                DIRECTION: lambda: mu_n * cos * (1.0 + law.stribeck * decayed),
                STRIBECK: lambda: mu_n * way * decayed,
                DECAY: lambda: -mu_n * way * law.stribeck * law.decay * size * decayed,
            }[k]()
            found[:, :, column] = share[:, None] * along
    return found
