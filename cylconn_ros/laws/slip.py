"""D, S, K, E and T: the laws of friction, from the reported friction and the wrench's own end.

An answer does not say its theta, which tells the slip velocity s~ that friction opposes: it is the
one for which the laws hold, 1 where they hold for both.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.friction import coefficient, contact, limit, slopes
from cylconn_ros.laws.normalised import TOLERANCE, Block, ratio, worst
from cylconn_ros.laws.parameters import Bools, Parameters, Rows
from cylconn_ros.laws.sample_state import Observed
from cylconn_ros.laws.step import AVAILABLE, Step

Array = NDArray[np.float64]


@dataclasses.dataclass
class Slip:
    """The slip velocities that friction is about, s = (v1, R w1), and their sizes."""

    before: Array  # (n, 2) s-
    before_size: Array
    end: Array  # (n, 2) s+, with what stick adds to hold its place
    end_size: Array

    def mean(self, theta: float) -> tuple[Array, Array]:
        """s~(theta) and its size."""
        size = (1.0 - theta) * self.before_size + theta * self.end_size
        return (1.0 - theta) * self.before + theta * self.end, size


def slip_of(p: Parameters, o: Observed, s: Step, end: Array, size: Array) -> Slip:
    """Slip velocities at the sample and at the end of the step, as the constraint's are."""
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    carried = s.bracket[:, AVAILABLE] + s.hold
    carried_size = s.bracket_size[:, AVAILABLE] + s.hold_size
    return Slip(
        unit * o.w[:, AVAILABLE],
        unit * o.w_size[:, AVAILABLE],
        unit * (end[:, AVAILABLE] + carried),
        unit * (size[:, AVAILABLE] + carried_size),
    )


@dataclasses.dataclass
class _Law(Rows):
    """The law of slip for one theta."""

    off: Array  # S
    over: Array  # | |phi| - limit |, by mu FN: P = mu FN on slip
    feeding: Array  # E


def friction_laws(
    block: Block, o: Observed, s: Step, end: Array, end_size: Array, reactions: Array
) -> dict[str, Array]:
    """Residuals (n,) of D, S, K, E and T.

    end: (n, 6) J~ v+, and its size; reactions: (n, 4) the sizes of f2, f3, m2, m3.
    """
    p, out = block.parameters, block.out
    slip = slip_of(p, o, s, end, end_size)
    sticks, slips = out[:, layout.REGIME] == layout.STICK, out[:, layout.REGIME] == layout.SLIP
    f = friction_of(block, reactions)
    half, full = (_slipping(block, f, *slip.mean(theta)) for theta in (0.5, 1.0))
    one, other = np.maximum(half.off, half.over), np.maximum(full.off, full.over)
    too_far = _turned_too_far(slip)
    turning = slips & (one < other) & ((other > TOLERANCE) | (too_far == 0.0))
    said = np.where(p.on == (out[:, layout.REGIME] != layout.FRICTIONLESS), 0.0, np.inf)
    disc = np.where(slips, np.where(turning, half.over, full.over), said)
    feeding = np.where(turning, half.feeding, full.feeding)
    return {
        "D": np.where(sticks, _resting(block, f), disc),
        "S": _only(slips, np.where(turning, half.off, full.off)),
        "K": _only(sticks, worst(ratio(slip.end, slip.end_size))),
        "E": _only(p.on, np.where(sticks, 0.0, feeding)),
        "T": _only(turning, too_far),
    }


@dataclasses.dataclass
class Reported(Rows):
    """Friction and contact as the reported wrench has them."""

    phi: Array  # (n, 2) (f1f, m1f/R)
    traction: Array
    normal: Array  # FN
    normal_size: Array  # its terms, as the constraint gives them


def friction_of(block: Block, reactions: Array) -> Reported:
    """Friction and normal force; reactions: (n, 4) the sizes of f2, f3, m2, m3."""
    p, out = block.parameters, block.out
    phi = out[:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]].copy()
    phi[:, 1] /= p.radius
    force = out[:, layout.FORCE : layout.FORCE + 3]
    moment = out[:, layout.MOMENT : layout.MOMENT + 3]
    normal = contact(p, force, moment)[3]
    none = np.zeros(len(out))
    sizes = contact(
        p,
        np.column_stack([none, np.maximum(reactions[:, :2], np.abs(force[:, 1:]))]),
        np.column_stack([none, np.maximum(reactions[:, 2:], np.abs(moment[:, 1:]))]),
    )
    return Reported(phi, rigid.norm(phi), normal, sizes[0] + sizes[2] + np.abs(p.preload))


def _slipping(block: Block, f: Reported, mean: Array, size: Array) -> _Law:
    """|s~| phi + r s~ = 0, |phi| = r and phi.s~ <= 0, for the slip velocity s~ (n, 2)."""
    rate = rigid.norm(mean)
    greatest = limit(block.parameters, block.tables, rate, f.normal)
    greatest_size = terms_of_limit(block, f, rate, rigid.norm(size))
    rows = rate[:, None] * f.phi + greatest[:, None] * mean
    # the disc knows no direction: a component far below the vector's length is not looked into
    terms = rigid.norm(size)[:, None] * np.abs(f.phi) + (rate * f.traction)[:, None]
    terms += greatest[:, None] * size + greatest_size[:, None] * np.abs(mean)
    power = np.maximum(rigid.dot(f.phi, mean), 0.0)
    return _Law(
        worst(ratio(rows, terms)),
        ratio(f.traction - greatest, greatest_size),
        ratio(power, rigid.dot(np.abs(f.phi), size)),
    )


def _resting(block: Block, f: Reported) -> Array:
    """D of stick: |phi| <= the limit at rest."""
    rest = np.zeros_like(f.normal)
    over = np.maximum(f.traction - limit(block.parameters, block.tables, rest, f.normal), 0.0)
    return ratio(over, terms_of_limit(block, f, rest, rest))


def terms_of_limit(block: Block, f: Reported, rate: Array, rate_size: Array) -> Array:
    """(n,) mu FN by the sums of the terms of FN and, where mu depends on them, of |s~| and FN."""
    p, tables = block.parameters, block.tables
    by_rate, by_force = slopes(p, tables)
    mu = coefficient(p, tables, rate, f.normal)
    return (mu + by_force * f.normal) * f.normal_size + by_rate * rate_size * f.normal


def _turned_too_far(slip: Slip) -> Array:
    """T: s-.s+ > |s-|^2 / 4."""
    short = 0.25 * rigid.dot(slip.before, slip.before) - rigid.dot(slip.before, slip.end)
    size = 0.25 * rigid.dot(slip.before_size, slip.before_size)
    size += rigid.dot(slip.before_size, slip.end_size)
    return ratio(np.maximum(short, 0.0), size)


def _only(rows: Bools, values: Array) -> Array:
    return np.where(rows, values, np.nan)
