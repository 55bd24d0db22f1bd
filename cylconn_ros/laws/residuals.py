"""The laws of a step by their letters: one residual a sample and law, 0 where the law is exact.

Every residual is divided, row by row, by the sum of the absolute values of the terms that enter it,
down to the single products. Laws speak of the wrench before output limits. NaN: the law says
nothing about this sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.balance import balance, driven, parts, sums
from cylconn_ros.laws.claims import claimed
from cylconn_ros.laws.explicit_methods import multiplied, regularised, springs
from cylconn_ros.laws.normalised import Block, ratio, worst
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.predicted_end import begin
from cylconn_ros.laws.sample_state import Observed, observe
from cylconn_ros.laws.slip import friction_laws
from cylconn_ros.laws.step import AVAILABLE, CONSTRAINED, Step, by_wrench, reaction_size
from cylconn_ros.laws.stops import bounds_of, stops

Array = NDArray[np.float64]


def check(block: Block, method: str = "impulse") -> dict[str, Array]:
    """Residuals (n,) by letter of the laws that the method claims."""
    p = block.parameters
    o = observe(p, block.sample, block.past)
    s = begin(p, o, block.sample)
    found = LAWS[method](block, o, s)
    usable = np.all(np.isfinite(block.out), axis=1) & (block.out[:, layout.STATUS] == 0)
    found["A"] = np.maximum(found["A"], np.where(usable, 0.0, np.inf))
    return {letter: found[letter] for letter in claimed(method)}


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


def _of_mean(block: Block, o: Observed, s: Step) -> dict[str, Array]:
    """minimal: a mean over the period, or impulse's answer where bounds hold slide or spin."""
    p, out = block.parameters, block.out
    found = _of_step(block, o, s)
    b = bounds_of(block, o)
    held = b.held(out).any(axis=1) | (out[:, layout.RESTITUTION] > 0.0)
    for letter in "DSETU":
        asked = held & ~(o.holding & (letter in "ST"))  # the place that stick holds is its own
        found[letter] = np.where(asked, found[letter], np.nan)
    balanced = [balance(p, o, s, out), sums(out), driven(p, out)]
    found["A"] = np.asarray(np.max(balanced, axis=0))
    return found


LAWS: dict[str, Callable[[Block, Observed, Step], dict[str, Array]]] = {
    "impulse": _of_step,
    "minimal": _of_mean,
    "baumgarte": regularised,
    "penalty": springs,
    "augmented_lagrangian": multiplied,
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
