"""Covariance of an estimate from its own windows: degrees of freedom; loads of unequal noise."""

import numpy as np
import pytest
from scipy.stats import t

from cylconn_ros.identification.likelihood import sandwich
from cylconn_ros.identification.likelihood.contact_loads import _moments


def test_degrees_of_freedom_are_those_of_the_eigenvalues() -> None:
    """Against the definition: tr(K)^2 / tr(K^2) with all of I - H written out."""
    rng, n, k = np.random.default_rng(1), 9, 3
    jacobian = rng.normal(size=(n, 2, k))
    flat = jacobian.reshape(-1, k)
    bread = np.linalg.inv(flat.T @ flat).astype(np.float64)
    rest = np.eye(2 * n) - flat @ bread @ flat.T
    found = sandwich.degrees_of_freedom(jacobian, bread)
    for j in range(k):
        rows = np.empty((n, 2 * n))
        for i in range(n):
            at = slice(2 * i, 2 * i + 2)
            rows[i] = np.linalg.solve(rest[at, at], jacobian[i] @ bread[:, j]) @ rest[at]
        matrix = rows @ rows.T
        assert found[j] == pytest.approx(np.trace(matrix) ** 2 / np.square(matrix).sum(), rel=1e-6)


def test_intervals_of_a_parameter_that_few_windows_determine_hold() -> None:
    """A slope that 4 of 30 windows determine: 95 % of intervals, where t(28) gives fewer."""
    rng, n, draws = np.random.default_rng(2), 30, 2000
    jacobian = np.zeros((n, 2, 2))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
    jacobian[4:, 1, 1] = 0.05
    flat = jacobian.reshape(-1, 2)
    bread = np.linalg.inv(flat.T @ flat).astype(np.float64)
    freedom = sandwich.degrees_of_freedom(jacobian, bread)
    assert freedom[1] < 5.0 < 25.0 < freedom[0] <= n
    inside = np.zeros((2, 2))
    for _ in range(draws):
        e = rng.standard_normal(2 * n)
        error = bread @ flat.T @ e
        r = (e - flat @ error).reshape(n, 2)
        deviation = np.sqrt(np.diag(sandwich.covariance(jacobian, r, bread)))
        for row, degrees in enumerate((freedom, n - 2.0)):
            inside[row] += np.abs(error) <= t.isf(0.025, degrees) * deviation
    right, naive = inside / draws
    assert naive[1] < 0.93
    assert (right > 0.94).all()
    assert (right < 0.98).all()


def test_short_windows_do_not_decide_the_mean_of_the_loads() -> None:
    """30 windows with noise of 0.02 N, 50 with 0.9 N: the mean of 20 N is known to 0.004 N."""
    rng, n, draws = np.random.default_rng(3), 80, 200
    sizes = np.where(np.arange(n) < 30, 0.02, 0.9)
    noise = np.zeros((n, 2, 2))
    noise[:, 0, 0] = noise[:, 1, 1] = sizes**2
    errors = []
    for _ in range(draws):
        x = np.stack([20.0 + sizes * rng.standard_normal(n), np.zeros(n)], axis=1)
        errors.append(_moments(x, noise, np.ones((n, 1)))[0][0, 0] - 20.0)
    assert np.std(errors) == pytest.approx(np.sum(sizes**-2.0) ** -0.5, rel=0.3)
