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
from cylconn_ros.laws.bounds import Bounds
from cylconn_ros.laws.impulses import impulses
from cylconn_ros.laws.parameters import Bools, Parameters, Rows, Table
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import Step

Array = NDArray[np.float64]
REACTIONS = [layout.FORCE_REACTION, layout.MOMENT_REACTION]
FRICTIONS = [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]


@dataclasses.dataclass
class ImpactFriction(Rows):
    """Friction of the steps of impacts."""

    rows: Bools  # (n,) one component has an impact that is followed
    off: Array  # (n,) residual of the reported friction, as rates
    undecided: Bools


def impact_friction(
    p: Parameters, tables: Sequence[Table], o: SampleState, s: Step, b: Bounds,
    out: Array, size: Array,
) -> ImpactFriction:  # fmt: skip
    """Residual of the friction of impacts; size: (n, 2) of the rates at the end of the step."""
    n = len(p.h)
    found = ImpactFriction(
        np.zeros(n, dtype=np.bool_), np.zeros(n), np.zeros(n, dtype=np.bool_)
    )  # fmt: skip
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
        expected = share * before + (1.0 - share) * after + i.ratio * stop[:, None]
        terms = np.abs(before) + np.abs(after) + np.abs(i.ratio * stop[:, None])
        off = np.abs(np.einsum("nij,nj->ni", i.mobility, given - expected))
        scale = size[index] + b.rebound_size[index, k, None]
        scale = scale + np.einsum("nij,nj->ni", np.abs(i.mobility), terms)
        found.rows[index] = True
        found.off[index] = (off / np.maximum(scale, 1e-300)).max(axis=1)
        found.undecided[index] = i.undecided
    return found
