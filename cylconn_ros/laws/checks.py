"""The laws of a step by their letters: one residual a sample and law, 0 where the law is exact.

Every residual is divided, row by row, by the sum of the absolute values of the terms that enter it,
down to the single products. Laws speak of the wrench before output limits. NaN: the law says
nothing about this sample.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.balance import balance, parts
from cylconn_ros.laws.observed import Observed, observe
from cylconn_ros.laws.residual import Block, ratio, worst
from cylconn_ros.laws.slip import friction_laws
from cylconn_ros.laws.step import CONSTRAINED, Step, begin, by_wrench

Array = NDArray[np.float64]

TITLES = {
    "C": "constraint",
    "D": "disc",
    "S": "slip",
    "K": "stick",
    "E": "dissipation",
    "T": "turning",
    "U": "stops",
    "A": "balance",
    "O": "order",
}
EXACT = "CDSKETA"
"""Laws that are checked sample by sample."""


def check(block: Block) -> tuple[dict[str, Array], Observed]:
    """Residuals (n,) by letter, and the samples as observed."""
    p, out = block.parameters, block.out
    o = observe(p, block.sample, block.past)
    s = begin(p, o, block.sample)
    wrench = out[:, layout.FORCE : layout.FORCE + 6]
    added, added_size = by_wrench(p, s, wrench)
    end, end_size = s.free + added, s.free_size + added_size
    found = {"C": constraint(s, end, end_size)}
    found |= friction_laws(block, o, s, end, end_size)
    found["A"] = np.maximum(
        np.maximum(balance(p, o, s, out), parts(p, o, s, out, end, end_size)),
        np.where(np.all(np.isfinite(out), axis=1) & (out[:, layout.STATUS] == 0), 0.0, np.inf),
    )
    return found, o


def constraint(s: Step, end: Array, size: Array) -> Array:
    """C: w+_c = target_c."""
    rows = ratio(end[:, CONSTRAINED] - s.target, size[:, CONSTRAINED] + s.target_size)
    return worst(rows)
