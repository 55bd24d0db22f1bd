"""Kinetic friction from slip windows: mu, FCint, L and R, as far as the motion excites them.

In every window the equation

    e = (f1f, m1f) + mu (Fr + 2/L Mbend + FCint) (v1, R^2 w1)/|s| = 0        s = (v1, R w1)

should hold. All forces in e are measured, so e has the covariance V = A C A^T with A = de/dwrench,
and the fit minimizes the sum of e^T V^-1 e. This is generalized least squares with errors in all
variables: V depends on the parameters, so that noise in Fr and Mbend does not reduce mu and 1/L, as
it does in a plain fit. Noise n increases absolute values, on average to
|F + n| = |F| + var_t/(2 |F|), with var_t its variance across F; this bias is subtracted.

Confidence intervals use the spread of the windows' own scores (sandwich covariance with leverages)
and Student's t. So they also hold if the noise differs from the assumed weights.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IndeterminateError
from cylconn_ros.identification.windows import Windows

Array = NDArray[np.float64]

NAMES = ("coefficient", "preload", "overlap", "radius")
COEFFICIENT, PRELOAD, OVERLAP, RADIUS = range(len(NAMES))
MIN_SIGNAL_TO_NOISE = 9.0  # mean square of a force over that of its noise
BEYOND = 3.0  # standard deviations by which a mean square must exceed that of the noise
MIN_DEVIATIONS = 3.0  # standard deviations by which a force must differ from zero
FLOOR = 1e-6  # of the median traction: least standard deviation of a residual
SECOND_ORDER = 1e-4  # of the traction: error of a window's forces by the finite sample period
MAX_EVALUATIONS = 200  # of the residuals, per fit


@dataclasses.dataclass(frozen=True)
class FrictionLaw:
    """Friction parameters mu, FCint (N), 2/L (1/m; 0: bending is not modelled) and R (m)."""

    coefficient: float
    preload: float
    bending: float
    radius: float

    def normal(self, radial: Array, moment: Array) -> Array:
        """Return FN (n,) of radial forces (n,) and bending moments (n,)."""
        return np.abs(radial + self.bending * moment + self.preload)

    @property
    def vector(self) -> Array:
        """The fitted vector (4,): ln mu, FCint, 2/L, ln R."""
        return np.array([np.log(self.coefficient), self.preload, self.bending, np.log(self.radius)])


def law_from_vector(x: Array) -> FrictionLaw:
    """Return the law of a fitted vector; the inverse of :attr:`FrictionLaw.vector`."""
    return FrictionLaw(float(np.exp(x[0])), float(x[1]), float(x[2]), float(np.exp(x[3])))


@dataclasses.dataclass(frozen=True)
class ContactLoads:
    """Radial force and bending moment of n windows, without the bias by noise.

    Attributes
    ----------
        radial, moment: (n,) N, N.m.
        gradient: (n, 2, 6) derivatives of both with respect to the wrench.
        signal_to_noise: mean square of each over that of its noise.
    """

    radial: Array
    moment: Array
    gradient: Array
    signal_to_noise: tuple[float, float]

    @classmethod
    def of(cls, w: Windows) -> ContactLoads:
        """Compute the loads of windows."""
        gradient = np.zeros((len(w), 2, 6))
        values, ratios = [], []
        for row, at in enumerate((slice(1, 3), slice(4, 6))):
            vector, cov = w.wrench[:, at], w.covariance[:, at, at]
            size = np.maximum(np.linalg.norm(vector, axis=1), 1e-300)
            u = vector / size[:, None]
            total = np.trace(cov, axis1=1, axis2=2)
            across = total - np.einsum("ni,nij,nj->n", u, cov, u)
            square, white = float(np.square(size).mean()), max(float(total.mean()), 1e-300)
            ratios.append(square / white)
            if ratios[-1] >= MIN_SIGNAL_TO_NOISE:
                values.append(np.sqrt(np.maximum(size**2 - across, 0.0)))
                gradient[:, row, at] = u
            else:  # dominated by noise: only its mean square is significant
                significant = square - white > BEYOND * white / np.sqrt(len(w))
                values.append(np.full(len(w), np.sqrt(square - white) if significant else 0.0))
        return cls(values[0], values[1], gradient, (ratios[0], ratios[1]))


def well_above_noise(w: Windows, loads: ContactLoads) -> NDArray[np.bool_]:
    """Return the windows (n,) whose radial force and bending moment are well above their noise.

    Near zero the mean of |F + n| is not |F| + var_t/(2 |F|). The test uses the neighbours of a
    window, so that its own noise does not select it. A force that is dominated by noise throughout
    is not tested.
    """
    good = np.ones(len(w), dtype=np.bool_)
    near = np.abs(np.arange(len(w))[:, None] + [-1, 1])
    near = np.where(near < len(w), near, 2 * len(w) - 2 - near)  # at an end: one neighbour twice
    for at, ratio in (
        (slice(1, 3), loads.signal_to_noise[0]),
        (slice(4, 6), loads.signal_to_noise[1]),
    ):
        if ratio >= MIN_SIGNAL_TO_NOISE:
            neighbours = w.wrench[near, at].mean(axis=1)
            variance = 0.5 * np.trace(w.covariance[:, at, at], axis1=1, axis2=2)
            good &= np.square(neighbours).sum(axis=1) > MIN_DEVIATIONS**2 * variance
    return good


@dataclasses.dataclass(frozen=True)
class KineticFit:
    """Result of a fit.

    Attributes
    ----------
        law: the fitted law.
        free: indices of the fitted parameters in :data:`NAMES`.
        covariance: (free, free) of the fitted parameters, in the units of the fitted vector.
        systematic: (free,) greatest effect of an error SECOND_ORDER in every window.
        freedom: degrees of freedom of Student's t.
        misfit: mean squared weighted residual; 1 if the noise is as estimated.
    """

    law: FrictionLaw
    free: tuple[int, ...]
    covariance: Array
    systematic: Array
    freedom: int
    misfit: float


def slip_direction(w: Windows, radius: float) -> Array:
    """Return unit vectors (n, 2) along s = (v1, R w1)."""
    s = w.rates * [1.0, radius]
    return np.asarray(s / np.maximum(np.linalg.norm(s, axis=1), 1e-300)[:, None])


def weighted_residuals(
    w: Windows, loads: ContactLoads, law: FrictionLaw, weights: FrictionLaw | None = None
) -> Array:
    """Return weighted residuals V^-1/2 e (n, 2) of ``law``; V of ``weights``, default ``law``."""
    along = slip_direction(w, law.radius) * [1.0, law.radius]
    limit = law.coefficient * law.normal(loads.radial, loads.moment)
    e = w.wrench[:, [0, 3]] + limit[:, None] * along
    jacobian = np.zeros((len(w), 2, 6))  # A = de/dwrench
    jacobian[:, 0, 0], jacobian[:, 1, 3] = 1.0, 1.0
    weighting = weights or law
    slope = loads.gradient[:, 0] + weighting.bending * loads.gradient[:, 1]
    jacobian += weighting.coefficient * along[:, :, None] * slope[:, None, :]
    v = jacobian @ w.covariance @ jacobian.transpose(0, 2, 1)
    floor = FLOOR * np.median(limit)
    v += np.diag([floor**2, (law.radius * floor) ** 2]) + 1e-300 * np.eye(2)
    # Cholesky factor of each 2x2 block: V = T T^T with T lower triangular, e = T r.
    a = np.sqrt(v[:, 0, 0])
    b = v[:, 1, 0] / a
    c = np.sqrt(np.maximum(v[:, 1, 1] - b * b, 1e-12 * v[:, 1, 1]))
    r = e[:, 0] / a
    return np.column_stack([r, (e[:, 1] - b * r) / c])


def fit_law(w: Windows, loads: ContactLoads, start: FrictionLaw, free: Sequence[int]) -> KineticFit:
    """Fit the parameters ``free`` (indices of :data:`NAMES`); the others are held as in ``start``.

    Raises IndeterminateError if the traction does not oppose the slip.
    """
    from scipy.optimize import least_squares

    chosen = list(free)
    held = start.vector
    scale = parameter_scales(loads, start)

    def law_of(x: Array) -> FrictionLaw:
        full = held.copy()
        full[chosen] += np.clip(x, -20.0, 20.0) * scale[chosen]
        return law_from_vector(full)

    law, x = start, np.zeros(len(chosen))
    # V is first held at the previous law: the sum with a variable V has other, distant minima.
    for variable in (False, False, False, True):
        fixed = None if variable else law
        found = least_squares(
            lambda x, fixed=fixed: weighted_residuals(w, loads, law_of(x), fixed).ravel(),
            x,
            max_nfev=MAX_EVALUATIONS,
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        x, law = found.x, law_of(found.x)
    r = found.fun.reshape(-1, 2)
    jacobian = found.jac.reshape(len(w), 2, len(chosen))
    bread = np.linalg.pinv(np.einsum("nia,nib->ab", jacobian, jacobian), rcond=1e-14)
    covariance = _sandwich_covariance(jacobian, r, bread)
    changed = dataclasses.replace(law, coefficient=law.coefficient * (1.0 + SECOND_ORDER))
    shift = weighted_residuals(w, loads, changed, law) - r
    systematic = np.abs(np.einsum("ab,nib,ni->an", bread, jacobian, shift)).sum(axis=1)
    freedom = max(len(w) - len(chosen), 1)
    units = np.array(scale[chosen])
    misfit = float(np.square(r).sum() / max(2 * len(w) - len(chosen), 1))
    if not np.isfinite(covariance).all() or law.coefficient < 1e-6:
        raise IndeterminateError("no friction shows: the traction does not oppose the slip")
    covariance = covariance * np.outer(units, units)
    return KineticFit(law, tuple(chosen), covariance, systematic * units, freedom, misfit)


def parameter_scales(loads: ContactLoads, law: FrictionLaw) -> Array:
    """Return the changes (4,) of the fitted vector that change the limit by 100 % (first order)."""
    radial, moment = float(np.mean(loads.radial)), float(np.mean(loads.moment))
    force = max(radial + law.bending * moment + max(law.preload, 0.0), 1e-12)
    return np.array([1.0, force, force / max(moment, 1e-12 * force), 1.0])


def _sandwich_covariance(jacobian: Array, r: Array, bread: Array) -> Array:
    """Return the HC3 covariance of a least-squares estimate, with blocks of two rows per window."""
    leverage = np.einsum("nia,ab,njb->nij", jacobian, bread, jacobian)
    left = np.linalg.solve(np.eye(2) * (1.0 + 1e-9) - leverage, r[:, :, None])[:, :, 0]
    scores = np.einsum("nia,ni->na", jacobian, left)
    return np.asarray(bread @ (scores.T @ scores) @ bread)


def predicted_deviations(
    w: Windows, loads: ContactLoads, law: FrictionLaw, free: Sequence[int]
) -> Array:
    """Return the standard deviations (free,) expected from the noise at ``law``.

    In units of :func:`parameter_scales`.
    """
    scale = parameter_scales(loads, law)
    columns = []
    for k in free:
        step = np.zeros(4)
        step[k] = 1e-4 * scale[k]
        up, down = law_from_vector(law.vector + step), law_from_vector(law.vector - step)
        columns.append(
            (weighted_residuals(w, loads, up) - weighted_residuals(w, loads, down)).ravel() / 2e-4
        )
    jacobian = np.array(columns).T
    _, sizes, vt = np.linalg.svd(jacobian, full_matrices=False)
    sizes = np.maximum(sizes, 1e-9 * sizes.max(initial=1e-300))
    return np.asarray(np.sqrt(np.square(vt / sizes[:, None]).sum(axis=0)))
