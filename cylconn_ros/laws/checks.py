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
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.residual import Block, ratio, worst
from cylconn_ros.laws.slip import friction_laws
from cylconn_ros.laws.step import AVAILABLE, CONSTRAINED, Step, begin, by_wrench, reaction_size

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
    added, _ = by_wrench(p, s, wrench, np.abs(wrench))
    end = s.free + added
    terms = wrench_size(p, o, s, out, end)
    end_size = s.free_size + by_wrench(p, s, wrench, terms)[1]
    found = {"C": constraint(s, end, end_size)}
    found |= friction_laws(block, o, s, end, end_size, reaction_size(p, s, wrench, terms))
    found["A"] = np.maximum(
        np.maximum(balance(p, o, s, out), parts(p, o, s, out, end, end_size)),
        np.where(np.all(np.isfinite(out), axis=1) & (out[:, layout.STATUS] == 0), 0.0, np.inf),
    )
    return found, o


def wrench_size(p: Parameters, o: Observed, s: Step, out: Array, end: Array) -> Array:
    """(n, 6) sums of the absolute values of the terms that make Lambda.

    Those of f1 and m1 are their parts, and of springs and dampers their formulas' terms: a stiff
    spring's force is the small difference of large ones.
    """
    terms = np.abs(out[:, layout.FORCE : layout.FORCE + 6])
    ends = np.abs(end[:, AVAILABLE] + s.bracket[:, AVAILABLE])
    speed = np.abs(o.w[:, AVAILABLE]) + ends
    u = np.abs(o.place - np.where(np.isnan(p.reference), o.start, p.reference))
    passive = p.stiffness * (u + 0.25 * p.h[:, None] * speed) + 0.5 * p.damping * speed
    for k, part in enumerate((layout.FORCE_FRICTION, layout.MOMENT_FRICTION)):
        others = np.abs(out[:, part : part + 3]).sum(axis=1)
        terms[:, AVAILABLE[k]] = passive[:, k] + others
    return terms


def constraint(s: Step, end: Array, size: Array) -> Array:
    """C: w+_c = target_c."""
    rows = ratio(end[:, CONSTRAINED] - s.target, size[:, CONSTRAINED] + s.target_size)
    return worst(rows)
