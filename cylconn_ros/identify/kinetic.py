"""Kinetic friction out of slipping windows: mu, FCint, L and R, as far as the motion excites them.

    e = (f1f, m1f) + mu (Fr + 2/L Mbend + FCint) (v1, R^2 w1)/|s| = 0        s = (v1, R w1)

is wanted in every window. The forces in it are all measured: e has the covariance V = A C A^T with
A = de/dwrench, and the sum of e^T V^-1 e is made least (generalised least squares with errors in
all variables; V moves with the parameters, so that noise in Fr and Mbend does not shrink mu and
1/L as it does in a plain fit). Noise makes absolute values too large, |F + n| = |F| + var_t/(2 |F|)
in the mean, var_t across F: that is taken off.

Intervals come from the spread of the windows' own scores (sandwich covariance with leverages),
which holds also where the noise is not what the weights took it for, and Student's t.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identify.windows import Windows

Array = NDArray[np.float64]

NAMES = ("coefficient", "preload", "overlap", "radius")
CLEAR = 9.0  # mean square of a force over its noise's: less is none
BEYOND = 3.0  # standard deviations of a mean square: less is none at all
AWAY = 3.0  # standard deviations from zero
FLOOR = 1e-6  # of the usual traction: an error that counts in any case
SECOND_ORDER = 1e-4  # of the traction: what a finite sample period leaves in a window's forces
STEPS = 200  # evaluations of the fit


@dataclasses.dataclass(frozen=True)
class Law:
    """Parameters of friction; ``bending`` is 2/L, 1/m, and 0 where bending is left out."""

    coefficient: float
    preload: float
    bending: float
    radius: float

    def normal(self, radial: Array, moment: Array) -> Array:
        """FN of radial forces and bending moments."""
        return np.abs(radial + self.bending * moment + self.preload)

    @property
    def vector(self) -> Array:
        """(4,) as it is fitted: ln mu, FCint, 2/L, ln R."""
        return np.array([np.log(self.coefficient), self.preload, self.bending, np.log(self.radius)])


def of_vector(x: Array) -> Law:
    """Undo :attr:`Law.vector`."""
    return Law(float(np.exp(x[0])), float(x[1]), float(x[2]), float(np.exp(x[3])))


@dataclasses.dataclass(frozen=True)
class Loads:
    """Radial force and bending moment of windows, with their bias taken off, and directions."""

    radial: Array  # (n,) N
    moment: Array  # (n,) N.m
    along: Array  # (n, 2, 6) their derivatives by the wrench
    clear: tuple[float, float]  # mean square of each over that of its noise

    @classmethod
    def of(cls, w: Windows) -> Loads:
        """Of windows."""
        along = np.zeros((len(w), 2, 6))
        values, clear = [], []
        for row, at in enumerate((slice(1, 3), slice(4, 6))):
            vector, cov = w.wrench[:, at], w.covariance[:, at, at]
            size = np.maximum(np.linalg.norm(vector, axis=1), 1e-300)
            u = vector / size[:, None]
            whole = np.trace(cov, axis1=1, axis2=2)
            across = whole - np.einsum("ni,nij,nj->n", u, cov, u)
            square, white = float(np.square(size).mean()), max(float(whole.mean()), 1e-300)
            clear.append(square / white)
            if clear[-1] >= CLEAR:
                values.append(np.sqrt(np.maximum(size**2 - across, 0.0)))
                along[:, row, at] = u
            else:  # mostly noise: only its mean square says anything
                sure = square - white > BEYOND * white / np.sqrt(len(w))
                values.append(np.full(len(w), np.sqrt(square - white) if sure else 0.0))
        return cls(values[0], values[1], along, (clear[0], clear[1]))


def away_from_zero(w: Windows, loads: Loads) -> NDArray[np.bool_]:
    """(n,) where neither radial force nor bending moment is near zero.

    Near zero the mean of |F + n| is not |F| + var_t/(2 |F|). Whether a window is near is asked of
    its neighbours, so that its own noise does not choose. What is noise throughout is not asked.
    """
    good = np.ones(len(w), dtype=np.bool_)
    near = np.abs(np.arange(len(w))[:, None] + [-1, 1])
    near = np.where(near < len(w), near, 2 * len(w) - 2 - near)  # at an end: the one neighbour
    for at, clear in ((slice(1, 3), loads.clear[0]), (slice(4, 6), loads.clear[1])):
        if clear >= CLEAR:
            around = w.wrench[near, at].mean(axis=1)
            one = 0.5 * np.trace(w.covariance[:, at, at], axis1=1, axis2=2)
            good &= np.square(around).sum(axis=1) > AWAY**2 * one
    return good


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A fit: the law, which of :data:`NAMES` were free, and what is known of those (as fitted)."""

    law: Law
    free: tuple[int, ...]
    covariance: Array  # (free, free)
    systematic: Array  # (free,) what SECOND_ORDER in every window could do at worst
    freedom: int  # of Student's t
    misfit: float  # mean squared weighted residual: 1 where the noise is as estimated


def direction(w: Windows, radius: float) -> Array:
    """(n, 2) unit vectors along s = (v1, R w1)."""
    s = w.rates * [1.0, radius]
    return np.asarray(s / np.maximum(np.linalg.norm(s, axis=1), 1e-300)[:, None])


def weighted(w: Windows, loads: Loads, law: Law, seen_by: Law | None = None) -> Array:
    """(n, 2) residuals V^-1/2 e of ``law``, with V of the law ``seen_by`` if another is given."""
    to = direction(w, law.radius) * [1.0, law.radius]
    greatest = law.coefficient * law.normal(loads.radial, loads.moment)
    e = w.wrench[:, [0, 3]] + greatest[:, None] * to
    by = np.zeros((len(w), 2, 6))
    by[:, 0, 0], by[:, 1, 3] = 1.0, 1.0
    weigher = seen_by or law
    slope = loads.along[:, 0] + weigher.bending * loads.along[:, 1]
    by += weigher.coefficient * to[:, :, None] * slope[:, None, :]
    v = by @ w.covariance @ by.transpose(0, 2, 1)
    floor = FLOOR * np.median(greatest)
    v += np.diag([floor**2, (law.radius * floor) ** 2]) + 1e-300 * np.eye(2)
    # By hand: V = T T^T with T lower triangular, e = T r.
    a = np.sqrt(v[:, 0, 0])
    b = v[:, 1, 0] / a
    c = np.sqrt(np.maximum(v[:, 1, 1] - b * b, 1e-12 * v[:, 1, 1]))
    r = e[:, 0] / a
    return np.column_stack([r, (e[:, 1] - b * r) / c])


def fit(w: Windows, loads: Loads, start: Law, free: Sequence[int]) -> Fitted:
    """Fit the parameters ``free`` (indices of :data:`NAMES`), the others held as in ``start``.

    Raises IdentifyError where no friction shows.
    """
    from scipy.optimize import least_squares

    chosen = list(free)
    whole = start.vector
    scale = natural(loads, start)

    def law_of(x: Array) -> Law:
        full = whole.copy()
        full[chosen] += np.clip(x, -20.0, 20.0) * scale[chosen]
        return of_vector(full)

    law, x = start, np.zeros(len(chosen))
    for moving in (False, False, False, True):  # the sum with moving V has other minima far away
        fixed = None if moving else law
        found = least_squares(
            lambda x, fixed=fixed: weighted(w, loads, law_of(x), fixed).ravel(),
            x,
            max_nfev=STEPS,
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        x, law = found.x, law_of(found.x)
    r = found.fun.reshape(-1, 2)
    jacobian = found.jac.reshape(len(w), 2, len(chosen))
    bread = np.linalg.pinv(np.einsum("nia,nib->ab", jacobian, jacobian), rcond=1e-14)
    covariance = _sandwich(jacobian, r, bread)
    more = dataclasses.replace(law, coefficient=law.coefficient * (1.0 + SECOND_ORDER))
    shift = weighted(w, loads, more, law) - r
    systematic = np.abs(np.einsum("ab,nib,ni->an", bread, jacobian, shift)).sum(axis=1)
    freedom = max(len(w) - len(chosen), 1)
    to = np.array(scale[chosen])
    misfit = float(np.square(r).sum() / max(2 * len(w) - len(chosen), 1))
    if not np.isfinite(covariance).all() or law.coefficient < 1e-6:
        raise IdentifyError("no friction shows: the traction does not oppose the slip")
    covariance = covariance * np.outer(to, to)
    return Fitted(law, tuple(chosen), covariance, systematic * to, freedom, misfit)


def natural(loads: Loads, law: Law) -> Array:
    """(4,) changes of the fitted vector that change the friction limit by its own size."""
    radial, moment = float(np.mean(loads.radial)), float(np.mean(loads.moment))
    force = max(radial + law.bending * moment + max(law.preload, 0.0), 1e-12)
    return np.array([1.0, force, force / max(moment, 1e-12 * force), 1.0])


def _sandwich(jacobian: Array, r: Array, bread: Array) -> Array:
    """Covariance of a least-squares estimate, windows independent: HC3 with blocks of two rows."""
    leverage = np.einsum("nia,ab,njb->nij", jacobian, bread, jacobian)
    left = np.linalg.solve(np.eye(2) * (1.0 + 1e-9) - leverage, r[:, :, None])[:, :, 0]
    scores = np.einsum("nia,ni->na", jacobian, left)
    return np.asarray(bread @ (scores.T @ scores) @ bread)


def precision(w: Windows, loads: Loads, law: Law, free: Sequence[int]) -> Array:
    """(free,) standard deviations in natural units that the noise lets expect at ``law``."""
    scale = natural(loads, law)
    columns = []
    for k in free:
        step = np.zeros(4)
        step[k] = 1e-4 * scale[k]
        up, down = of_vector(law.vector + step), of_vector(law.vector - step)
        columns.append((weighted(w, loads, up) - weighted(w, loads, down)).ravel() / 2e-4)
    jacobian = np.array(columns).T
    _, sizes, vt = np.linalg.svd(jacobian, full_matrices=False)
    sizes = np.maximum(sizes, 1e-9 * sizes.max(initial=1e-300))
    return np.asarray(np.sqrt(np.square(vt / sizes[:, None]).sum(axis=0)))
