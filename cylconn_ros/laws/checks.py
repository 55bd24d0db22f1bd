"""The laws of a step by their letters: one residual a sample and law, 0 where the law is exact.

Every residual is divided, row by row, by the sum of the absolute values of the terms that enter it,
down to the single products. Laws speak of the wrench before output limits. NaN: the law says
nothing about this sample.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.balance import balance, parts, pressed, sums
from cylconn_ros.laws.observed import Observed, observe
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.residual import Block, ratio, worst
from cylconn_ros.laws.slip import friction_laws, friction_of_sample
from cylconn_ros.laws.step import AVAILABLE, CONSTRAINED, Step, begin, by_wrench, reaction_size
from cylconn_ros.laws.stops import bounds_of, stops

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
CLAIMED = {
    "impulse": "CDSKETUA",
    "baumgarte": "DEA",
    "penalty": "DA",
    "augmented_lagrangian": "DA",
}
"""Laws that hold sample by sample, by method. The stick of penalty methods is a spring: it gives
back what it took, so that E is a matter of sums there (passivity_balance)."""


def check(block: Block, method: str = "impulse") -> dict[str, Array]:
    """Residuals (n,) by letter of the laws that the method claims."""
    p = block.parameters
    o = observe(p, block.sample, block.past)
    s = begin(p, o, block.sample)
    found = _of_step(block, o, s) if method == "impulse" else _of_sample(block, o, s)
    usable = np.all(np.isfinite(block.out), axis=1) & (block.out[:, layout.STATUS] == 0)
    found["A"] = np.maximum(found["A"], np.where(usable, 0.0, np.inf))
    return {letter: found[letter] for letter in CLAIMED[method]}


def _of_step(block: Block, o: Observed, s: Step) -> dict[str, Array]:
    """A step that is solved as a whole, impulse: its wrench acts in q~, its laws at its end."""
    p, out = block.parameters, block.out
    b = bounds_of(block, o)
    wrench = out[:, layout.FORCE : layout.FORCE + 6]
    added, _ = by_wrench(p, s, wrench, np.abs(wrench))
    end = s.free + added
    terms = wrench_size(p, o, s, out, end)
    end_size = s.free_size + by_wrench(p, s, wrench, terms)[1]
    reactions = reaction_size(p, s, wrench, terms)
    return {
        "C": constraint(s, end, end_size),
        **friction_laws(block, o, s, end, end_size, reactions),
        "U": stops(block, o, s, b, end, end_size),
        "A": np.maximum(balance(p, o, s, out), parts(p, o, s, out, end, end_size)),
    }


def _of_sample(block: Block, o: Observed, s: Step) -> dict[str, Array]:
    """A wrench of the sample's own instant: it acts in q, against the sample's slip velocity."""
    p, out = block.parameters, block.out
    here = dataclasses.replace(s, frame=o.frame)
    return {
        **friction_of_sample(block, o),
        "A": np.maximum(balance(p, o, here, out), np.maximum(sums(out), pressed(p, out))),
    }


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
