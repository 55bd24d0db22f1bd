"""Tables of springs and dampers, and compliant stops, stated independently of core/elements.py.

The force of an element over a step is its mean over the path from x to x + h (w + w+)/2 (of a
semi-implicit plant from x - h w to x + h w+), by the trapezoidal rule between the knots, which is
exact. The methods that take forces from the sample have it at x + h w/2 (semi-implicit: x).

Once it has been compared with the outputs, the other laws are those of a step in which the elements
are replaced by an imposed force and a damper with the same tangent (:func:`substituted`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.normalised import TOLERANCE, Block, ratio
from cylconn_ros.laws.parameters import Bools, Parameters
from cylconn_ros.laws.predicted_end import prepare_step
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import FREE, rates_from_wrench
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
TANGENT = 1e-6  # relative difference of the rate for the tangent

_FIRST = (layout.FORCE_ELASTIC, layout.MOMENT_ELASTIC)
_VISCOUS = (layout.FORCE_VISCOUS, layout.MOMENT_VISCOUS)
_ACTUATION = (layout.FORCE_ACTUATION, layout.MOMENT_ACTUATION)
_REACTION = (layout.FORCE_REACTION, layout.MOMENT_REACTION)
_TOTAL = (layout.FORCE, layout.MOMENT)


class Curve(NamedTuple):
    """A piecewise linear function, by its knots."""

    x: Array
    y: Array
    constant: bool

    def at(self, x: float) -> float:
        """The value at x."""
        if len(self.x) == 0:
            return 0.0
        if not self.constant:
            for end, inner, beyond in ((0, 1, x < self.x[0]), (-1, -2, x > self.x[-1])):
                if beyond:
                    slope = (self.y[end] - self.y[inner]) / (self.x[end] - self.x[inner])
                    return float(self.y[end] + slope * (x - self.x[end]))
        return float(np.interp(x, self.x, self.y))

    def mean(self, a: float, b: float) -> float:
        """The mean from a to b."""
        low, high = min(a, b), max(a, b)
        inner = self.x[(self.x > low) & (self.x < high)]
        if not high > low:
            return self.at(a)
        x = np.array([low, *inner, high])
        y = np.array([self.at(each) for each in x])
        width = np.diff(x)
        return float(np.sum(0.5 * width * (y[1:] + y[:-1])) / np.sum(width))

    def terms(self, x: float) -> float:
        """The greater of the values at the knots next to x, between which it is interpolated."""
        if len(self.x) == 0:
            return 0.0
        after = min(max(int(np.searchsorted(self.x, x)), 1), len(self.x) - 1)
        return float(np.max(np.abs(self.y[after - 1 : after + 1])))

    @property
    def steepest(self) -> float:
        """The greatest slope, without sign."""
        return float(np.max(np.abs(np.diff(self.y) / np.diff(self.x)), initial=0.0))


class Elements(NamedTuple):
    """The elements of one component."""

    spring: Curve
    damper: Curve
    stops: tuple[tuple[float, float], ...]  # side, position
    push: Curve  # force of a stop over depth
    share: Curve  # of its damping
    damping: float

    def stop_forces(self, a: float, b: float, rate: float) -> list[tuple[float, float]]:
        """Side, and force on the component, of each stop on a path from a to b."""
        found = []
        for side, at in self.stops:
            depth = side * (a - at), side * (b - at)
            share = self.share.mean(*depth)
            force = self.push.mean(*depth) + self.damping * share * side * rate
            acts = max(depth) > 0.0 and force > 0.0
            found.append((side, -side * force if acts else 0.0))
        return found


def _curve(points: Sequence[float], values: Sequence[float], constant: bool) -> Curve:
    return Curve(np.array(points), np.array(values), constant)


def elements_of(scene: Scene, k: int) -> Elements:
    """The elements of slide (k = 0) or spin (1)."""
    stops, spring = scene.stops, scene.elasticity
    if k == 0:
        one, two = spring.table, scene.damping.table
        curves = (
            _curve(one.positions, one.forces, one.extrapolation == "constant"),
            _curve(two.rates, two.forces, two.extrapolation == "constant"),
        )
        stiff, damp, over = stops.stiffness, stops.damping, stops.damping_depth
        ends = (-1.0, stops.l_min), (1.0, stops.l_max)
    else:
        three, four = spring.rotational_table, scene.damping.rotational_table
        curves = (
            _curve(three.angles, three.moments, three.extrapolation == "constant"),
            _curve(four.rates, four.moments, four.extrapolation == "constant"),
        )
        stiff, damp = stops.rotational_stiffness, stops.rotational_damping
        over = stops.rotational_damping_depth
        ends = (-1.0, stops.theta_min), (1.0, stops.theta_max)
    there = () if math.isnan(stiff) else tuple((s, x) for s, x in ends if not math.isnan(x))
    share = _curve([0.0, over], [0.0, 1.0], True)
    # knots at -1, 0 and 1: constant before 0, the line through 0 and 1 beyond
    push = Curve(np.array([-1.0, 0.0, 1.0]), np.array([0.0, 0.0, stiff]), False)
    return Elements(*curves, there, push, share, 0.0 if math.isnan(damp) else damp)


class Forces(NamedTuple):
    """Forces of the elements of one component; the sizes of their terms; the stop's side."""

    spring: float
    damper: float
    stop: float
    side: float


def _over_path(e: Elements, u: float, x: float, path: tuple[float, float], rate: float) -> Forces:
    """Forces on a path from x + path[0] to x + path[1] at a mean rate."""
    a, b = path
    stops = e.stop_forces(x + a, x + b, rate)
    total = sum(force for _, force in stops)
    side = sum(s for s, force in stops if force != 0.0)
    return Forces(-e.spring.mean(u + a, u + b), -e.damper.at(rate), total, side)


@dataclasses.dataclass
class Substitution:
    """What replaces the elements of a block, and what is lost with them."""

    parameters: Parameters  # without elements
    out: Array
    original: tuple[Parameters, Array]
    residual: Array  # (n,) of the forces of the elements
    compliant: Bools  # (n, 2) whether there are compliant stops
    ones: list[_One]

    def stored(self, moved: Array) -> Array:
        """(n,) change of the energy stored in the elements for a motion (n, 2), J."""
        found = np.zeros(len(moved))
        for one in self.ones:
            found[one.row] += one.stored(float(moved[one.row, one.k]))
        return found


def substituted(
    scenes: Sequence[Scene], of: NDArray[np.intp], p: Parameters, o: SampleState, sample: Array,
    out: Array, others: Array | None, method: str,
) -> Substitution:  # fmt: skip
    """Replace the elements by an imposed force and a damper; ``of``: the scene of each row."""
    n = len(p.h)
    residual = np.zeros(n)
    ones: list[_One] = []
    soft = np.array([scene.stops.compliant for scene in scenes])[of]
    has = np.array([_has(scene) for scene in scenes])[of]
    rows = np.flatnonzero(has & np.isfinite(out).all(axis=1))
    if not len(rows):
        return Substitution(p, out, (p, out), residual, soft, ones)
    solved = TRAITS[method].exact_stick
    ends, ends_size = o.w[:, FREE], o.w_size[:, FREE]
    if solved:
        few, state = p.take(rows), o.take(rows)
        s = prepare_step(few, state, sample[rows], None if others is None else others[rows])
        wrench = out[rows, layout.FORCE : layout.FORCE + 6]
        terms = np.abs(wrench)
        for k, first in enumerate(_FIRST):  # a total can be the small difference of its parts
            terms[:, FREE[k]] = np.abs(out[rows, first : first + 5]).sum(axis=1)
        added, added_size = rates_from_wrench(few, s, wrench, terms)
        ends, ends_size = np.zeros((n, 2)), np.zeros((n, 2))
        ends[rows] = (s.free + added + s.bracket)[:, FREE]
        ends_size[rows] = (s.free_size + added_size + s.bracket_size)[:, FREE]
    tangent, command, clean = p.damping.copy(), p.command.copy(), out.copy()
    for row in rows:
        for k in range(2):
            e = elements_of(scenes[of[row]], k)
            if not (len(e.spring.x) or len(e.damper.x) or e.stops):
                continue
            one = _One(p, o, int(row), k, e, solved, float(ends[row, k]), float(ends_size[row, k]))
            ones.append(one)
            residual[row] = max(residual[row], one.residual(out[row]))
            slope = one.slope() if solved else 0.0
            tangent[row, k] += 2.0 * slope
            # of which the constant force is taken off again, as of every imposed one
            command[row, k, 2] = one.replace(clean[row], slope) + p.offset[row, k]
    without = dataclasses.replace(p, damping=tangent, command=command)
    return Substitution(without, clean, (p, out), residual, soft, ones)


def block_of(block: Block, found: Substitution) -> Block:
    """The block without its elements, with which the other laws are checked."""
    return dataclasses.replace(block, parameters=found.parameters, out=found.out, elements=found)


def _has(scene: Scene) -> bool:
    both = [elements_of(scene, k) for k in range(2)]
    return any(len(e.spring.x) or len(e.damper.x) or e.stops for e in both)


class _One:
    """One component of one sample."""

    def __init__(
        self, p: Parameters, o: SampleState, row: int, k: int, e: Elements, solved: bool,
        end: float, end_size: float,
    ) -> None:  # fmt: skip
        self.row, self.k, self.e, self.end, self.solved = row, k, e, end, solved
        self.h, self.explicit = float(p.h[row]), bool(p.explicit[row])
        rest = p.reference[row, k]
        rest = float(o.start[row, k] if math.isnan(rest) else rest)
        self.x, self.w = float(o.position[row, k]), float(o.w[row, FREE[k]])
        self.u = self.x - rest
        self.linear = float(p.stiffness[row, k]), float(p.damping[row, k])
        held = p.imposed[row, k] or p.lock[row] == k or np.isfinite(p.stops[row, k]).any()
        self.held = bool(held)
        self.x_size = float(o.position_size[row, k]) + abs(rest)
        self.w_size = 0.5 * (float(o.w_size[row, FREE[k]]) + end_size)
        self.forces = self.over_step(end)

    def path(self, end: float) -> tuple[tuple[float, float], float]:
        """The path relative to x, and the mean rate, for the rate at the end of the step."""
        h, w = self.h, self.w
        if not self.solved:
            at = 0.0 if self.explicit else 0.5 * h * w
            return (at, at), w
        mean = 0.5 * (w + end)
        return ((-h * w, h * end) if self.explicit else (0.0, h * mean)), mean

    def over_step(self, end: float) -> Forces:
        path, rate = self.path(end)
        return _over_path(self.e, self.u, self.x, path, rate)

    def stored(self, moved: float) -> float:
        """Change of the stored energy over a motion, J."""
        stops = self.e.stop_forces(self.x, self.x + moved, 0.0)
        pushed = -sum(force for _, force in stops) * moved
        return self.e.spring.mean(self.u, self.u + moved) * moved + pushed

    def slope(self) -> float:
        """-d(force)/d(end)."""
        step = TANGENT * (abs(self.w) + abs(self.end) + 1e-9)
        f = [sum(self.over_step(self.end + d)[:3]) for d in (-step, step)]
        return -(f[1] - f[0]) / (2.0 * step)

    def parts(self) -> tuple[float, float]:
        """Forces of the linear spring and damper."""
        stiff, damp = self.linear
        if not self.solved:
            return -stiff * (self.u + self.path(self.end)[0][0]), -damp * self.w
        mean = 0.5 * (self.w + self.end)
        return -stiff * (self.u + 0.5 * self.h * mean), -damp * mean

    def residual(self, out: Array) -> float:
        """Residual of the forces of spring, damper and compliant stops by their formulas."""
        e, k, f = self.e, self.k, self.forces
        stiff, damp = self.linear
        spring, damper = self.parts()
        far = self.x_size + self.h * self.w_size
        below = e.spring.steepest + stiff
        path, rate = self.path(self.end)
        knots = max(e.spring.terms(self.u + at) for at in path)
        sizes = [
            (out[_FIRST[k]] - spring - f.spring, below * far + knots),
            (out[_VISCOUS[k]] - damper - f.damper,
             (e.damper.steepest + damp) * self.w_size + e.damper.terms(rate)),
        ]  # fmt: skip
        if e.stops:
            size = self.stop_size()
            if not self.held:
                sizes.append((out[_REACTION[k]] - f.stop, size))
            bits = int(out[layout.STOP]) >> 2 * k & 3
            wanted = {-1.0: 1, 1.0: 2}.get(f.side, 0)
            if bits != wanted and abs(f.stop) > TOLERANCE * size:
                return math.inf
        value, size_of = np.array(sizes).T
        return float(np.max(ratio(value, size_of)))

    def stop_size(self) -> float:
        """Size of the terms of the stops' force."""
        e, far = self.e, self.x_size + self.h * self.w_size
        size = abs(self.forces.stop) + e.push.steepest * far
        return size + e.damping * (self.w_size + abs(self.w) * e.share.steepest * far)

    def replace(self, out: Array, slope: float) -> float:
        """Replace the elements in one row of the outputs; the force to be imposed for them."""
        k, f = self.k, self.forces
        spring, damper = self.parts()
        out[_FIRST[k]], out[_VISCOUS[k]] = spring, damper - slope * (self.w + self.end)
        if self.e.stops:
            left = out[_REACTION[k]] - f.stop if self.held else 0.0
            # without a lock or motion that holds it, what is left is rounding
            out[_REACTION[k]] = left if abs(left) > TOLERANCE * self.stop_size() else 0.0
            out[layout.STOP] = int(out[layout.STOP]) & ~(3 << 2 * k)
        friction = out[_FIRST[k] + 2]
        out[_ACTUATION[k]] = out[_TOTAL[k]] - (
            out[_FIRST[k]] + out[_VISCOUS[k]] + friction + out[_REACTION[k]]
        )
        return float(out[_ACTUATION[k]])
