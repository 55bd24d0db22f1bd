"""Covariance of a weighted least-squares estimate from the spread of its own windows.

The sandwich covariance holds if the noise differs from the assumed weights. It is itself an
estimate: a sum of squares of window scores, of which few count for a parameter that few windows
determine. Its degrees of freedom are those of the chi-squared distribution with the same mean and
variance for residuals of equal variance (Satterthwaite; Bell and McCaffrey, Survey Methodology 28,
2002): at 33 windows of a guide that is pushed to and fro, 11 for mu, not 31.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SINGULAR = 1e-9  # added to 1, for a window that alone determines a parameter


def covariance(jacobian: Array, r: Array, bread: Array) -> Array:
    """Return the HC3 covariance (k, k) of an estimate, with blocks of two rows per window.

    Args:
        jacobian: (n, 2, k) derivatives of the residuals ``r`` (n, 2). bread: (J^T J)^-1.
    """
    left = np.linalg.solve(_kept(jacobian, bread), r[:, :, None])[:, :, 0]
    errors = np.einsum("nia,ni->na", jacobian, left) @ bread  # squared as a whole: no variance < 0
    return np.asarray(errors.T @ errors)


def degrees_of_freedom(jacobian: Array, bread: Array) -> Array:
    """Return the degrees of freedom (k,) of each variance of :func:`covariance`, at least 1.

    A variance is the sum of (a_i^T r_i)^2, a_i = (I - H_ii)^-1 J_i b, b a column of the bread. With
    residuals (I - H) e its eigenvalues are those of K_ij = a_i^T (I - H)_ij a_j, and the degrees of
    freedom tr(K)^2 / tr(K^2).
    """
    a = np.linalg.solve(_kept(jacobian, bread), jacobian @ bread)  # (n, 2, k)
    a /= np.maximum(np.abs(a).max(axis=(0, 1)), 1e-300)  # K counts up to a factor
    whole = np.square(a).sum(axis=1)  # (n, k)
    u = np.einsum("nia,nib->anb", a, jacobian)  # K = diag(whole) - u bread u^T, for each parameter
    own = np.einsum("anb,bc,anc->na", u, bread, u, optimize=True)
    inner = np.einsum("anb,anc->abc", u, u, optimize=True) @ bread
    trace = (whole - own).sum(axis=0)
    square = (whole * (whole - 2.0 * own)).sum(axis=0) + np.einsum("abc,acb->a", inner, inner)
    return np.maximum(trace**2 / np.maximum(square, 1e-12), 1.0)


def _kept(jacobian: Array, bread: Array) -> Array:
    """Return I - H_ii (n, 2, 2): the share of its own noise that a window's residual keeps."""
    leverage = np.einsum("nia,ab,njb->nij", jacobian, bread, jacobian, optimize=True)
    return np.asarray(np.eye(2) * (1.0 + _SINGULAR) - leverage)
