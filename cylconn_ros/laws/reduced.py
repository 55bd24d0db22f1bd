"""What is left of a step once constraint, springs and dampers are eliminated: slide and spin."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws.parameters import Bools, Parameters, Rows
from cylconn_ros.laws.sample_state import Observed
from cylconn_ros.laws.step import AVAILABLE, CONSTRAINED, Step, compliance, inverse

Array = NDArray[np.float64]
WORST_CONDITION = 1e10  # of the elimination: beyond it a grid cannot tell solutions apart


@dataclasses.dataclass
class Problem(Rows):
    """What is left for friction: s+ = s_free + S phi, (f2 f3 m2 m3) = base + by phi."""

    parameters: Parameters
    before: Array  # (n, 2) s-
    free: Array  # (n, 2)
    s: Array  # (n, 2, 2)
    base: Array  # (n, 4)
    by: Array  # (n, 4, 2)
    after_stick: Bools
    condition: Array  # of the elimination
    before_size: Array  # (n, 2) the sizes of the terms of s- and s_free
    free_size: Array
    base_size: Array  # (n, 4) of what makes the reactions
    held: Bools  # (n, 2) at a rate of its own
    push: Array  # (n, 2) friction and reactions on slide and spin: push + push_by phi
    push_by: Array  # (n, 2, 2)


def problem_of(
    p: Parameters, o: Observed, s: Step, held: Bools | None = None, rates: Array | None = None
) -> Problem:
    """Eliminate constraint, springs and dampers: a 6 x 6 system with three right-hand sides.

    held: (n, 2) whether slide, whether spin is held at a rate of its own, ``rates`` (n, 2).
    """
    n, h = len(p.h), p.h[:, None]
    g = compliance(p, s)
    unit = np.stack([np.ones(n), p.radius], axis=1)
    u = o.place - np.where(np.isnan(p.reference), o.start, p.reference)
    e = 0.25 * p.stiffness * h + 0.5 * p.damping
    push = -p.stiffness * (u + 0.25 * h * o.w[:, AVAILABLE])
    push -= 0.5 * p.damping * o.w[:, AVAILABLE]
    push += np.where(np.isnan(p.command[:, :, 2]), 0.0, p.command[:, :, 2])
    none = np.zeros((n, 2))
    held = none > 0.0 if held is None else held
    rates = none if rates is None else np.where(held, rates, 0.0)
    ends = s.free[:, AVAILABLE] + s.bracket[:, AVAILABLE]
    scale = np.sqrt(np.einsum("nii->ni", g))
    even = g / (scale[:, :, None] * scale[:, None, :])  # in units where G has ones on its diagonal
    matrix, right = np.empty((n, 6, 6)), np.zeros((n, 6, 3))
    stiff = h * e * scale[:, AVAILABLE] ** 2
    matrix[:, AVAILABLE] = stiff[:, :, None] * even[:, AVAILABLE]
    for k, row in enumerate(AVAILABLE):
        matrix[:, row, row] += 1.0
        right[:, row, 0] = scale[:, row] * (push - e * ends)[:, k]
        right[:, row, 1 + k] = scale[:, row] * unit[:, k]
        at = held[:, k]
        matrix[at, row] = even[at, row]
        right[at, row] = 0.0
        right[at, row, 0] = (rates - ends)[at, k] / (scale[at, row] * h[at, 0])
    matrix[:, CONSTRAINED] = even[:, CONSTRAINED]
    right[:, CONSTRAINED, 0] = (s.target - s.free[:, CONSTRAINED]) / (scale[:, CONSTRAINED] * h)
    greatest = np.max(np.abs(matrix), axis=2, keepdims=True)
    matrix, right = matrix / greatest, right / greatest
    condition = np.linalg.cond(matrix)
    matrix[condition > 1e3 * WORST_CONDITION] = np.eye(6)  # not judged
    wrench = np.linalg.solve(matrix, right) / scale[:, :, None]
    slips = h[:, :, None] * (g[:, AVAILABLE] @ wrench)
    slips[:, :, 0] += ends + s.hold
    slips *= unit[:, :, None]
    slips[:, :, 0] = np.where(held, unit * (rates + s.hold), slips[:, :, 0])
    slips[:, :, 1:][held] = 0.0
    slips[:, :, 1:].transpose(0, 2, 1)[held] = 0.0
    inner = 0.5 * (slips[:, :, 1:] + slips[:, :, 1:].transpose(0, 2, 1))
    x = wrench[:, AVAILABLE] + (e / unit)[:, :, None] * slips
    x[:, :, 0] -= push + e * s.hold
    reactions = wrench[:, CONSTRAINED]
    before = unit * o.w[:, AVAILABLE]
    free_size = s.free_size + s.bracket_size
    free_size[:, AVAILABLE] += s.hold_size
    base_size = _reaction_terms(p, s, g)
    through = np.abs(g[:, AVAILABLE][:, :, CONSTRAINED])
    free_size[:, AVAILABLE] += h * np.einsum("nij,nj->ni", through, base_size)
    sizes = [unit * size[:, AVAILABLE] for size in (o.w_size, free_size)]
    return Problem(
        p,
        before,
        slips[:, :, 0],
        inner,
        reactions[:, :, 0],
        reactions[:, :, 1:],
        o.holding,
        condition,
        sizes[0],
        sizes[1],
        base_size,
        held,
        x[:, :, 0],
        x[:, :, 1:],
    )


def _reaction_terms(p: Parameters, s: Step, g: Array) -> Array:
    """(n, 4) |G_cc^-1| times the sizes of the constraint's rows: what rounding starts from."""
    rows = (s.free_size[:, CONSTRAINED] + s.target_size) / p.h[:, None]
    inner = np.abs(inverse(g[:, CONSTRAINED][:, :, CONSTRAINED]))
    return np.asarray(np.einsum("nij,nj->ni", inner, rows))
