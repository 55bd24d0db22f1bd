"""Likelihood of kinetic friction in slip windows, and the fit of a law to them.

In every window the residual e of the friction law of :mod:`law` is Gaussian, given the measured
loads, with a covariance V that depends on the law, since the loads carry noise:

    -ln L = 1/2 sum (e^T V^-1 e / k + ln det (k V)),       k: dispersion, at least 1

Without the determinant, mu without bounds with FN near zero fits anything. The loads are calibrated
(:mod:`contact_loads`): with the measured loads as they are, this likelihood is biased as a plain
fit is, because ``E[de/dmu e]`` does not vanish.

The fit solves the score of the mean with V of the law itself (iteratively reweighted Gauss-Newton):
it is unbiased also if the noise is not as assumed. -ln L compares laws. Confidence intervals use
the spread of the windows' own scores (:mod:`sandwich`) and Student's t.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import COMPILED
from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.likelihood import sandwich, search_kernel
from cylconn_ros.identification.likelihood.contact_loads import Calibrated
from cylconn_ros.identification.likelihood.law import (
    DECAY,
    OFFSET,
    OVERLAP,
    PRELOAD,
    VISCOUS,
    VISCOUS_SPIN,
    FrictionLaw,
    friction,
    law_from_vector,
    slip,
    slopes,
)

Array = NDArray[np.float64]

FLOOR = 1e-3  # of the median traction: least standard deviation of a residual
SECOND_ORDER = 1e-4  # of the traction: error of a window's forces by the finite sample period
MAX_ITERATIONS = 60
CONVERGED = 1e-6  # step, in units of parameter_scales
LEAST_NORMAL = 0.05  # of the mean load: smallest FN that a law may have in a window
RCOND = 1e-10  # relative size of a singular value that counts as zero
LARGEST_STEP = 0.7  # in units of parameter_scales


@dataclasses.dataclass(frozen=True)
class KineticFit:
    """A fitted law.

    Attributes
    ----------
        law: the law.
        free: indices of law.NAMES that were estimated.
        covariance: (k, k) of the fitted vector.
        systematic: (k,) bound of the error by a relative error of SECOND_ORDER in every window.
        freedom: (k,) degrees of freedom of the variances.
        misfit: mean squared weighted residual.
        cost: -ln L.
        residuals: (n, 2) weighted residuals V^-1/2 e, along and across the slip.
    """

    law: FrictionLaw
    free: tuple[int, ...]
    covariance: Array = dataclasses.field(repr=False)
    systematic: Array = dataclasses.field(repr=False)
    freedom: Array = dataclasses.field(repr=False)
    misfit: float
    cost: float
    residuals: Array = dataclasses.field(repr=False)

    def half_widths(self, significance: float) -> Array:
        """Half widths (k,) of the intervals of the fitted vector, from the noise alone."""
        from scipy.stats import t

        students = t.isf(0.5 * significance, self.freedom)
        return np.asarray(students * np.sqrt(np.diag(self.covariance)))

    def deviation(self, k: int) -> float:
        """Standard deviation of an estimated parameter (index of NAMES)."""
        j = self.free.index(k)
        return float(np.sqrt(self.covariance[j, j]))


def factors(data: Calibrated, law: FrictionLaw) -> tuple[Array, Array]:
    """Return V^-1/2 (n, 2, 2) and ln det V (n,) of the residuals of ``law``.

    The first component of V^-1/2 e is along the slip direction, the second one across.
    """
    w, own, radius = data.windows, data.own, law.radius
    size, cos, sin = slip(w.rates, radius)
    ratio = law.ratio(w.rates)
    # Covariance of the force turned to (along, across), N. Written out: it is the innermost loop.
    c1, s1, c2, s2 = cos, sin / radius, cos / radius, sin
    v00, v01, v11 = own[:, 0, 0], own[:, 0, 1], own[:, 1, 1]
    along = c1 * c1 * v00 + s1 * (2.0 * c1 * v01 + s1 * v11)
    both = -c1 * s2 * v00 + (c1 * c2 - s1 * s2) * v01 + s1 * c2 * v11
    across = s2 * s2 * v00 + c2 * (-2.0 * s2 * v01 + c2 * v11)
    bending = data.bending(law.bending)
    # e = force - friction, friction = -ratio (1, 2/L) loads along: de/dloads = +ratio (1, 2/L).
    rest, shared = data.rest, data.shared
    load = rest[:, 0, 0] + bending * (2.0 * rest[:, 0, 1] + bending * rest[:, 1, 1])
    slide = ratio * (shared[:, 0, 0] + bending * shared[:, 1, 0])
    spin = ratio * (shared[:, 0, 1] + bending * shared[:, 1, 1])
    along = along + ratio * ratio * load + 2.0 * (c1 * slide + s1 * spin)
    both = both + c2 * spin - s2 * slide
    limit = ratio * (data.loads[:, 0] + bending * data.loads[:, 1] + law.preload)
    spread = np.square(sin * w.rate_noise[:, 0]) + np.square(cos * radius * w.rate_noise[:, 1])
    across = across + np.square(limit / size) * spread
    floor = _least_variance(limit)
    across = np.maximum(across, 0.0) + floor
    a = np.sqrt(np.maximum(along, 0.0) + floor)
    b = both / a
    c = np.sqrt(np.maximum(across - b * b, 1e-6 * across))
    inverse = np.empty((len(w), 2, 2))
    inverse[:, 0, 0], inverse[:, 0, 1] = c1 / a, s1 / a
    back = b / a
    inverse[:, 1, 0], inverse[:, 1, 1] = (-s2 - back * c1) / c, (c2 - back * s1) / c
    return inverse, 2.0 * (np.log(a) + np.log(c))


def friction_of(data: Calibrated, law: FrictionLaw) -> Array:
    """Return (f1f, m1f) (n, 2) of ``law`` in the windows."""
    return friction(law, data.windows.rates, data.loads, data.bending(law.bending))


def slopes_of(data: Calibrated, law: FrictionLaw, free: Sequence[int]) -> Array:
    """Return the derivatives (n, 2, len(free)) of ``friction_of`` by the fitted vector."""
    bendings = data.bendings(law.bending)
    return slopes(law, data.windows.rates, data.loads, bendings, list(free))


def weighted_residuals(data: Calibrated, law: FrictionLaw, weights: Array | None = None) -> Array:
    """Return V^-1/2 e (n, 2) of ``law``."""
    inverse = factors(data, law)[0] if weights is None else weights
    e = data.force - friction_of(data, law)
    return _product(inverse, e)


def _product(matrices: Array, vectors: Array) -> Array:
    """Return the products (n, 2) of matrices (n, 2, 2) and vectors (n, 2)."""
    found = np.empty_like(vectors)
    found[:, 0] = matrices[:, 0, 0] * vectors[:, 0] + matrices[:, 0, 1] * vectors[:, 1]
    found[:, 1] = matrices[:, 1, 0] * vectors[:, 0] + matrices[:, 1, 1] * vectors[:, 1]
    return found


def cost(data: Calibrated, law: FrictionLaw) -> float:
    """Return -ln L of ``law``, with the dispersion that is most likely, but at least 1.

    The determinant is that of V in force units of the slip directions at R; constants are left out.
    """
    inverse, logdet = factors(data, law)
    r = weighted_residuals(data, law, inverse)
    square = float(np.square(r).sum())
    # The residuals were turned to (f1, m1/R): the determinant of that is R^-2.
    return float(0.5 * (logdet + 2.0 * np.log(law.radius)).sum() + _dispersed(square, len(r)))


def _dispersed(square: float, n: int) -> float:
    k = max(square / (2.0 * n), 1.0)
    return 0.5 * square / k + n * np.log(k)


def fit_law(
    data: Calibrated, start: FrictionLaw, free: Sequence[int], iterations: int = MAX_ITERATIONS
) -> KineticFit:
    """Fit the parameters ``free`` (indices of law.NAMES); the others are held as in ``start``.

    ``iterations`` limits their number.

    Raises IdentifyError if the traction does not oppose the slip.
    """
    chosen = list(free)
    return finished(data, searched(data, start, chosen, iterations), chosen)


def searched(
    data: Calibrated, start: FrictionLaw, chosen: list[int], iterations: int = MAX_ITERATIONS
) -> FrictionLaw:
    """Return the law of ``fit_law``, without its covariance."""
    if COMPILED:
        return _searched_compiled(data, start, chosen, iterations)
    law = start
    for _ in range(iterations):
        scale = parameter_scales(data, law)[chosen]
        inverse, _ = factors(data, law)
        r = weighted_residuals(data, law, inverse)
        j = -np.einsum("nij,njk->nik", inverse, slopes_of(data, law, chosen)) * scale
        step = -_solve(j.reshape(-1, len(chosen)), r.ravel())
        step *= min(1.0, LARGEST_STEP / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        before = float(np.square(r).sum())
        for _ in range(search_kernel.HALVINGS):
            x = law.vector
            x[chosen] += step * scale
            tried = _bounded(data, law_from_vector(x), chosen)
            if np.square(weighted_residuals(data, tried, inverse)).sum() <= before:
                break
            step = 0.5 * step
        moved = np.abs((tried.vector - law.vector)[chosen] / scale).max(initial=0.0)
        law = tried
        if moved < CONVERGED:
            break
    return law


def _searched_compiled(
    data: Calibrated, start: FrictionLaw, chosen: list[int], iterations: int
) -> FrictionLaw:
    """Return the law of ``searched``."""
    n, k, contact = len(data), len(chosen), data.windows.contact
    values = start.values
    search_kernel.search(
        data.table,
        np.array((contact.sigma, contact.at, contact.least, contact.most), dtype=np.float64),
        np.array(data.sizes),
        np.array((FLOOR, CONVERGED, LARGEST_STEP, LEAST_NORMAL, RCOND)),
        np.array(chosen, np.int64),
        values,
        iterations,
        np.empty((4, n)),
        np.empty((n, 4)),
        np.empty(2 * n),
        np.empty((2 * n, k)),
        np.empty((5 + 2 * k, max(k, len(values)))),
    )
    return FrictionLaw(*values.tolist())


def _least_variance(limits: Array) -> float:
    """Return the least variance of a residual along and across the slip, N^2."""
    middle = len(limits) // 2
    return float((FLOOR * float(np.partition(np.abs(limits), middle)[middle])) ** 2 + 1e-300)


def _solve(j: Array, r: Array) -> Array:
    return np.asarray(np.linalg.lstsq(j, r, rcond=RCOND)[0])


def _bounded(data: Calibrated, law: FrictionLaw, chosen: list[int]) -> FrictionLaw:
    """Return the law, with a preload that keeps FN away from zero in every window."""
    changed = {}
    if PRELOAD in chosen:
        contact = data.normal(law.bending, 0.0)
        least = LEAST_NORMAL * float(np.abs(contact).mean()) - float(contact.min())
        if law.preload < least:
            changed["preload"] = least
    if DECAY in chosen:
        size = slip(data.windows.rates, law.radius)[0]
        low, high = 2.0 / float(size.max()), 10.0 / float(size.min())
        changed["decay"] = min(max(law.decay, low), high)
    return dataclasses.replace(law, **changed)


def finished(data: Calibrated, law: FrictionLaw, chosen: list[int]) -> KineticFit:
    """Return the fit with this law, its covariance and its cost.

    Raises IdentifyError as ``fit_law``.
    """
    scale = parameter_scales(data, law)[chosen]
    inverse, _ = factors(data, law)
    r = weighted_residuals(data, law, inverse)
    derivative = slopes_of(data, law, chosen)
    j = -np.einsum("nij,njk->nik", inverse, derivative) * scale
    bread = np.linalg.pinv(np.einsum("nia,nib->ab", j, j), rcond=1e-14)
    covariance = sandwich.covariance(j, r, bread)
    if not np.isfinite(covariance).all() or law.coefficient < 1e-6:
        raise IdentifyError("no friction shows: the traction does not oppose the slip")
    changed = dataclasses.replace(law, coefficient=law.coefficient * (1.0 + SECOND_ORDER))
    shift = weighted_residuals(data, changed, inverse) - r
    systematic = np.abs(np.einsum("ab,nib,ni->an", bread, j, shift)).sum(axis=1)
    return KineticFit(
        law=law,
        free=tuple(chosen),
        covariance=covariance * np.outer(scale, scale),
        systematic=systematic * scale,
        freedom=sandwich.degrees_of_freedom(j, bread),
        misfit=float(np.square(r).sum() / max(r.size - len(chosen), 1)),
        cost=cost(data, law),
        residuals=r,
    )


def parameter_scales(data: Calibrated, law: FrictionLaw) -> Array:
    """Return the changes (10,) of the vector that change the limit by 100 %, to first order."""
    radial, moment, rate, spin = data.sizes
    bending = float(data.bending(law.bending).mean())
    force = max(radial + bending * moment + max(law.preload, 0.0), 1e-12)
    limit = force * law.coefficient
    scales = np.ones(len(law.vector))
    scales[PRELOAD] = force
    scales[OVERLAP] = force / max(moment, 1e-12 * force)
    scales[VISCOUS] = limit / max(rate, 1e-12)
    scales[VISCOUS_SPIN] = limit * law.radius / max(spin, 1e-12)
    scales[OFFSET] = limit
    return scales


def predicted_deviations(data: Calibrated, law: FrictionLaw, free: Sequence[int]) -> Array:
    """Return the standard deviations (free,) expected from the noise at ``law``.

    In units of :func:`parameter_scales`.
    """
    chosen = list(free)
    inverse, _ = factors(data, law)
    derivative = slopes_of(data, law, chosen)
    j = np.einsum("nij,njk->nik", inverse, derivative) * parameter_scales(data, law)[chosen]
    _, sizes, vt = np.linalg.svd(j.reshape(-1, len(chosen)), full_matrices=False)
    sizes = np.maximum(sizes, 1e-9 * sizes.max(initial=1e-300))
    return np.asarray(np.sqrt(np.square(vt / sizes[:, None]).sum(axis=0)))


def unexplained(data: Calibrated, law: FrictionLaw, free: Sequence[int], k: int) -> float:
    """Return the share of the effect of parameter ``k`` that parameters ``free`` cannot imitate."""
    inverse, _ = factors(data, law)
    derivative = slopes_of(data, law, [*free, k])
    j = np.einsum("nij,njk->nik", inverse, derivative).reshape(-1, len(free) + 1)
    j = j / np.maximum(np.linalg.norm(j, axis=0), 1e-300)
    rest = j[:, -1] - j[:, :-1] @ _solve(j[:, :-1], j[:, -1])
    return float(np.linalg.norm(rest))
