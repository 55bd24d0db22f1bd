"""Numbers of a page: what is rounding is shown as zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDING = 1e-12
"""In the unit of a quantity: smaller values are rounding errors."""
_RELATIVE = ("residual", "relative")  # in names of quantities whose small values tell something


def without_rounding(name: str, values: Array) -> Array:
    """Return the values (n,) of a quantity, those below ROUNDING as 0; not those of residuals."""
    if any(word in name for word in _RELATIVE):
        return values
    return np.where(np.abs(values) < ROUNDING, 0.0, values)
