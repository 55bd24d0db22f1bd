"""Law of the friction of impacts: that of their ideal motion, in the two steps that follow.

    phi = share phi- + (1 - share) phi+ + rho p          rho = phi/p at the impact

with the friction before and after the impact, the share of the step that passes before it, the
stop's force p, and the ratio rho of the impulses of friction and stop (impulses.py).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.bounds import Bounds, driven
from cylconn_ros.laws.impulses import impulses
from cylconn_ros.laws.parameters import Bools, Parameters, Rows, Table
from cylconn_ros.laws.reduced import WORST_CONDITION, problem_of
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import Step

Array = NDArray[np.float64]
REACTIONS = [layout.FORCE_REACTION, layout.MOMENT_REACTION]
FRICTIONS = [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]


@dataclasses.dataclass
class ImpactFriction(Rows):
    """Friction of the steps of impacts."""

    rows: Bools  # (n,) one component has an impact that is followed
    required: Bools  # (n,) it begins, and its friction fits: the stop pushes, the other is free
    off: Array  # (n,) residual of the reported friction, as rates
    undecided: Bools


def impact_friction(
    p: Parameters, tables: Sequence[Table], o: SampleState, s: Step, b: Bounds,
    out: Array, size: Array,
) -> ImpactFriction:  # fmt: skip
    """Residual of the friction of impacts; size: (n, 2) of the rates at the end of the step."""
    n = len(p.h)
    none = np.zeros(n, dtype=np.bool_)
    found = ImpactFriction(none.copy(), none.copy(), np.zeros(n), none.copy())
    for k in range(2):
        index = np.flatnonzero(p.on & b.followed[:, k] & (b.impact[:, 1 - k] == 0.0))
        if not len(index):
            continue
        of, there, step = p.take(index), o.take(index), s.take(index)
        fixed = b.bilateral[index, 1 - k]
        eps = b.restitution[index, k]
        i = impulses(of, tables, there, step, b.rates[index, k], k, eps, fixed)
        share = np.clip(b.time[index, k] / of.h, 0.0, 1.0)[:, None]
        given, stop = out[index][:, FRICTIONS], out[index, REACTIONS[k]]
        before, after = b.before[index, k], b.after[index, k]
        smooth = share * before + (1.0 - share) * after
        expected = smooth + i.ratio * stop[:, None]
        terms = np.abs(before) + np.abs(after) + np.abs(i.ratio * stop[:, None])
        off = np.abs(np.einsum("nij,nj->ni", i.mobility, given - expected))
        bound = np.where(b.impact[index, k] < 0.0, b.low_size[index, k], b.high_size[index, k])
        scale = size[index] + (b.rebound_size[index, k] + bound)[:, None]
        scale = scale + np.einsum("nij,nj->ni", np.abs(i.mobility), terms)
        found.rows[index] = True
        found.off[index] = (off / np.maximum(scale, 1e-300)).max(axis=1)
        found.undecided[index] = i.undecided
        fits = _fits(of, there, step, b.take(index), k, smooth, i.ratio) & i.pushes
        beside_drive = driven(of, b.take(index)).any(axis=1)
        found.required[index] = fits & b.begins[index, k] & ~beside_drive
    return found


def _fits(
    p: Parameters, o: SampleState, s: Step, b: Bounds, k: int, smooth: Array, ratio: Array
) -> Bools:
    """(n,) whether the stop pushes and the other component stays within its bounds, by a margin."""
    j, rows = 1 - k, np.arange(len(p.h))
    held = np.zeros((len(p.h), 2), dtype=np.bool_)
    held[:, j] = b.bilateral[:, j]
    q = problem_of(p, o, s, held, np.where(held, b.low, 0.0))
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    a = q.s / unit[:, :, None] / unit[:, None, :]
    free = q.free / unit - s.hold + np.einsum("nij,nj->ni", a, smooth)
    push = ratio.copy()
    push[:, k] += 1.0
    by = np.einsum("nij,nj->ni", a, push)
    side = b.impact[:, k]
    with np.errstate(invalid="ignore", divide="ignore"):
        change = np.where(side < 0.0, b.low[:, k], b.high[:, k]) - free[:, k]
        end = free[:, j] + by[:, j] * change / by[:, k]
        size = 1e-9 * (np.abs(free) + q.free_size / unit)
        pushes = (by[:, k] > 0.0) & (-side * change > size[:, k])
        inside = (end - b.low[:, j] > size[:, j]) & (b.high[:, j] - end > size[:, j])
    inside = (inside & (b.rest[:, j] == 0.0)) | held[rows, j]
    return np.asarray(pushes & inside & (q.condition < WORST_CONDITION))
