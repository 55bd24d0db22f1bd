"""Laws of the methods with an explicit wrench: it depends on the sample only and acts in q."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import elastic, rigid
from cylconn_ros.laws.balance import (
    actuation_residual,
    contact_residual,
    sum_residual,
    wrench_residual,
)
from cylconn_ros.laws.bounds import driven, motion_bounds, stop_sides
from cylconn_ros.laws.drives import excess
from cylconn_ros.laws.friction import along, limit
from cylconn_ros.laws.normalised import Block, ratio, worst
from cylconn_ros.laws.parameters import Parameters, world
from cylconn_ros.laws.sample_state import Frame, SampleState, frame
from cylconn_ros.laws.slip import limit_size, reported_friction
from cylconn_ros.laws.step import (
    CONSTRAINED,
    FREE,
    Step,
    accelerations,
    pull_in_rates,
    rates_from_wrench,
)

Array = NDArray[np.float64]
PARTS = (
    (layout.FORCE_ELASTIC, layout.FORCE_VISCOUS),
    (layout.MOMENT_ELASTIC, layout.MOMENT_VISCOUS),
)
REACTIONS = [layout.FORCE_REACTION, layout.MOMENT_REACTION]
CONSTRAINT = [layout.FORCE + 1, layout.FORCE + 2, layout.MOMENT + 1, layout.MOMENT + 2]


def explicit_balance(block: Block, o: SampleState, s: Step, acting: Frame) -> Array:
    """Residual (n,) of the balance: opposite wrenches, components by their formulas.

    acting: the configuration in which the wrench acts.
    """
    p, out = block.parameters, block.out
    here = dataclasses.replace(s, frame=acting)
    rows = [
        wrench_residual(p, o, here, out),
        sum_residual(out),
        contact_residual(p, out),
        actuation_residual(p, out),
    ]
    u, u_size = _elongation(p, o)
    w, w_size = o.w[:, FREE], o.w_size[:, FREE]
    for k, (spring, damper) in enumerate(PARTS):
        stiff, damp = p.stiffness[:, k], p.damping[:, k]
        rows.append(ratio(out[:, spring] + stiff * u[:, k], stiff * u_size[:, k]))
        rows.append(ratio(out[:, damper] + damp * w[:, k], damp * w_size[:, k]))
    return np.asarray(np.max(rows, axis=0))


def _elongation(p: Parameters, o: SampleState) -> tuple[Array, Array]:
    """(n, 2) length and angle minus their references where springs act, and the size.

    In the middle of the step on an exact plant, at the sample on a semi-implicit one.
    """
    reference = np.where(np.isnan(p.reference), o.start, p.reference)
    ahead = np.where(p.explicit, 0.0, 0.5 * p.h)[:, None]
    u = o.position + ahead * o.w[:, FREE] - reference
    return u, o.position_size + ahead * o.w_size[:, FREE] + np.abs(reference)


def _middle_frame(p: Parameters, o: SampleState) -> Frame:
    """The configuration at the half of the step, of an exact plant, in which the wrench acts."""
    h = np.where(p.explicit, 0.0, 0.5 * p.h)[:, None]
    a, b = (
        dataclasses.replace(
            m, com=m.com + h * m.velocity, orientation=rigid.turned(m.orientation, h * m.spin)
        )
        for m in (o.a, o.b)
    )
    return frame(p, a, b, o.swing)


def penalty(block: Block, o: SampleState, s: Step) -> dict[str, Array]:
    """Laws of penalty: constraint, stick and bounds are springs and dampers."""
    p, out = block.parameters, block.out
    stiff, damp = (p.gains[:, [k, k, k + 1, k + 1]] for k in (0, 2))
    w, w_size = o.w[:, CONSTRAINED], o.w_size[:, CONSTRAINED]
    error = out[:, CONSTRAINT] + stiff * o.error + damp * w
    constraint = worst(ratio(error, stiff * o.error_size + damp * w_size))
    return {
        "constraint": _of_whole_gains(out, constraint),
        **_return_mapping(block, o),
        "stops": _of_whole_gains(out, _penalty_bounds(block, o)),
        "balance": explicit_balance(block, o, s, _middle_frame(block.parameters, o)),
    }


def _of_whole_gains(out: Array, residual: Array) -> Array:
    """The residual where gains are as requested: lowered ones are not published."""
    lowered = out[:, layout.FLAGS].astype(np.int64) & layout.GAINS_LOWERED != 0
    return np.where(lowered, np.nan, residual)


def _return_mapping(block: Block, o: SampleState) -> dict[str, Array]:
    """Friction limit, slip direction and stick of the return mapping onto the friction disc."""
    p, out, tables = block.parameters, block.out, block.tables
    s, s_size = elastic.slip_of_sample(p, o)
    d, d_size = elastic.advanced_slip(p, o, block.past)
    stiff, damp = p.gains[:, 4][:, None], p.gains[:, 5][:, None]
    trial = -stiff * d - damp * s
    trial_size = stiff * d_size + damp * s_size
    f = reported_friction(block, np.abs(out[:, CONSTRAINT]))
    rate = rigid.norm(s)
    rest = np.zeros_like(rate)
    slips, sticks = (out[:, layout.REGIME] == x for x in (layout.SLIP, layout.STICK))
    size = rigid.norm(trial_size)
    lowered = out[:, layout.FLAGS].astype(np.int64) & layout.GAINS_LOWERED != 0
    cosine = np.where(lowered, along(-f.phi), along(-trial))
    slipping, resting = (limit(p, tables, r, f.normal, cosine) for r in (rate, rest))
    turned = rigid.norm(trial_size) / np.maximum(rigid.norm(trial), 1e-300)
    terms = limit_size(block, f, rate, rigid.norm(s_size))
    terms = terms + np.abs(p.direction) * turned * slipping
    over = ratio(f.traction - slipping, terms)
    beyond = np.maximum(f.traction - resting, 0.0)
    no_friction = np.where(p.on == (slips | sticks), 0.0, np.inf)
    # the return is radial: nothing across the trial friction, and nothing against it
    across = f.phi[:, 0] * trial[:, 1] - f.phi[:, 1] * trial[:, 0]
    back = np.maximum(-rigid.dot(f.phi, trial), 0.0)
    early = np.maximum(resting - rigid.norm(trial), 0.0)  # slip needs a trial outside of the disc
    mapped = np.max(
        [
            ratio(across, f.traction * size),
            ratio(back, f.traction * size),
            ratio(early, size + limit_size(block, f, rest, rest)),
        ],
        axis=0,
    )
    at_rest = ratio(beyond, limit_size(block, f, rest, rest))
    return {
        "friction_limit": np.where(slips, over, np.where(sticks, at_rest, no_friction)),
        "slip_direction": _of_whole_gains(out, np.where(slips, mapped, np.nan)),
        "stick": _of_whole_gains(
            out, np.where(sticks, worst(ratio(f.phi - trial, trial_size)), np.nan)
        ),
    }


def _penalty_bounds(block: Block, o: SampleState) -> Array:
    """Residual (n,) of the stops law: springs and dampers of stops, a lock or an imposed motion."""
    p, out = block.parameters, block.out
    b = motion_bounds(p, o, block.past)
    x, w, x_size, w_size = o.position, o.w[:, FREE], o.position_size, o.w_size[:, FREE]
    stiff, damp = p.gains[:, :2], p.gains[:, 2:4]
    at = np.where(b.locked, b.locked_at[:, None], b.imposed_at)
    rate = np.where(b.locked | np.isnan(p.command[:, :, 1]), 0.0, p.command[:, :, 1])
    held = b.locked | b.imposed
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
    # a drive that approaches a position or is held back (methods/drives/spring.py): only its limit
    approaches = b.imposed & ~b.locked & ~np.isnan(p.command[:, :, 0])
    loose = driven(p, b) | approaches
    beyond = excess(np.abs(out[:, REACTIONS]), p.drive[:, :, 0])
    beyond = np.where(stop_sides(out) != 0.0, 0.0, beyond)
    found = worst(np.where(loose, beyond, ratio(out[:, REACTIONS] - wanted, size)))
    locks = out[:, layout.LOCK] != (b.locked * np.array([1.0, 2.0])).sum(axis=1)
    return np.where(p.bounded, np.where(locks, np.inf, found), np.nan)


def augmented_lagrangian(block: Block, o: SampleState, s: Step) -> dict[str, Array]:
    """Laws of augmented_lagrangian: those of penalty except for the constraint."""
    return {
        **_return_mapping(block, o),
        "stops": _of_whole_gains(block.out, _penalty_bounds(block, o)),
        "balance": explicit_balance(block, o, s, _middle_frame(block.parameters, o)),
    }


def baumgarte(block: Block, o: SampleState, s: Step) -> dict[str, Array]:
    """Laws of baumgarte: accelerations with feedback, friction against the sample's slip."""
    p, out = block.parameters, block.out
    slip, size = elastic.slip_of_sample(p, o)
    f = reported_friction(block, np.abs(out[:, CONSTRAINT]))
    rate = rigid.norm(slip)
    over = np.maximum(f.traction - limit(p, block.tables, rate, f.normal, along(slip)), 0.0)
    power = np.maximum(rigid.dot(f.phi, slip), 0.0)
    rows = rate[:, None] * f.phi + f.traction[:, None] * slip
    terms = rate[:, None] * np.abs(f.phi) + f.traction[:, None] * (size + np.abs(slip))
    terms += rigid.norm(size)[:, None] * np.abs(f.phi)
    none = np.full_like(rate, np.nan)
    return {
        "constraint": _accelerations(block, o, s),
        "friction_limit": np.where(
            p.on, ratio(over, limit_size(block, f, rate, rigid.norm(size))), none
        ),
        "slip_direction": np.where(p.on, worst(ratio(rows, terms)), none),
        "dissipation": np.where(p.on, ratio(power, rigid.dot(np.abs(f.phi), size)), none),
        "balance": explicit_balance(block, o, s, o.frame),
    }


def _accelerations(block: Block, o: SampleState, s: Step) -> Array:
    """Residual (n,) of the constraint: (J a + J' v)_c = 2 alpha (r - w)_c.

    r = -e beta^2 / (2 alpha), limited by the pull-in speed and rate.
    """
    p, out = block.parameters, block.out
    at_once = dataclasses.replace(p, h=np.ones_like(p.h))
    wrench = out[:, layout.FORCE : layout.FORCE + 6]
    here = dataclasses.replace(s, frame=o.frame, **_inertias(p, o))
    by, by_size = rates_from_wrench(at_once, here, wrench, np.abs(wrench))
    free, free_size = accelerations(p, o, block.sample)
    turning, turning_size = _velocity_product(o)
    alpha, beta = p.feedback[:, 0], p.feedback[:, 1]
    time_constant = 2.0 * alpha / beta**2
    back, back_size = pull_in_rates(o, time_constant, (p.pull_in_speed, p.pull_in_rate))
    gain = 2.0 * alpha[:, None]
    target = gain * (back - o.w[:, CONSTRAINED])
    size = gain * (back_size + o.w_size[:, CONSTRAINED])
    total = (free + turning + by)[:, CONSTRAINED]
    total_size = (free_size + turning_size + by_size)[:, CONSTRAINED]
    return worst(ratio(total - target, total_size + size))


def _inertias(p: Parameters, o: SampleState) -> dict[str, Array]:
    """Inverse inertias (n, 3, 3) in the sample's configuration, world axes."""
    return {
        "inverse_a": world(p.a.inverse_inertia, rigid.matrix(o.a.orientation)),
        "inverse_b": world(p.b.inverse_inertia, rigid.matrix(o.b.orientation)),
    }


def _velocity_product(o: SampleState) -> tuple[Array, Array]:
    """(n, 6) J' v, the velocity-dependent part of the relative accelerations, and its size."""
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
