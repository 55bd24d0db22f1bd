"""Contact of shaft and sleeve at a slide: its overlap, and the moment about its middle.

    D = l - l_L,    L(l) = L0 + sigma D between L_min and L_max,    M2 = m2 - kappa D f3,
                                                                   M3 = m3 + kappa D f2

as in core/overlap.py; L0 is estimated, what is left is known. The law of friction has 2/L0: 2/L at
a slide is a function of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.scene.packing import pack_overlap
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]


class Contact(NamedTuple):
    """How the contact changes with the slide.

    Attributes
    ----------
        sigma: change of the overlap with the slide: 0, 1 or -1.
        kappa: share of the slide by which the middle of the contact lags behind node b.
        at: slide l_L at which the overlap is L0, m.
        least, most: limits of the overlap, m.
        first: overlap of the scene at l_L, m, with which the middle moves between the limits.
    """

    sigma: float = 0.0
    kappa: float = 0.0
    at: float = 0.0
    least: float = 0.0
    most: float = np.inf
    first: float = 0.0

    @property
    def changes(self) -> bool:
        """Whether overlap or middle of the contact depend on the slide."""
        return self.sigma != 0.0 or self.kappa != 0.0

    def bending(self, first: float, lengths: Array) -> Array:
        """Return 2/L (n,), 1/m, at the slides ``lengths`` (n,); ``first``: 2/L0."""
        if self.sigma == 0.0 or first == 0.0:
            return np.full(len(lengths), first)
        return np.asarray(2.0 / self._overlap(first, lengths))

    def slope(self, first: float, lengths: Array) -> Array:
        """Return the derivatives (n,) of ``bending`` by ``first``."""
        if self.sigma == 0.0 or first == 0.0:
            return np.ones(len(lengths))
        moved = 2.0 / first + self.sigma * (lengths - self.at)
        within = (moved >= self.least) & (moved <= self.most)
        return np.where(within, np.square(2.0 / (first * self._overlap(first, lengths))), 0.0)

    def _overlap(self, first: float, lengths: Array) -> Array:
        moved = 2.0 / first + self.sigma * (lengths - self.at)
        return np.asarray(np.clip(moved, self.least, self.most))

    def about_middle(self, wrench: Array, lengths: Array) -> Array:
        """Return wrenches (n, 6) about node b as wrenches about the middle of the contact."""
        if self.kappa == 0.0:
            return wrench
        return np.asarray(np.einsum("nij,nj->ni", self._shift(lengths), wrench))

    def covariance(self, covariance: Array, lengths: Array) -> Array:
        """Return the covariances (n, 6, 6) of ``about_middle``."""
        if self.kappa == 0.0:
            return covariance
        shift = self._shift(lengths)
        return np.asarray(shift @ covariance @ shift.transpose(0, 2, 1))

    def _shift(self, lengths: Array) -> Array:
        shift = np.tile(np.eye(6), (len(lengths), 1, 1))
        moved = lengths - self.at
        if self.kappa == 0.5:  # at the limits of the overlap the middle stays with the bearing of B
            overlap = self.first + self.sigma * moved
            moved = moved + self.sigma * (np.clip(overlap, self.least, self.most) - overlap)
        arm = self.kappa * moved
        shift[:, 4, 2], shift[:, 5, 1] = -arm, arm
        return shift


_PRESSING = {"radial": (1, 2), "bending": (4, 5)}  # components of a wrench

CONSTANT = Contact()
"""A contact that does not change."""


def pressing(inputs: Sequence[str], wrench: Array, covariance: Array) -> tuple[Array, Array]:
    """Return wrenches (n, 6) and covariances (n, 6, 6) without what does not press the contact.

    ``inputs``: ``friction.inputs``. Moments must be about the middle of the contact.
    """
    out = [k for name, at in _PRESSING.items() if name not in inputs for k in at]
    if not out:
        return wrench, covariance
    wrench, covariance = wrench.copy(), covariance.copy()
    wrench[:, out] = 0.0
    covariance[:, out] = 0.0
    covariance[:, :, out] = 0.0
    return wrench, covariance


def contact_of(scene: Scene, start: float) -> Contact:
    """Return the contact of a scene; ``start``: slide of the first sample, m.

    The overlap holds at the slide ``friction.overlap_at``, by default at ``start``.
    """
    sigma, kappa, at, first, least, most = pack_overlap(scene.friction)
    if sigma == 0.0 and kappa == 0.0:
        return CONSTANT
    return Contact(sigma, kappa, at if np.isfinite(at) else start, least, most, first)
