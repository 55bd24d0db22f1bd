"""Laws of friction: friction limit, slip direction, stick, dissipation and slip averaging.

They compare the reported friction with the slip velocities that the reported wrench leads to.
Friction opposes s~(theta) = (1 - theta) s- + theta s+, with theta = 1/2 or 1. An output does not
report theta: the check takes the one for which the laws hold, and 1 if they hold for both.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.friction import along, coefficient, contact, limit, slopes
from cylconn_ros.laws.normalised import TOLERANCE, Block, ratio, worst
from cylconn_ros.laws.parameters import Bools, Parameters, Rows
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import FREE, Step

Array = NDArray[np.float64]


@dataclasses.dataclass
class SlipVelocities:
    """Slip velocities s = (v1, R w1), m/s, and their sizes."""

    before: Array  # (n, 2) s-
    before_size: Array
    end: Array  # (n, 2) s+, with the rates by which stick returns to its position
    end_size: Array

    def mean(self, theta: float) -> tuple[Array, Array]:
        """(n, 2) s~(theta) and its size."""
        size = (1.0 - theta) * self.before_size + theta * self.end_size
        return (1.0 - theta) * self.before + theta * self.end, size


def slip_velocities(
    p: Parameters, o: SampleState, s: Step, end: Array, size: Array
) -> SlipVelocities:
    """Slip velocities at the sample and at the end of the step.

    end: (n, 6) J~ v+, and its size.
    """
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    carried = s.bracket[:, FREE] + s.hold
    carried_size = s.bracket_size[:, FREE] + s.hold_size
    return SlipVelocities(
        unit * o.w[:, FREE],
        unit * o.w_size[:, FREE],
        unit * (end[:, FREE] + carried),
        unit * (size[:, FREE] + carried_size),
    )


@dataclasses.dataclass
class _SlipResiduals(Rows):
    """Residuals (n,) of the laws of slip for one theta."""

    direction: Array  # |s~| phi + r s~ = 0
    limit: Array  # |phi| = mu FN
    power: Array  # phi.s~ <= 0


def friction_laws(
    block: Block,
    o: SampleState,
    s: Step,
    end: Array,
    end_size: Array,
    reactions: Array,
    rests: Bools,
) -> dict[str, Array]:
    """Residuals (n,) of the five laws of friction.

    end: (n, 6) J~ v+, and its size; reactions: (n, 4) sizes of f2, f3, m2, m3; rests: (n, 2)
    whether a bound holds a component at rest, so that it does not slip.
    """
    p, out = block.parameters, block.out
    slip = slip_velocities(p, o, s, end, end_size)
    slip.before, slip.end = np.where(rests, 0.0, slip.before), np.where(rests, 0.0, slip.end)
    sticks, slips = out[:, layout.REGIME] == layout.STICK, out[:, layout.REGIME] == layout.SLIP
    f = reported_friction(block, reactions)
    half, full = (_slipping(block, f, *slip.mean(theta)) for theta in (0.5, 1.0))
    half_off, full_off = (
        np.maximum(half.direction, half.limit),
        np.maximum(full.direction, full.limit),
    )
    too_far = _turned_too_far(slip)
    averaged = slips & (half_off < full_off) & ((full_off > TOLERANCE) | (too_far == 0.0))
    no_friction = np.where(p.on == (out[:, layout.REGIME] != layout.FRICTIONLESS), 0.0, np.inf)
    over = np.where(slips, np.where(averaged, half.limit, full.limit), no_friction)
    power = np.where(averaged, half.power, full.power)
    return {
        "friction_limit": np.where(sticks, _stick_limit(block, f), over),
        "slip_direction": _only(slips, np.where(averaged, half.direction, full.direction)),
        "stick": _only(sticks, worst(ratio(slip.end, slip.end_size))),
        "dissipation": _only(p.on, np.where(sticks, 0.0, power)),
        "slip_averaging": _only(averaged, too_far),
    }


@dataclasses.dataclass
class ReportedFriction(Rows):
    """Friction and normal force of the reported wrench, N."""

    phi: Array  # (n, 2) (f1f, m1f/R)
    traction: Array
    normal: Array  # FN
    normal_size: Array  # from the terms of the reactions


def reported_friction(block: Block, reactions: Array) -> ReportedFriction:
    """Friction and normal force; reactions: (n, 4) sizes of f2, f3, m2, m3."""
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
        sizes=True,
    )
    return ReportedFriction(phi, rigid.norm(phi), normal, sizes[0] + sizes[2] + np.abs(p.preload))


def _slipping(block: Block, f: ReportedFriction, mean: Array, size: Array) -> _SlipResiduals:
    """Residuals of |s~| phi + r s~ = 0, |phi| = r and phi.s~ <= 0, for s~ (n, 2) and its size."""
    rate = rigid.norm(mean)
    greatest = limit(block.parameters, block.tables, rate, f.normal, along(mean))
    greatest_size = limit_size(block, f, rate, rigid.norm(size))
    rows = rate[:, None] * f.phi + greatest[:, None] * mean
    # the disc is isotropic: a component is compared with the length of its vector
    terms = rigid.norm(size)[:, None] * np.abs(f.phi) + (rate * f.traction)[:, None]
    terms += greatest[:, None] * size + greatest_size[:, None] * np.abs(mean)
    power = np.maximum(rigid.dot(f.phi, mean), 0.0)
    return _SlipResiduals(
        worst(ratio(rows, terms)),
        ratio(f.traction - greatest, greatest_size),
        ratio(power, rigid.dot(np.abs(f.phi), size)),
    )


def _stick_limit(block: Block, f: ReportedFriction) -> Array:
    """Residual (n,) of |phi| <= limit at rest, for stick."""
    rest = np.zeros_like(f.normal)
    cosine = along(-f.phi)
    greatest = limit(block.parameters, block.tables, rest, f.normal, cosine)
    over = np.maximum(f.traction - greatest, 0.0)
    return ratio(over, limit_size(block, f, rest, rest))


def limit_size(block: Block, f: ReportedFriction, rate: Array, rate_size: Array) -> Array:
    """(n,) size of the limit mu FN, from the sizes of FN and, if mu depends on it, of s~."""
    p, tables = block.parameters, block.tables
    by_rate, by_force = slopes(p, tables)
    mu = coefficient(p, tables, rate, f.normal)
    # the direction of a slip that is the rest of larger terms is uncertain
    uncertain = rate_size / np.maximum(rate, np.where(rate_size > 0.0, 1e-16 * rate_size, 1.0))
    by_direction = np.abs(p.direction) * mu * (1.0 + uncertain)
    size = (mu + by_force * f.normal) * f.normal_size
    return np.asarray(size + (by_rate * rate_size + by_direction) * f.normal)


def _turned_too_far(slip: SlipVelocities) -> Array:
    """Residual (n,) of s-.s+ > |s-|^2 / 4, the condition for theta = 1/2."""
    short = 0.25 * rigid.dot(slip.before, slip.before) - rigid.dot(slip.before, slip.end)
    size = 0.25 * rigid.dot(slip.before_size, slip.before_size)
    size += rigid.dot(slip.before_size, slip.end_size)
    return ratio(np.maximum(short, 0.0), size)


def _only(rows: Bools, values: Array) -> Array:
    return np.where(rows, values, np.nan)
