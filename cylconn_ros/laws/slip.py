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
from cylconn_ros.laws.friction import coefficient, contact, limit
from cylconn_ros.laws.observed import Observed
from cylconn_ros.laws.parameters import Bools, Parameters, Rows
from cylconn_ros.laws.residual import TOLERANCE, Block, ratio, worst
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
    block: Block, o: Observed, s: Step, end: Array, end_size: Array
) -> dict[str, Array]:
    """Residuals (n,) of D, S, K, E and T. end: (n, 6) J~ v+, and its size."""
    p, out = block.parameters, block.out
    slip = slip_of(p, o, s, end, end_size)
    sticks, slips = out[:, layout.REGIME] == layout.STICK, out[:, layout.REGIME] == layout.SLIP
    half, full = _slipping(block, *slip.mean(0.5)), _slipping(block, *slip.mean(1.0))
    one, other = np.maximum(half.off, half.over), np.maximum(full.off, full.over)
    too_far = _turned_too_far(slip)
    turning = slips & (one < other) & ((other > TOLERANCE) | (too_far == 0.0))
    said = np.where(p.on == (out[:, layout.REGIME] != layout.FRICTIONLESS), 0.0, np.inf)
    disc = np.where(slips, np.where(turning, half.over, full.over), said)
    feeding = np.where(turning, half.feeding, full.feeding)
    return {
        "D": np.where(sticks, _resting(block), disc),
        "S": _only(slips, np.where(turning, half.off, full.off)),
        "K": _only(sticks, worst(ratio(slip.end, slip.end_size))),
        "E": _only(p.on, np.where(sticks, 0.0, feeding)),
        "T": _only(turning, too_far),
    }


def friction_of(block: Block) -> tuple[Array, Array, Array]:
    """Phi (n, 2), FN and the sum of the terms that make it."""
    p, out = block.parameters, block.out
    phi = out[:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]].copy()
    phi[:, 1] /= p.radius
    force = out[:, layout.FORCE : layout.FORCE + 3]
    moment = out[:, layout.MOMENT : layout.MOMENT + 3]
    radial, _, bending, normal = contact(p, force, moment)
    return phi, normal, radial + bending + np.abs(p.preload)


def _slipping(block: Block, mean: Array, size: Array) -> _Law:
    """|s~| phi + r s~ = 0, |phi| = r and phi.s~ <= 0, for the slip velocity s~ (n, 2)."""
    p = block.parameters
    phi, normal, normal_size = friction_of(block)
    rate, traction = np.hypot(mean[:, 0], mean[:, 1]), np.hypot(phi[:, 0], phi[:, 1])
    greatest = limit(p, block.tables, rate, normal)
    rows = rate[:, None] * phi + greatest[:, None] * mean
    terms = rigid.norm(size)[:, None] * np.abs(phi) + greatest[:, None] * size
    power = np.maximum(rigid.dot(phi, mean), 0.0)
    return _Law(
        worst(ratio(rows, terms)),
        ratio(traction - greatest, _terms(block, rate, normal, normal_size)),
        ratio(power, rigid.dot(np.abs(phi), size)),
    )


def _resting(block: Block) -> Array:
    """D of stick: |phi| <= the limit at rest."""
    phi, normal, normal_size = friction_of(block)
    rest = np.zeros_like(normal)
    greatest = limit(block.parameters, block.tables, rest, normal)
    over = np.maximum(np.hypot(phi[:, 0], phi[:, 1]) - greatest, 0.0)
    return ratio(over, _terms(block, rest, normal, normal_size))


def _terms(block: Block, rate: Array, normal: Array, normal_size: Array) -> Array:
    """(n,) mu FN, FN by the sum of its terms."""
    return coefficient(block.parameters, block.tables, rate, normal) * normal_size


def _turned_too_far(slip: Slip) -> Array:
    """T: s-.s+ > |s-|^2 / 4."""
    short = 0.25 * rigid.dot(slip.before, slip.before) - rigid.dot(slip.before, slip.end)
    size = 0.25 * rigid.dot(slip.before_size, slip.before_size)
    size += rigid.dot(slip.before_size, slip.end_size)
    return ratio(np.maximum(short, 0.0), size)


def _only(rows: Bools, values: Array) -> Array:
    return np.where(rows, values, np.nan)
