"""The laws of methods whose wrench is that of the sample's own instant: it acts in q, at once."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import elastic, rigid
from cylconn_ros.laws.balance import balance, driven, pressed, sums
from cylconn_ros.laws.bounds import bounds
from cylconn_ros.laws.friction import limit
from cylconn_ros.laws.normalised import Block, ratio, worst
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.sample_state import Observed
from cylconn_ros.laws.slip import friction_of, terms_of_limit
from cylconn_ros.laws.step import (
    AVAILABLE,
    CONSTRAINED,
    Step,
    accelerations,
    by_wrench,
    pulled,
)

Array = NDArray[np.float64]
PARTS = (
    (layout.FORCE_ELASTIC, layout.FORCE_VISCOUS),
    (layout.MOMENT_ELASTIC, layout.MOMENT_VISCOUS),
)
REACTIONS = [layout.FORCE_REACTION, layout.MOMENT_REACTION]
CONSTRAINT = [layout.FORCE + 1, layout.FORCE + 2, layout.MOMENT + 1, layout.MOMENT + 2]


def balanced(block: Block, o: Observed, s: Step) -> Array:
    """A: opposite wrenches in q; parts by their formulas at the sample."""
    p, out = block.parameters, block.out
    here = dataclasses.replace(s, frame=o.frame)
    rows = [balance(p, o, here, out), sums(out), pressed(p, out), driven(p, out)]
    u, u_size = _stretch(p, o)
    w, w_size = o.w[:, AVAILABLE], o.w_size[:, AVAILABLE]
    for k, (spring, damper) in enumerate(PARTS):
        stiff, damp = p.stiffness[:, k], p.damping[:, k]
        rows.append(ratio(out[:, spring] + stiff * u[:, k], stiff * u_size[:, k]))
        rows.append(ratio(out[:, damper] + damp * w[:, k], damp * w_size[:, k]))
    return np.asarray(np.max(rows, axis=0))


def _stretch(p: Parameters, o: Observed) -> tuple[Array, Array]:
    reference = np.where(np.isnan(p.reference), o.start, p.reference)
    return o.place - reference, o.place_size + np.abs(reference)


def springs(block: Block, o: Observed, s: Step) -> dict[str, Array]:
    """Penalty: constraint, stick and bounds are springs and dampers."""
    p, out = block.parameters, block.out
    stiff, damp = (p.gains[:, [k, k, k + 1, k + 1]] for k in (0, 2))
    w, w_size = o.w[:, CONSTRAINED], o.w_size[:, CONSTRAINED]
    wrong = out[:, CONSTRAINT] + stiff * o.error + damp * w
    constraint = worst(ratio(wrong, stiff * o.error_size + damp * w_size))
    return {
        "C": constraint,
        **_mapped(block, o),
        "U": _pushed(block, o),
        "A": balanced(block, o, s),
    }


def _mapped(block: Block, o: Observed) -> dict[str, Array]:
    """D, S and K: the return mapping onto the disc."""
    p, out, tables = block.parameters, block.out, block.tables
    s, s_size = elastic.slip_of_sample(p, o)
    d, d_size = elastic.carried(p, o, block.past)
    stiff, damp = p.gains[:, 4][:, None], p.gains[:, 5][:, None]
    trial = -stiff * d - damp * s
    trial_size = stiff * d_size + damp * s_size
    f = friction_of(block, np.abs(out[:, CONSTRAINT]))
    rate = rigid.norm(s)
    rest = np.zeros_like(rate)
    slips, sticks = (out[:, layout.REGIME] == x for x in (layout.SLIP, layout.STICK))
    size = rigid.norm(trial_size)
    slipping, resting = (limit(p, tables, r, f.normal) for r in (rate, rest))
    terms = terms_of_limit(block, f, rate, rigid.norm(s_size))
    over = ratio(f.traction - slipping, terms)
    beyond = np.maximum(f.traction - resting, 0.0)
    said = np.where(p.on == (slips | sticks), 0.0, np.inf)
    # radially: across the trial, and not against it
    across = f.phi[:, 0] * trial[:, 1] - f.phi[:, 1] * trial[:, 0]
    back = np.maximum(-rigid.dot(f.phi, trial), 0.0)
    early = np.maximum(resting - rigid.norm(trial), 0.0)  # it slips only beyond the disc
    mapped = np.max(
        [
            ratio(across, f.traction * size),
            ratio(back, f.traction * size),
            ratio(early, size + terms_of_limit(block, f, rest, rest)),
        ],
        axis=0,
    )
    at_rest = ratio(beyond, terms_of_limit(block, f, rest, rest))
    return {
        "D": np.where(slips, over, np.where(sticks, at_rest, said)),
        "S": np.where(slips, mapped, np.nan),
        "K": np.where(sticks, worst(ratio(f.phi - trial, trial_size)), np.nan),
    }


def _pushed(block: Block, o: Observed) -> Array:
    """U: the springs and dampers of stops, a lock or an imposed motion."""
    p, out = block.parameters, block.out
    b = bounds(p, o, block.past, out[:, layout.RESTITUTION])
    x, w, x_size, w_size = o.place, o.w[:, AVAILABLE], o.place_size, o.w_size[:, AVAILABLE]
    stiff, damp = p.gains[:, :2], p.gains[:, 2:4]
    at = np.where(b.locked, b.locked_at[:, None], b.imposed_at)
    rate = np.where(b.locked | np.isnan(p.command[:, :, 1]), 0.0, p.command[:, :, 1])
    held = b.locked | b.driven
    wanted = np.where(held, -stiff * (x - at) - damp * (w - rate), 0.0)
    size = np.where(held, stiff * (x_size + np.abs(at)) + damp * (w_size + np.abs(rate)), 0.0)
    for side, number in ((-1.0, 0), (1.0, 1)):
        stop = p.stops[:, :, number]
        there = np.isfinite(stop) & ~held
        stop = np.where(there, stop, 0.0)
        into = side * (x - stop)
        push = np.maximum(stiff * into + side * damp * w, 0.0)
        pushes = there & (into > 0.0)
        wanted = np.where(pushes, -side * push, wanted)
        near = there & (np.abs(into) <= 1e-13 * (x_size + np.abs(stop)))  # rounding decides
        size = np.where(pushes | near, stiff * (x_size + np.abs(stop)) + damp * w_size, size)
        wanted = np.where(near, out[:, REACTIONS], wanted)
    found = worst(ratio(out[:, REACTIONS] - wanted, size))
    locks = out[:, layout.LOCK] != (b.locked * np.array([1.0, 2.0])).sum(axis=1)
    return np.where(p.bounded, np.where(locks, np.inf, found), np.nan)


def multiplied(block: Block, o: Observed, s: Step) -> dict[str, Array]:
    """augmented_lagrangian: the constraint's multiplier is its own, all else is penalty's."""
    return {**_mapped(block, o), "U": _pushed(block, o), "A": balanced(block, o, s)}


def regularised(block: Block, o: Observed, s: Step) -> dict[str, Array]:
    """baumgarte: accelerations under feedback, friction against the sample's slip."""
    p, out = block.parameters, block.out
    slip, size = elastic.slip_of_sample(p, o)
    f = friction_of(block, np.abs(out[:, CONSTRAINT]))
    rate = rigid.norm(slip)
    over = np.maximum(f.traction - limit(p, block.tables, rate, f.normal), 0.0)
    power = np.maximum(rigid.dot(f.phi, slip), 0.0)
    rows = rate[:, None] * f.phi + f.traction[:, None] * slip
    terms = rate[:, None] * np.abs(f.phi) + f.traction[:, None] * (size + np.abs(slip))
    terms += rigid.norm(size)[:, None] * np.abs(f.phi)
    none = np.full_like(rate, np.nan)
    return {
        "C": _accelerated(block, o, s),
        "D": np.where(p.on, ratio(over, terms_of_limit(block, f, rate, rigid.norm(size))), none),
        "S": np.where(p.on, worst(ratio(rows, terms)), none),
        "E": np.where(p.on, ratio(power, rigid.dot(np.abs(f.phi), size)), none),
        "A": balanced(block, o, s),
    }


def _accelerated(block: Block, o: Observed, s: Step) -> Array:
    """C: (J a + J' v)_c = 2 alpha (pulled - w)_c, with pulled = -e beta^2 / (2 alpha), limited."""
    p, out = block.parameters, block.out
    at_once = dataclasses.replace(p, h=np.ones_like(p.h))
    wrench = out[:, layout.FORCE : layout.FORCE + 6]
    here = dataclasses.replace(s, frame=o.frame, **_inertias(p, o))
    by, by_size = by_wrench(at_once, here, wrench, np.abs(wrench))
    free, free_size = accelerations(p, o, block.sample)
    turning, turning_size = _turning(o)
    alpha, beta = p.feedback[:, 0], p.feedback[:, 1]
    settling = 2.0 * alpha / beta**2
    back, back_size = pulled(o, settling, (p.pull_in_speed, p.pull_in_rate))
    gain = 2.0 * alpha[:, None]
    target = gain * (back - o.w[:, CONSTRAINED])
    size = gain * (back_size + o.w_size[:, CONSTRAINED])
    total = (free + turning + by)[:, CONSTRAINED]
    total_size = (free_size + turning_size + by_size)[:, CONSTRAINED]
    return worst(ratio(total - target, total_size + size))


def _inertias(p: Parameters, o: Observed) -> dict[str, Array]:
    from cylconn_ros.laws.parameters import world

    return {
        "inverse_a": world(p.a.inverse_inertia, rigid.matrix(o.a.orientation)),
        "inverse_b": world(p.b.inverse_inertia, rigid.matrix(o.b.orientation)),
    }


def _turning(o: Observed) -> tuple[Array, Array]:
    """(n, 6) J' v: what turning frames add to the accelerations, and its size."""
    f, wa, wb = o.frame, o.a.spin, o.b.spin
    speed = rigid.out_of(f.axes, o.w[:, :3])
    linear = np.cross(wb, np.cross(wb, f.arm_b)) - np.cross(wa, np.cross(wa, f.arm_a))
    linear -= 2.0 * np.cross(wa, speed)
    size = rigid.cross_size(wb, rigid.cross_size(wb, f.arm_b_size))
    size += rigid.cross_size(wa, rigid.cross_size(wa, f.arm_a_size))
    axes, untwisted = np.abs(f.axes), np.abs(f.untwisted)
    size += 2.0 * rigid.cross_size(wa, rigid.out_of(axes, o.w_size[:, :3]))
    total = [
        rigid.into(f.axes, linear),
        rigid.into(f.untwisted, np.asarray(-np.cross(wa, wb), dtype=np.float64)),
    ]
    sizes = [rigid.into(axes, size), rigid.into(untwisted, rigid.cross_size(wa, wb))]
    return np.concatenate(total, axis=1), np.concatenate(sizes, axis=1)
