"""Random designs: Latin hypercube, Sobol or random points, mapped to distributions of parameters.

A design fills the unit cube (scipy.stats.qmc). Correlations act on normal scores: the points become
standard normal numbers, a Cholesky factor correlates them, and the distribution function leads back
to the cube (a Gaussian copula). Correlated normal distributions are thereby jointly normal with the
stated coefficients; for other distributions they are the coefficients of the scores.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import StudyError
from cylconn_ros.study.rows import Axis, known, rules_of, split

Array = NDArray[np.float64]

DESIGNS = ("latin", "sobol", "random")
_FORMS = {
    "uniform": ("LOW", "HIGH"),
    "normal": ("MEAN", "SD"),
    "lognormal": ("MEDIAN", "SD of the logarithm"),
    "triangular": ("LOW", "MODE", "HIGH"),
}


@dataclass(frozen=True)
class Distribution:
    """A distribution of one parameter.

    Attributes
    ----------
        kind: uniform, normal, lognormal or triangular. numbers: as the kind's form lists them.
        low, high: bounds outside of which a normal or lognormal distribution is cut off.
    """

    kind: str
    numbers: tuple[float, ...]
    low: float = -math.inf
    high: float = math.inf

    def values(self, points: Array) -> Array:
        """Quantiles (n,) for points (n,) of the unit interval."""
        from scipy import stats

        a = self.numbers
        if self.kind == "uniform":
            return np.asarray(a[0] + (a[1] - a[0]) * points, np.float64)
        if self.kind == "triangular":
            shape = (a[1] - a[0]) / (a[2] - a[0])
            return np.asarray(stats.triang.ppf(points, shape, a[0], a[2] - a[0]), np.float64)
        logarithmic = self.kind == "lognormal"
        mean = math.log(a[0]) if logarithmic else a[0]
        ends = np.array([self.low, self.high])
        if logarithmic:
            ends = np.log(np.maximum(ends, 0.0), where=ends > 0.0, out=np.full(2, -np.inf))
        below, above = stats.norm.cdf((ends - mean) / a[1])
        scores = stats.norm.ppf(below + (above - below) * points)
        found = mean + a[1] * scores
        return np.asarray(np.exp(found) if logarithmic else found, np.float64)


def read_distribution(text: str) -> tuple[str, Distribution]:
    """Parameter and distribution of ``NAME=KIND:NUMBERS[:LOW:HIGH]``; raises StudyError.

    The last two cut off a normal or lognormal distribution. ``NAME=LOW:HIGH`` is uniform.
    """
    name, _, values = text.partition("=")
    name = known(name.strip())
    kind, *parts = values.split(":")
    if kind not in _FORMS and len(parts) == 1:
        kind, parts = "uniform", [kind, *parts]
    form = _FORMS.get(kind, ())
    try:
        numbers = [float(part) for part in parts]
        if not all(map(math.isfinite, numbers)):
            raise ValueError
        rest = numbers[len(form) :]
        if not form or len(numbers) < len(form) or len(rest) not in (0, 2):
            raise ValueError
        if rest and (kind not in ("normal", "lognormal") or not rest[0] < rest[1]):
            raise ValueError
        chosen = numbers[: len(form)]
        _check(kind, chosen)
    except ValueError:
        forms = "; ".join(f"{k}:{':'.join(words)}" for k, words in _FORMS.items())
        raise StudyError(
            f"{text}: must be NAME=KIND:NUMBERS with {forms} (SD > 0, LOW < HIGH); normal and "
            "lognormal may end in :LOW:HIGH, where they are cut off"
        ) from None
    rules = rules_of(name)
    if rules.kind not in ("float", "vector") or (rules.kind == "vector" and split(name)[1] is None):
        hint = f"give a component, {name}[0]" if rules.kind == "vector" else "use --vary"
        raise StudyError(f"{name}: a distribution needs a number; {hint}")
    return name, Distribution(kind, tuple(chosen), *rest)


def _check(kind: str, numbers: Sequence[float]) -> None:
    """Raise ValueError for numbers that are no distribution of this kind."""
    good = {
        "uniform": lambda a: a[0] < a[1],
        "normal": lambda a: a[1] > 0.0,
        "lognormal": lambda a: a[0] > 0.0 and a[1] > 0.0,
        "triangular": lambda a: a[0] <= a[1] <= a[2] and a[0] < a[2],
    }[kind]
    if not good(numbers):
        raise ValueError


def read_correlation(text: str) -> tuple[str, str, float]:
    """Two parameters and their coefficient, of ``NAME,NAME=R``; raises StudyError."""
    names, _, value = text.partition("=")
    pair = [name.strip() for name in names.split(",")]
    try:
        coefficient = float(value)
        if len(pair) != 2 or pair[0] == pair[1] or not -1.0 < coefficient < 1.0:
            raise ValueError
    except ValueError:
        raise StudyError(f"--correlation {text}: must be NAME,NAME=R with -1 < R < 1") from None
    return pair[0], pair[1], coefficient


def sample(
    distributions: Mapping[str, Distribution],
    count: int,
    *,
    correlations: Sequence[tuple[str, str, float]] = (),
    design: str = "latin",
    seed: int = 1,
) -> Axis:
    """Draw ``count`` points of the joint distribution; columns (count,) by parameter.

    ``design``: ``latin``, ``sobol`` (best with a power of two) or ``random``. The same arguments
    give the same points. Raises StudyError for correlations that contradict each other or name an
    unknown parameter, or if SciPy is not installed.
    """
    if design not in DESIGNS:
        raise StudyError(f"design = {design}: must be one of {', '.join(DESIGNS)}")
    if count < 1 or not distributions:
        raise StudyError(
            f"a sample of {count} rows of {len(distributions)} parameters: must be at least one "
            "each; give --distribution NAME=KIND:… or --vary NAME=LOW:HIGH"
        )
    try:
        from scipy.stats import norm
    except ImportError:
        raise StudyError("random designs need SciPy: pip install '.[scale]'") from None
    names = list(distributions)
    matrix = np.eye(len(names))
    for one, other, coefficient in correlations:
        for name in (one, other):
            if name not in distributions:
                raise StudyError(f"correlation of {name}: has no distribution")
        i, j = names.index(one), names.index(other)
        matrix[i, j] = matrix[j, i] = coefficient
    points = _points(len(names), count, design, seed)
    if correlations:
        try:
            factor = np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            raise StudyError("the correlations contradict each other (no such matrix)") from None
        inside = np.clip(points, 1e-16, 1.0 - 1e-16)
        points = norm.cdf(norm.ppf(inside) @ factor.T)
    return {name: distributions[name].values(points[:, k]) for k, name in enumerate(names)}


def _points(dimension: int, count: int, design: str, seed: int) -> Array:
    """(count, dimension) points of the open unit cube."""
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    if design == "random":
        return generator.random((count, dimension))
    engine: Any = {"latin": qmc.LatinHypercube, "sobol": qmc.Sobol}[design](
        dimension, seed=generator
    )
    with warnings.catch_warnings():  # of Sobol: balance needs a power of two, which the docs say
        warnings.simplefilter("ignore", UserWarning)
        points = engine.random(count)
    return np.clip(np.asarray(points, np.float64), 1e-12, 1.0 - 1e-12)
