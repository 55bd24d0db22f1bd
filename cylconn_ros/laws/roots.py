"""All solutions of friction on the disc by brute force: whether an answer is the one to be taken.

With the constrained components eliminated all candidates lie on phi(r) = -(theta S + r)^-1 s~_free,
from phi = 0 (r = inf) to stick (r = 0); solutions are the zeros of limit/|phi| - 1. A fine grid
finds the changes of sign, and where the gap only dips towards zero the dip is searched, so that a
pair of roots between two points of the grid is found too.

Rule: after stick, stick where it is admissible. Else the first root from r = inf, of theta = 1/2
where the slip velocity does not turn too far, else of theta = 1; stick where there is none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws import rigid
from cylconn_ros.laws.friction import contact, limit
from cylconn_ros.laws.parameters import Bools, Rows, Table
from cylconn_ros.laws.reduced import Problem

Array = NDArray[np.float64]
GRID = 1200
FINER = 100  # points where the sign changes
MOST_STEPS = 1000
STEP = 0.1  # of log r, on the way from stick to the root next to it
REFINED = 90  # halvings or golden sections
CLOSE = 1e-3  # of phi: rounding must be far from making one solution of another
UNSURE = 1e-9  # two answers are equally right when a decision hangs on less


@dataclasses.dataclass
class Curve(Rows):
    """phi(r) = -V diag(1 / (l + r)) V^T s~_free, l the eigenvalues of theta S."""

    problem: Problem
    values: Array  # (n, 2)
    vectors: Array  # (n, 2, 2)
    along: Array  # (n, 2) V^T s~_free
    endless: Bools  # (n,) a held component moves: |phi| grows without bound

    def phi(self, r: Array) -> Array:
        """(n, 2) at r (n,)."""
        return rigid.out_of(self.vectors, -self.along / (self.values + r[:, None]))

    @property
    def ends(self) -> tuple[Array, Array]:
        """(n,) the lesser and the greater value."""
        return self.values.min(axis=1), self.values.max(axis=1)

    def gap(self, tables: Sequence[Table], r: Array) -> Array:
        """(n,) limit/|phi| - 1 at r: negative between an odd and an even root from r = inf."""
        q, p = self.problem, self.problem.parameters
        phi = self.phi(r)
        size = rigid.norm(phi)
        found = limit(p, tables, r * size, contact_at(q, phi)) / size - 1.0
        return np.asarray(np.where(self.endless & (r == 0.0), -1.0, found))


def contact_at(q: Problem, phi: Array) -> Array:
    """(n,) FN."""
    force, none = q.base + rigid.out_of(q.by, phi), np.zeros(len(phi))
    return contact(
        q.parameters, np.column_stack([none, force[:, :2]]), np.column_stack([none, force[:, 2:]])
    )[3]


def curve_of(q: Problem, theta: float) -> Curve:
    """The curve of candidates for one theta; a held component at rest does not enter it."""
    mean = (1.0 - theta) * q.before + theta * q.free
    values, vectors = np.linalg.eigh(q.s)
    held = np.asarray(q.held.any(axis=1))
    own = np.einsum("nii->ni", q.s)  # what is left has no coupling
    own = np.where(q.held & (mean == 0.0), own.max(axis=1, keepdims=True), own)
    values = np.where(held[:, None], own, values)
    vectors = np.where(held[:, None, None], np.eye(2), vectors)
    along = np.where(held[:, None], mean, rigid.into(vectors, mean))
    endless = np.asarray(((values <= 0.0) & (along != 0.0) & held[:, None]).any(axis=1))
    return Curve(q, theta * values, vectors, along, endless)


def first_root(c: Curve, tables: Sequence[Table]) -> tuple[Array, Array, Array]:
    """The greatest r of a root (n,), 0 where there is none; how many were seen; the nearest miss.

    The nearest miss is the least |gap| of a dip that was or was not taken for a pair of roots.
    """
    n = len(c.along)
    lesser, greater = c.ends
    far = np.where(greater > 0.0, 1e30 * np.maximum(greater, 1e-300), 1e30)
    rest = far / np.maximum(1.0 + c.gap(tables, far), 1e-300)  # about where limit = traction
    top = np.log(1e4 * np.maximum(greater, rest))
    low = np.log(
        1e-7
        * np.where(lesser > 0.0, lesser, np.where(greater > 0.0, np.minimum(greater, rest), rest))
    )
    places = top + (low - top) * np.linspace(0.0, 1.0, GRID)[:, None]
    gaps = np.stack([c.gap(tables, np.exp(x)) for x in places] + [c.gap(tables, np.zeros(n))])
    places = np.concatenate([places, low[None] - 40.0])
    below = gaps < 0.0
    changes = below[1:] != below[:-1]
    any_change = changes.any(axis=0)
    first = np.where(any_change, changes.argmax(axis=0), GRID)
    miss, dip_root = _dips(c, tables, places, gaps, first)
    high = _narrowed(
        c,
        tables,
        places[np.maximum(first - 1, 0), np.arange(n)],
        places[np.minimum(first + 1, GRID), np.arange(n)],
    )
    root = np.where(any_change, np.exp(high), 0.0)
    root = np.where(dip_root > 0.0, dip_root, root)
    return root, changes.sum(axis=0) + 2 * (dip_root > 0.0), miss


def last_root(c: Curve, tables: Sequence[Table]) -> Array:
    """The least r of a root (n,), from where |phi| is beyond any limit upwards; inf: none."""
    lesser, _ = c.ends
    slow = np.min(np.where(c.along != 0.0, np.abs(c.along), np.inf), axis=1)
    base = contact_at(c.problem, np.zeros_like(c.along))
    resting = np.maximum(limit(c.problem.parameters, tables, slow, base), 1e-300)
    far, beyond_all = slow / resting, rigid.norm(c.along) / resting
    high = np.log(np.where(c.endless, 1e-16 * far, 1e-13 * lesser))
    top = np.log(1e4 * np.maximum(beyond_all, c.ends[1]))
    found = np.zeros(len(high), dtype=np.bool_)
    for _ in range(MOST_STEPS):
        if not (~found & (high <= top)).any():
            break
        high = np.where(found, high, high + STEP)
        found |= c.gap(tables, np.exp(high)) >= 0.0
    low = high - STEP
    for _ in range(REFINED):
        middle = 0.5 * (low + high)
        beyond = c.gap(tables, np.exp(middle)) >= 0.0
        high, low = np.where(beyond, middle, high), np.where(beyond, low, middle)
    return np.where(found, np.exp(high), np.inf)


def _narrowed(c: Curve, tables: Sequence[Table], high: Array, less: Array) -> Array:
    """The first change of sign between ``high`` and ``less`` on a finer grid, then by halving."""
    rows = np.arange(len(high))
    places = high + (less - high) * np.linspace(0.0, 1.0, FINER)[:, None]
    below = np.stack([c.gap(tables, np.exp(x)) < 0.0 for x in places])
    first = np.maximum(below.argmax(axis=0), 1)
    high, less = places[first - 1, rows], places[first, rows]
    for _ in range(REFINED):
        middle = 0.5 * (high + less)
        beyond = c.gap(tables, np.exp(middle)) >= 0.0
        high, less = np.where(beyond, middle, high), np.where(beyond, less, middle)
    return high


def _dips(
    c: Curve, tables: Sequence[Table], places: Array, gaps: Array, first: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Search local minima of the gap above the first change of sign: (least |gap|, r of a root)."""
    n = gaps.shape[1]
    least, root = np.full(n, np.inf), np.zeros(n)
    inner = (gaps[1:-1] <= gaps[:-2]) & (gaps[1:-1] <= gaps[2:]) & (gaps[1:-1] >= 0.0)
    inner &= np.arange(1, len(gaps) - 1)[:, None] <= first
    steps, rows = np.nonzero(inner)
    if not len(rows):
        return least, root
    sub = c.take(rows)
    a, b = places[steps, rows], places[np.minimum(steps + 2, len(places) - 1), rows]
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(REFINED):
        x, y = b - ratio * (b - a), a + ratio * (b - a)
        left = sub.gap(tables, np.exp(x)) < sub.gap(tables, np.exp(y))
        a, b = np.where(left, a, x), np.where(left, y, b)
    bottom = 0.5 * (a + b)
    depth = sub.gap(tables, np.exp(bottom))
    np.minimum.at(least, rows, np.abs(depth))
    high, less = places[steps, rows], bottom.copy()
    for _ in range(REFINED):
        middle = 0.5 * (high + less)
        beyond = sub.gap(tables, np.exp(middle)) >= 0.0
        high, less = np.where(beyond, middle, high), np.where(beyond, less, middle)
    np.maximum.at(root, rows, np.where(depth < 0.0, np.exp(high), 0.0))
    return least, root


def nearest_to_stick(q: Problem, tables: Sequence[Table]) -> Array:
    """(n, 2) the phi of stick where it is admissible, else of the least r, theta = 1."""
    full = curve_of(q, 1.0)
    rest = np.zeros(len(q.free))
    return np.where(
        (full.gap(tables, rest) >= 0.0)[:, None], full.phi(rest), full.phi(last_root(full, tables))
    )


def least_traction(q: Problem, tables: Sequence[Table]) -> Array:
    """(n, 2) the phi of the first root from r = inf, theta = 1, after stick too; stick if none."""
    full = curve_of(q, 1.0)
    return full.phi(first_root(full, tables)[0])


def _cancelled(q: Problem, phi: Array) -> Array:
    """(n,) how much greater the terms of FN are than FN."""
    p, none = q.parameters, np.zeros(len(phi))
    at = q.base + rigid.out_of(q.by, phi)
    size = np.abs(q.base) + rigid.out_of(np.abs(q.by), np.abs(phi))
    normal, terms = (
        contact(p, np.column_stack([none, f[:, :2]]), np.column_stack([none, f[:, 2:]]))
        for f in (at, size)
    )
    greatest = terms[0] + terms[2] + np.abs(p.preload)
    return np.asarray(greatest / np.maximum(normal[3], 1e-300))


def _trembling(q: Problem, phi: Array) -> Array:
    """(n,) how much greater than FN the terms are that its rounding comes from."""
    p, none = q.parameters, np.zeros(len(phi))
    at = q.base + rigid.out_of(q.by, phi)
    normal, terms = (
        contact(p, np.column_stack([none, f[:, :2]]), np.column_stack([none, f[:, 2:]]))
        for f in (at, q.base_size)
    )
    return np.asarray((terms[0] + terms[2]) / np.maximum(normal[3], 1e-300))


def _moved(q: Problem, c: Curve, phi: Array) -> Array:
    """(n,) how far the rounding of s_free moves phi."""
    traction = rigid.norm(phi)
    rate = rigid.norm(q.free + rigid.out_of(q.s, phi))
    r = np.where(traction > 0.0, rate / np.where(traction > 0.0, traction, 1.0), 0.0)
    vectors = np.abs(c.vectors)
    size = rigid.into(vectors, q.free_size) / (c.values + r[:, None])
    return (1e-15 + 1e-16 * q.condition) * rigid.norm(rigid.out_of(vectors, size))


def _at_rest(q: Problem, c: Curve) -> Bools:
    """Whether a held component's rate is nothing but rounding: what friction does there is open."""
    nothing = np.abs(c.along) < UNSURE * (q.before_size + q.free_size)
    return np.asarray((q.held & nothing).any(axis=1))


@dataclasses.dataclass
class Named:
    """What the rule names."""

    phi: Array  # (n, 2)
    unsure: Bools  # (n,) rounding decides
    several: Bools  # there is more than one solution
    admissible: Bools  # stick is one


def named(q: Problem, tables: Sequence[Table]) -> Named:
    """The solution that the rule names."""
    full, half = curve_of(q, 1.0), curve_of(q, 0.5)
    margin = full.gap(tables, np.zeros(len(q.free)))
    admissible = margin >= 0.0
    at_rest = full.phi(np.zeros(len(q.free)))
    r1, count, miss_full = first_root(full, tables)
    r2, _, miss_half = first_root(half, tables)
    phi = half.phi(r2)
    end = q.free + rigid.out_of(q.s, phi)
    square = rigid.dot(q.before, q.before)
    turn = rigid.dot(q.before, end) - 0.25 * square
    may_turn = (r2 > 0.0) & ~q.after_stick & (square > 0.0)
    found = np.where((r1 > 0.0)[:, None], full.phi(r1), at_rest)
    found = np.where((may_turn & (turn > 0.0))[:, None], phi, found)
    found = np.where((q.after_stick & admissible)[:, None], at_rest, found)

    unending = full.endless & (r1 == 0.0) | half.endless & (r2 == 0.0) & may_turn
    least = UNSURE + 1e-15 * (q.condition * _cancelled(q, found) + _trembling(q, found))
    unsure = np.minimum(np.abs(margin), np.minimum(miss_full, miss_half)) < least
    unsure |= (least > 0.1 * CLOSE) | unending | _at_rest(q, full) | _at_rest(q, half)
    unsure |= _moved(q, full, found) > 0.1 * CLOSE * rigid.norm(found)
    size = rigid.norm(q.before) * rigid.norm(end) + 0.25 * square
    hardly = rigid.norm(q.before) < UNSURE * rigid.norm(q.before_size)
    unsure |= may_turn & ((np.abs(turn) < UNSURE * size) | hardly)
    return Named(found, unsure, (count + admissible) > 1, admissible)
