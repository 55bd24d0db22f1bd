"""Residuals of the laws of a step: one value per sample and law, 0 if the law holds exactly.

Each row of a law is divided by the sum of the absolute values of the terms that enter it, down to
the single products. The laws concern the wrench before output limits. NaN: the law does not apply
to the sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import never_gains
from cylconn_ros.laws.balance import component_residual, wrench_residual
from cylconn_ros.laws.bounds import Bounds, driven, stop_sides
from cylconn_ros.laws.drives import gives_way
from cylconn_ros.laws.explicit_methods import augmented_lagrangian, baumgarte, penalty
from cylconn_ros.laws.guarantees import guaranteed_laws
from cylconn_ros.laws.impact_friction import ImpactFriction, impact_friction
from cylconn_ros.laws.normalised import TOLERANCE, Block, ratio, worst
from cylconn_ros.laws.parameters import Bools, Parameters
from cylconn_ros.laws.predicted_end import prepare_step
from cylconn_ros.laws.sample_state import SampleState, state_of
from cylconn_ros.laws.slip import friction_laws
from cylconn_ros.laws.step import CONSTRAINED, FREE, Step, rates_from_wrench, reaction_size
from cylconn_ros.laws.stops import bounds_of, stops

Array = NDArray[np.float64]
SOLVED = {"friction_limit", "slip_direction", "stick", "slip_averaging", "stops", "balance"}
"""Laws that are not stated of a step that is flagged NOT_CONVERGED; the report counts them."""
NEARLY_AT_REST = 1e-5  # of the change of a rate in a step


def check(block: Block, method: str = "impulse", in_order: bool = False) -> dict[str, Array]:
    """Residuals (n,) by name of the laws that the method guarantees for a sample.

    in_order: the samples follow each other, so that energy is summed over them.

    The balance residual is infinite for an output with a value that is not finite or a status other
    than OK.
    """
    p = block.parameters
    o = state_of(p, block.sample, block.past)
    s = prepare_step(p, o, block.sample, block.others)
    found = RESIDUALS[method](block, o, s)
    if "never_gains" in guaranteed_laws(method):
        alone = block.others is None  # stated for the wrenches of one connector
        gains = never_gains.residual(block, o, s, in_order) if alone else np.full(len(p.h), np.nan)
        found["never_gains"] = gains
    if block.elements is not None:
        found["balance"] = np.maximum(found["balance"], block.elements.residual)
    usable = np.all(np.isfinite(block.out), axis=1) & (block.out[:, layout.STATUS] == 0)
    found["balance"] = np.maximum(found["balance"], np.where(usable, 0.0, np.inf))
    # flagged: no solution was found where friction jumps at a kink of a table
    unsolved = block.out[:, layout.FLAGS].astype(np.int64) & layout.NOT_CONVERGED != 0
    for law in SOLVED & found.keys():
        found[law] = np.where(unsolved & usable, np.nan, found[law])
    return {law: found[law] for law in guaranteed_laws(method)}


def impulse(block: Block, o: SampleState, s: Step) -> dict[str, Array]:
    """Laws of impulse: the wrench acts in q~, the laws hold at the end of the step."""
    p, out = block.parameters, block.out
    b = bounds_of(block, o, s)
    wrench = out[:, layout.FORCE : layout.FORCE + 6]
    added, _ = rates_from_wrench(p, s, wrench, np.abs(wrench))
    end = s.free + added
    terms = wrench_size(p, o, s, out, end)
    end_size = s.free_size + rates_from_wrench(p, s, wrench, terms)[1]
    reactions = reaction_size(p, s, wrench, terms)
    components = component_residual(p, o, s, out, end, end_size)
    friction = friction_laws(block, o, s, end, end_size, reactions, _rests(p, o, s, out, b))
    size = end_size[:, FREE] + s.bracket_size[:, FREE]
    return {
        "constraint": constraint(s, end, end_size),
        **_with_impacts(friction, impact_friction(p, block.tables, o, s, b, out, size), b, out),
        "stops": stops(block, o, s, b, end, end_size),
        "balance": np.maximum(wrench_residual(p, o, s, out, weakened=True), components),
    }


RESIDUALS: dict[str, Callable[[Block, SampleState, Step], dict[str, Array]]] = {
    "impulse": impulse,
    "baumgarte": baumgarte,
    "penalty": penalty,
    "augmented_lagrangian": augmented_lagrangian,
}
"""Residuals of a block by method, for the methods that compute the wrench of a sample."""


def _with_impacts(
    found: dict[str, Array], impact: ImpactFriction, b: Bounds, out: Array
) -> dict[str, Array]:
    """The laws of friction; in steps of an impact, its friction in their place where it fits.

    It is judged as the law of the slip direction: the motion that it opposes is the ideal one. It
    is not where rounding decides whether there is an impact, and how it goes on.
    """
    worst_one = np.nanmax(np.stack([np.zeros(len(impact.off)), *found.values()]), axis=0)
    unknown = impact.undecided | (b.ambiguous & (stop_sides(out) != 0.0).any(axis=1))
    better = impact.required | (impact.off < worst_one)
    rows = (impact.rows & better) | (unknown & (worst_one > TOLERANCE))
    own = np.where(unknown, np.nan, impact.off)
    return {
        law: np.where(rows, own if law == "slip_direction" else np.nan, values)
        for law, values in found.items()
    }


def _rests(p: Parameters, o: SampleState, s: Step, out: Array, b: Bounds) -> Bools:
    """(n, 2) what a bound holds at rest; where rounding or a drive decides, as the outputs say."""
    sticks, at_stop = out[:, layout.REGIME] == layout.STICK, stop_sides(out) != 0.0
    beside = driven(p, b) & sticks[:, None]
    w = o.w[:, FREE]
    slow = np.abs(w) <= NEARLY_AT_REST * np.abs(s.free[:, FREE] - w)
    untouched = out[:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]] == 0.0
    held = b.rests(out) & ~gives_way(p, out, b)
    return np.asarray(held | (at_stop & (beside | (slow & untouched))))


def wrench_size(p: Parameters, o: SampleState, s: Step, out: Array, end: Array) -> Array:
    """(n, 6) sums of the absolute values of the terms that make Lambda.

    The terms of f1 and m1 are their components, and those of springs and dampers are the terms of
    their formulas: the force of a stiff spring is the small difference of large terms.
    """
    terms = np.abs(out[:, layout.FORCE : layout.FORCE + 6])
    ends = np.abs(end[:, FREE] + s.bracket[:, FREE])
    speed = np.abs(o.w[:, FREE]) + ends
    u = np.abs(o.position - np.where(np.isnan(p.reference), o.start, p.reference))
    passive = p.stiffness * (u + 0.25 * p.h[:, None] * speed) + 0.5 * p.damping * speed
    for k, part in enumerate((layout.FORCE_FRICTION, layout.MOMENT_FRICTION)):
        others = np.abs(out[:, part : part + 3]).sum(axis=1)
        terms[:, FREE[k]] = passive[:, k] + others
    return terms


def constraint(s: Step, end: Array, size: Array) -> Array:
    """Residual (n,) of the constraint law, w+_c = target_c."""
    rows = ratio(end[:, CONSTRAINED] - s.target, size[:, CONSTRAINED] + s.target_size)
    return worst(rows)
