"""How much each varied parameter explains of an output: first-order shares of its variance.

The share of a parameter is the variance of the output's mean over bins of that parameter, divided
by the output's variance (the correlation ratio, an estimate of the first-order Sobol index), less
what chance gives between bins: 1 - (1 - r)(n - 1)/(n - k) for n rows and k bins. It needs no
linear relation; it does not see what parameters do only together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BINS = 20
_LEAST_ROWS_A_BIN = 5
_ROUNDING = 1e-12  # standard deviation over greatest value of an output that does not change


@dataclass(frozen=True)
class Sensitivity:
    """Share of an output's variance that one parameter explains.

    Attributes
    ----------
        parameter, output: column names. share: 0 to 1. rank: Spearman's rank correlation, -1 to 1;
            NaN for a parameter without an order.
    """

    parameter: str
    output: str
    share: float
    rank: float


def bins_of(values: NDArray[Any]) -> NDArray[np.intp]:
    """(n,) bin of each value: one a value if there are few, else BINS of equal numbers."""
    known, which = np.unique(values, return_inverse=True)
    count = min(BINS, max(2, len(values) // _LEAST_ROWS_A_BIN))
    if len(known) <= count:
        return which
    order = np.argsort(which, kind="stable")
    found = np.empty(len(values), dtype=np.intp)
    found[order] = np.arange(len(values)) * count // len(values)
    return found


def share(parameter: NDArray[Any], output: Array) -> float:
    """Share of the variance of ``output`` (n,) that ``parameter`` (n,) explains, 0 to 1."""
    n = len(output)
    variance = float(np.var(output)) if n else 0.0
    if n < 3 or not variance > (_ROUNDING * float(np.abs(output).max())) ** 2:
        return 0.0
    which = bins_of(parameter)
    counts = np.bincount(which)
    used = counts > 0
    means = np.bincount(which, output)[used] / counts[used]
    between = float(np.sum(counts[used] * (means - output.mean()) ** 2)) / n / variance
    bins = int(used.sum())
    if n <= bins:
        return 0.0
    return float(np.clip(1.0 - (1.0 - between) * (n - 1) / (n - bins), 0.0, 1.0))


def rank_correlation(one: NDArray[Any], other: Array) -> float:
    """Spearman's rank correlation of two columns (n,); NaN for texts or a constant."""
    if one.dtype == object or len(one) < 3:
        return float("nan")
    first, second = _ranks(np.asarray(one, np.float64)), _ranks(other)
    if first.std() == 0.0 or second.std() == 0.0:
        return float("nan")
    return float(np.corrcoef(first, second)[0, 1])


def _ranks(values: Array) -> Array:
    """Ranks (n,), equal values with their mean rank."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    return np.asarray((ends - 0.5 * (counts + 1))[which], np.float64)


def sensitivities(
    inputs: Mapping[str, NDArray[Any]], outputs: Mapping[str, Array]
) -> list[Sensitivity]:
    """Sensitivities of all outputs to all inputs; rows whose output is not finite do not count."""
    found = []
    for output, values in outputs.items():
        good = np.isfinite(values)
        for parameter, column in inputs.items():
            x, y = column[good], values[good]
            found.append(Sensitivity(parameter, output, share(x, y), rank_correlation(x, y)))
    return found
