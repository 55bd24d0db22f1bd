"""All solutions of friction on the disc by brute force, and the solution that the rule selects.

After elimination of the constrained components, all candidates lie on the curve
phi(r) = -(theta S + r)^-1 s~_free, from phi = 0 (r = inf) to stick (r = 0). Solutions are the zeros
of the gap limit/|phi| - 1. A fine grid finds the changes of sign. A local minimum of the gap near
zero is refined, so that a pair of roots between two grid points is found too.

Rule: after stick, stick if it is admissible. Else the first root from r = inf, for theta = 1/2 if
the slip velocity does not turn too far, else for theta = 1. Stick if there is no root.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws import rigid
from cylconn_ros.laws.friction import along, contact, limit
from cylconn_ros.laws.parameters import Bools, Rows, Table
from cylconn_ros.laws.reduced import Problem

Array = NDArray[np.float64]
GRID = 1200
REFINED_GRID = 100  # points within the interval of the first change of sign
MOST_STEPS = 1000
AT_A_TIME = 100_000  # candidates that are computed at once
LOG_STEP = 0.1  # of log r, in the search from stick to the nearest root
ITERATIONS = 90  # bisections or golden sections
SAME_SOLUTION = 1e-3  # relative difference of phi within one solution
AMBIGUOUS = 1e-9  # relative margin below which two outputs are equally valid


@dataclasses.dataclass
class Curve(Rows):
    """Candidates phi(r) = -V diag(1 / (l + r)) V^T s~_free, with l the eigenvalues of theta S."""

    problem: Problem
    values: Array  # (n, 2)
    vectors: Array  # (n, 2, 2)
    along: Array  # (n, 2) V^T s~_free
    unbounded: Bools  # (n,) a held component moves: |phi| has no bound at r = 0

    def phi(self, r: Array) -> Array:
        """(..., n, 2) candidate at r (..., n)."""
        return rigid.out_of(self.vectors, -self.along / (self.values + r[..., None]))

    @property
    def ends(self) -> tuple[Array, Array]:
        """(n,) smaller and larger eigenvalue."""
        return self.values.min(axis=1), self.values.max(axis=1)

    def gap(self, tables: Sequence[Table], r: Array) -> Array:
        """(..., n) limit/|phi| - 1 at r; negative from the first to the second root below inf."""
        q, p = self.problem, self.problem.parameters
        phi = self.phi(r)
        size = rigid.norm(phi)
        found = limit(p, tables, r * size, contact_at(q, phi), along(-phi)) / size - 1.0
        return np.asarray(np.where(self.unbounded & (r == 0.0), -1.0, found))

    def gaps(self, tables: Sequence[Table], r: Array) -> Array:
        """(m, n) gaps at m candidates r (m, n), some at a time."""
        many = max(AT_A_TIME // max(r.shape[1], 1), 1)
        return np.concatenate([self.gap(tables, r[k : k + many]) for k in range(0, len(r), many)])


def contact_at(q: Problem, phi: Array) -> Array:
    """(..., n) normal force FN for the friction phi (..., n, 2), N."""
    found = q.base + rigid.out_of(q.by, phi)
    none = np.zeros_like(found[..., :1])
    force = np.concatenate([none, found[..., :2]], axis=-1)
    moment = np.concatenate([none, found[..., 2:]], axis=-1)
    return contact(q.parameters, force, moment)[3]


def curve_of(q: Problem, theta: float) -> Curve:
    """Curve of candidates for one theta; a held component at rest does not enter it."""
    mean = (1.0 - theta) * q.before + theta * q.free
    values, vectors = np.linalg.eigh(q.s)
    held = np.asarray(q.held.any(axis=1))
    own = np.einsum("nii->ni", q.s)  # a single free component has no coupling
    own = np.where(q.held & (mean == 0.0), own.max(axis=1, keepdims=True), own)
    values = np.where(held[:, None], own, values)
    vectors = np.where(held[:, None, None], np.eye(2), vectors)
    along = np.where(held[:, None], mean, rigid.into(vectors, mean))
    unbounded = np.asarray(((values <= 0.0) & (along != 0.0) & held[:, None]).any(axis=1))
    return Curve(q, theta * values, vectors, along, unbounded)


def first_root(c: Curve, tables: Sequence[Table]) -> tuple[Array, Array, Array]:
    """Largest r of a root (n,), 0 without a root; number of roots found; margin.

    The margin is the least |gap| at a local minimum near zero, whether or not it crosses zero.
    """
    n = len(c.along)
    lesser, greater = c.ends
    far = np.where(greater > 0.0, 1e30 * np.maximum(greater, 1e-300), 1e30)
    rest = far / np.maximum(1.0 + c.gap(tables, far), 1e-300)  # near the root limit = traction
    top = np.log(1e4 * np.maximum(greater, rest))
    low = np.log(
        1e-7
        * np.where(lesser > 0.0, lesser, np.where(greater > 0.0, np.minimum(greater, rest), rest))
    )
    points = top + (low - top) * np.linspace(0.0, 1.0, GRID)[:, None]
    gaps = c.gaps(tables, np.concatenate([np.exp(points), np.zeros((1, n))]))
    points = np.concatenate([points, low[None] - 40.0])
    below = gaps < 0.0
    changes = below[1:] != below[:-1]
    any_change = changes.any(axis=0)
    first = np.where(any_change, changes.argmax(axis=0), GRID)
    margin, minimum_root = _local_minima(c, tables, points, gaps, first)
    high = _narrowed(
        c,
        tables,
        points[np.maximum(first - 1, 0), np.arange(n)],
        points[np.minimum(first + 1, GRID), np.arange(n)],
    )
    root = np.where(any_change, np.exp(high), 0.0)
    root = np.where(minimum_root > 0.0, minimum_root, root)
    return root, changes.sum(axis=0) + 2 * (minimum_root > 0.0), margin


def last_root(c: Curve, tables: Sequence[Table]) -> Array:
    """Smallest r of a root (n,), searched upwards from |phi| beyond any limit; inf: none."""
    lesser, _ = c.ends
    slow = np.min(np.where(c.along != 0.0, np.abs(c.along), np.inf), axis=1)
    base = contact_at(c.problem, np.zeros_like(c.along))
    p = c.problem.parameters
    resting = np.maximum(limit(p, tables, slow, base, np.sign(p.direction)), 1e-300)
    far, beyond_all = slow / resting, rigid.norm(c.along) / resting
    high = np.log(np.where(c.unbounded, 1e-16 * far, 1e-13 * lesser))
    top = np.log(1e4 * np.maximum(beyond_all, c.ends[1]))
    found = np.zeros(len(high), dtype=np.bool_)
    for _ in range(MOST_STEPS):
        if not (~found & (high <= top)).any():
            break
        high = np.where(found, high, high + LOG_STEP)
        found |= c.gap(tables, np.exp(high)) >= 0.0
    low = high - LOG_STEP
    for _ in range(ITERATIONS):
        middle = 0.5 * (low + high)
        beyond = c.gap(tables, np.exp(middle)) >= 0.0
        high, low = np.where(beyond, middle, high), np.where(beyond, low, middle)
    return np.where(found, np.exp(high), np.inf)


def _narrowed(c: Curve, tables: Sequence[Table], high: Array, less: Array) -> Array:
    """First change of sign between ``high`` and ``less``, on a refined grid, then by bisection."""
    rows = np.arange(len(high))
    points = high + (less - high) * np.linspace(0.0, 1.0, REFINED_GRID)[:, None]
    below = c.gaps(tables, np.exp(points)) < 0.0
    first = np.maximum(below.argmax(axis=0), 1)
    high, less = points[first - 1, rows], points[first, rows]
    for _ in range(ITERATIONS):
        middle = 0.5 * (high + less)
        beyond = c.gap(tables, np.exp(middle)) >= 0.0
        high, less = np.where(beyond, middle, high), np.where(beyond, less, middle)
    return high


def _local_minima(
    c: Curve, tables: Sequence[Table], points: Array, gaps: Array, first: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Refine local minima of the gap above the first change of sign: least |gap|, r of a root."""
    n = gaps.shape[1]
    least, root = np.full(n, np.inf), np.zeros(n)
    inner = (gaps[1:-1] <= gaps[:-2]) & (gaps[1:-1] <= gaps[2:]) & (gaps[1:-1] >= 0.0)
    inner &= np.arange(1, len(gaps) - 1)[:, None] <= first
    steps, rows = np.nonzero(inner)
    if not len(rows):
        return least, root
    sub = c.take(rows)
    a, b = points[steps, rows], points[np.minimum(steps + 2, len(points) - 1), rows]
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(ITERATIONS):
        x, y = b - ratio * (b - a), a + ratio * (b - a)
        left = sub.gap(tables, np.exp(x)) < sub.gap(tables, np.exp(y))
        a, b = np.where(left, a, x), np.where(left, y, b)
    bottom = 0.5 * (a + b)
    depth = sub.gap(tables, np.exp(bottom))
    np.minimum.at(least, rows, np.abs(depth))
    high, less = points[steps, rows], bottom.copy()
    for _ in range(ITERATIONS):
        middle = 0.5 * (high + less)
        beyond = sub.gap(tables, np.exp(middle)) >= 0.0
        high, less = np.where(beyond, middle, high), np.where(beyond, less, middle)
    np.maximum.at(root, rows, np.where(depth < 0.0, np.exp(high), 0.0))
    return least, root


def nearest_to_stick(q: Problem, tables: Sequence[Table]) -> Array:
    """(n, 2) phi of stick if it is admissible, else of the root with the smallest r, theta = 1."""
    full = curve_of(q, 1.0)
    rest = np.zeros(len(q.free))
    return np.where(
        (full.gap(tables, rest) >= 0.0)[:, None], full.phi(rest), full.phi(last_root(full, tables))
    )


def least_traction(q: Problem, tables: Sequence[Table]) -> Array:
    """(n, 2) phi of the first root from r = inf, theta = 1, also after stick; stick if none."""
    full = curve_of(q, 1.0)
    return full.phi(first_root(full, tables)[0])


def _cancellation(q: Problem, phi: Array) -> Array:
    """(n,) terms of FN relative to FN."""
    p, none = q.parameters, np.zeros(len(phi))
    at = q.base + rigid.out_of(q.by, phi)
    size = np.abs(q.base) + rigid.out_of(np.abs(q.by), np.abs(phi))
    normal, terms = (
        contact(p, np.column_stack([none, f[:, :2]]), np.column_stack([none, f[:, 2:]]), sizes)
        for f, sizes in ((at, False), (size, True))
    )
    greatest = terms[0] + terms[2] + np.abs(p.preload)
    return np.asarray(greatest / np.maximum(normal[3], 1e-300))


def _reaction_rounding(q: Problem, phi: Array) -> Array:
    """(n,) terms of the reactions, which rounding is relative to, relative to FN."""
    p, none = q.parameters, np.zeros(len(phi))
    at = q.base + rigid.out_of(q.by, phi)
    normal, terms = (
        contact(p, np.column_stack([none, f[:, :2]]), np.column_stack([none, f[:, 2:]]), sizes)
        for f, sizes in ((at, False), (q.base_size, True))
    )
    return np.asarray((terms[0] + terms[2]) / np.maximum(normal[3], 1e-300))


def _share_rounding(q: Problem, phi: Array) -> Array:
    """(n,) terms of the share of direction 1 + d c, relative to it; infinite where it is 0."""
    d = q.parameters.direction
    return np.asarray(np.abs(d) / np.maximum(1.0 + d * along(-phi), 1e-300))


def _rounding_of_phi(q: Problem, c: Curve, phi: Array) -> Array:
    """(n,) change of phi by the rounding of s_free, N."""
    traction = rigid.norm(phi)
    rate = rigid.norm(q.free + rigid.out_of(q.s, phi))
    r = np.where(traction > 0.0, rate / np.where(traction > 0.0, traction, 1.0), 0.0)
    vectors = np.abs(c.vectors)
    size = rigid.into(vectors, q.free_size) / (c.values + r[:, None])
    return (1e-15 + 1e-16 * q.condition) * rigid.norm(rigid.out_of(vectors, size))


def _rate_is_rounding(q: Problem, c: Curve) -> Bools:
    """(n,) whether a held component's rate is rounding only, so that its friction is undefined."""
    nothing = np.abs(c.along) < AMBIGUOUS * (q.before_size + q.free_size)
    return np.asarray((q.held & nothing).any(axis=1))


@dataclasses.dataclass
class Selected:
    """The solution that the rule selects."""

    phi: Array  # (n, 2)
    ambiguous: Bools  # (n,) rounding decides between solutions
    several: Bools  # more than one solution
    admissible: Bools  # stick is a solution


def select_solution(q: Problem, tables: Sequence[Table]) -> Selected:
    """Solve for all roots and select the solution by the rule."""
    full, half = curve_of(q, 1.0), curve_of(q, 0.5)
    margin = full.gap(tables, np.zeros(len(q.free)))
    admissible = margin >= 0.0
    at_rest = full.phi(np.zeros(len(q.free)))
    r1, count, margin_full = first_root(full, tables)
    r2, _, margin_half = first_root(half, tables)
    phi = half.phi(r2)
    end = q.free + rigid.out_of(q.s, phi)
    square = rigid.dot(q.before, q.before)
    turn = rigid.dot(q.before, end) - 0.25 * square
    may_turn = (r2 > 0.0) & ~q.after_stick & (square > 0.0)
    found = np.where((r1 > 0.0)[:, None], full.phi(r1), at_rest)
    found = np.where((may_turn & (turn > 0.0))[:, None], phi, found)
    found = np.where((q.after_stick & admissible)[:, None], at_rest, found)

    no_root = full.unbounded & (r1 == 0.0) | half.unbounded & (r2 == 0.0) & may_turn
    least = AMBIGUOUS + 1e-15 * (
        q.condition * _cancellation(q, found)
        + _reaction_rounding(q, found)
        + _share_rounding(q, found)
    )
    ambiguous = np.minimum(np.abs(margin), np.minimum(margin_full, margin_half)) < least
    ambiguous |= (
        (least > 0.1 * SAME_SOLUTION)
        | no_root
        | _rate_is_rounding(q, full)
        | _rate_is_rounding(q, half)
    )
    ambiguous |= _rounding_of_phi(q, full, found) > 0.1 * SAME_SOLUTION * rigid.norm(found)
    size = rigid.norm(q.before) * rigid.norm(end) + 0.25 * square
    slow = rigid.norm(q.before) < AMBIGUOUS * rigid.norm(q.before_size)
    ambiguous |= may_turn & ((np.abs(turn) < AMBIGUOUS * size) | slow)
    return Selected(found, ambiguous, (count + admissible) > 1, admissible)
