"""Impulses of the impacts of slide and spin at their stops.

The stop's impulse p changes the rates (v1, w1) by A (p + phi), with A the mobility of slide and
spin without springs, and phi the impulse of friction: on the disc of the impulsive FN, without
preload, against the slip after the impact; none where the traction has a cap.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws import rigid
from cylconn_ros.laws.parameters import Bools, Parameters, Rows, Table
from cylconn_ros.laws.reduced import WORST_CONDITION, problem_of
from cylconn_ros.laws.roots import contact_at, select_solution
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import Step

Array = NDArray[np.float64]
ROUNDING = 1e-12  # of the impulse: a normal impulse that is none


@dataclasses.dataclass
class Impulses(Rows):
    """Impulses of impacts of one component."""

    ratio: Array  # (n, 2) rho, N/N and N.m/N (N/(N.m) and 1 for spin)
    after: Array  # (n, 2) rates of slide and spin after the impact
    work: Array  # (n,) of the impulses, relative to the sum of its terms
    pushes: Bools  # (n,) the stop's impulse opposes the rate
    mobility: Array  # (n, 2, 2) A h, rates by forces
    undecided: Bools  # (n,) rounding decides


def impulses(
    p: Parameters, tables: Sequence[Table], o: SampleState, s: Step, rates: Array, k: int,
    eps: Array, fixed: Bools,
) -> Impulses:  # fmt: skip
    """Impacts of component k at the ``rates`` (n, 2) of slide and spin, with restitution eps (n,).

    fixed: (n,) whether the rate of the other component is prescribed.
    """
    n, j = len(p.h), 1 - k
    none = np.zeros((n, 2))
    bare = dataclasses.replace(p, stiffness=none, damping=none, preload=np.zeros(n))
    q = problem_of(bare, o, s)
    unit = np.stack([np.ones(n), p.radius], axis=1)
    a = q.s / unit[:, :, None] / unit[:, None, :]
    held = np.zeros((n, 2), dtype=np.bool_)
    held[:, k], held[:, j] = True, fixed
    change = np.zeros((n, 2))
    change[:, k] = -(1.0 + eps) * rates[:, k]
    # forces of stop and prescribed rate without friction, and by unit friction (f1f, m1f)
    x, by = np.zeros((n, 2)), np.zeros((n, 2, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        both = np.linalg.solve(np.where(fixed[:, None, None], a, np.eye(2)), change[:, :, None])
        x[:, k] = np.where(fixed, both[:, k, 0], change[:, k] / a[:, k, k])
        x[:, j] = np.where(fixed, both[:, j, 0], 0.0)
        by[:, k, j] = np.where(fixed, 0.0, -a[:, k, j] / a[:, k, k])
    by[:, j, j] = np.where(fixed, 0.0, 1.0)
    moved = rates + np.einsum("nij,nj->ni", a, x)
    moved = np.where(held, rates + change, moved)
    mobility = np.einsum("nij,njk->nik", a, by)
    mobility[held] = 0.0
    mobility.transpose(0, 2, 1)[held] = 0.0
    of_force = q.by / unit[:, None, :]
    q = dataclasses.replace(
        q,
        before=none,
        free=unit * moved,
        s=mobility * unit[:, :, None] * unit[:, None, :],
        base=np.einsum("nij,nj->ni", of_force, x),
        by=np.einsum("nij,njk->nik", of_force, by) * unit[:, None, :],
        after_stick=np.zeros(n, dtype=np.bool_),
        held=held,
    )
    phi, undecided = np.zeros((n, 2)), np.asarray(q.condition >= WORST_CONDITION)
    # an impulse along the axis through the mass centres does not press: without friction, FN = 0
    presses = contact_at(q, phi) > ROUNDING * np.abs(x).max(axis=1)
    rows = np.flatnonzero(p.on & np.isinf(p.cap) & presses & ~undecided)
    if len(rows):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            found = select_solution(q.take(rows), tables)
        phi[rows], undecided[rows] = found.phi, found.ambiguous
    friction = unit * phi
    total = x + np.einsum("nij,nj->ni", by, friction)
    after = moved + np.einsum("nij,nj->ni", mobility, friction)
    stop = total[:, k] - friction[:, k]
    size = (np.abs(total) * (np.abs(rates) + np.abs(after))).sum(axis=1)
    work = rigid.dot(total, rates + after) / np.maximum(size, 1e-300)
    ratio = np.where(stop[:, None] != 0.0, friction / np.where(stop, stop, 1.0)[:, None], 0.0)
    undecided |= ~np.isfinite(after).all(axis=1)
    return Impulses(ratio, after, work, stop * rates[:, k] < 0.0, a, undecided)
