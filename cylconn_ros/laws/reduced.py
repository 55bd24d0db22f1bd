"""Reduced friction problem of a step: slide and spin after elimination of the other rows."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws.parameters import Bools, Parameters, Rows
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import CONSTRAINED, FREE, Step, compliance, inverse

Array = NDArray[np.float64]
WORST_CONDITION = 1e10  # of the elimination; beyond it a grid cannot separate solutions


@dataclasses.dataclass
class Problem(Rows):
    """Reduced problem: s+ = free + S phi, and (f2 f3 m2 m3) = base + by phi."""

    parameters: Parameters
    before: Array  # (n, 2) s-
    free: Array  # (n, 2)
    s: Array  # (n, 2, 2)
    base: Array  # (n, 4)
    by: Array  # (n, 4, 2)
    after_stick: Bools
    condition: Array  # of the elimination
    before_size: Array  # (n, 2) sizes of s- and of s_free
    free_size: Array
    base_size: Array  # (n, 4) of the terms of the reactions
    held: Bools  # (n, 2) whether the rate is prescribed
    push: Array  # (n, 2) friction and reactions on slide and spin: push + push_by phi
    push_by: Array  # (n, 2, 2)


def problem_of(
    p: Parameters,
    o: SampleState,
    s: Step,
    held: Bools | None = None,
    rates: Array | None = None,
    rests: Bools | None = None,
) -> Problem:
    """Eliminate constraint, springs and dampers: a 6 x 6 system with three right-hand sides.

    held: (n, 2) whether slide and spin have a prescribed rate; rates: (n, 2) these rates; rests:
    (n, 2) whether a held one is at rest, so that friction does not slip there.
    """
    n, h = len(p.h), p.h[:, None]
    g = compliance(p, s)
    unit = np.stack([np.ones(n), p.radius], axis=1)
    u = o.position - np.where(np.isnan(p.reference), o.start, p.reference)
    e = 0.25 * p.stiffness * h + 0.5 * p.damping
    push = -p.stiffness * (u + 0.25 * h * o.w[:, FREE])
    push -= 0.5 * p.damping * o.w[:, FREE]
    push += p.imposed_force
    none = np.zeros((n, 2))
    held = none > 0.0 if held is None else held
    rates = none if rates is None else np.where(held, rates, 0.0)
    ends = s.free[:, FREE] + s.bracket[:, FREE]
    scale = np.sqrt(np.einsum("nii->ni", g))
    even = g / (scale[:, :, None] * scale[:, None, :])  # scaled so that G has ones on its diagonal
    matrix, right = np.empty((n, 6, 6)), np.zeros((n, 6, 3))
    stiff = h * e * scale[:, FREE] ** 2
    matrix[:, FREE] = stiff[:, :, None] * even[:, FREE]
    for k, row in enumerate(FREE):
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
    matrix[condition > 1e3 * WORST_CONDITION] = np.eye(6)  # excluded from the check
    wrench = np.linalg.solve(matrix, right) / scale[:, :, None]
    slips = h[:, :, None] * (g[:, FREE] @ wrench)
    slips[:, :, 0] += ends + s.hold
    slips *= unit[:, :, None]
    slips[:, :, 0] = np.where(held, unit * (rates + s.hold), slips[:, :, 0])
    slips[:, :, 1:][held] = 0.0
    slips[:, :, 1:].transpose(0, 2, 1)[held] = 0.0
    inner = 0.5 * (slips[:, :, 1:] + slips[:, :, 1:].transpose(0, 2, 1))
    x = wrench[:, FREE] + (e / unit)[:, :, None] * slips
    x[:, :, 0] -= push + e * s.hold
    reactions = wrench[:, CONSTRAINED]
    before = unit * o.w[:, FREE]
    free_size = s.free_size + s.bracket_size
    free_size[:, FREE] += s.hold_size
    base_size = _reaction_terms(p, s, g)
    through = np.abs(g[:, FREE][:, :, CONSTRAINED])
    free_size[:, FREE] += h * np.einsum("nij,nj->ni", through, base_size)
    still = held & (none > 0.0 if rests is None else rests)
    sizes = [np.where(still, 0.0, unit * size[:, FREE]) for size in (o.w_size, free_size)]
    return Problem(
        p,
        np.where(still, 0.0, before),
        np.where(still, 0.0, slips[:, :, 0]),
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
    """(n, 4) |G_cc^-1| times the sizes of the constraint rows, which rounding is relative to."""
    rows = (s.free_size[:, CONSTRAINED] + s.target_size) / p.h[:, None]
    inner = np.abs(inverse(g[:, CONSTRAINED][:, :, CONSTRAINED]))
    return np.asarray(np.einsum("nij,nj->ni", inner, rows))
