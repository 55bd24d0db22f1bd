"""Law of balance: action and reaction, sums of components, and components by their formulas."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.friction import contact
from cylconn_ros.laws.normalised import ratio
from cylconn_ros.laws.parameters import Bodies, Parameters
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import FREE, Step

Array = NDArray[np.float64]


def _moment(out: Array) -> Array:
    return out[:, layout.MOMENT : layout.MOMENT + 3]


def wrench_residual(
    p: Parameters, o: SampleState, s: Step, out: Array, weakened: bool = False
) -> Array:
    """Residual (n,): published wrenches equal J~^T Lambda and are opposite at node b in q~.

    weakened: where GAINS_LOWERED is set both are scaled by one factor from 0 to 1.
    """
    force = rigid.out_of(s.frame.axes, out[:, layout.FORCE : layout.MOMENT])
    moment = rigid.out_of(s.frame.untwisted, _moment(out))
    lever_a, lever_b = np.cross(s.frame.arm_a, force), np.cross(s.frame.arm_b, force)
    sizes = rigid.norm(moment) + rigid.norm(force) * rigid.norm(s.frame.arm_a_size)
    sizes_b = rigid.norm(moment) + rigid.norm(force) * rigid.norm(s.frame.arm_b_size)
    greatest = np.maximum(rigid.norm(lever_a + moment), rigid.norm(lever_b + moment))
    size = rigid.norm(force)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        factor = np.where(size > p.force_limit, p.force_limit / size, 1.0)
        excess = factor * greatest > p.torque_limit
        factor = np.where(excess, p.torque_limit / greatest, factor)[:, None]
    fa, ta = applied_wrench(
        p, p.a, o.a.orientation, s.half_a, out[:, layout.FORCE_A : layout.FORCE_B]
    )
    fb, tb = applied_wrench(
        p, p.b, o.b.orientation, s.half_b, out[:, layout.FORCE_B : layout.STATE0]
    )
    if weakened:
        lowered = out[:, layout.FLAGS].astype(np.int64) & layout.GAINS_LOWERED != 0
        share = common_factor(fb, force, tb, lever_b + moment)[:, None]
        factor = np.where(lowered[:, None], np.minimum(share, factor), factor)
    scaled = factor[:, 0]
    com_a = rigid.norm(p.a.com) * size  # a published torque is moved to the mass centre and back
    com_b = rigid.norm(p.b.com) * size
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # a limited torque can be the small difference of large terms: rounding of the factor
        terms = np.maximum(sizes + com_a, sizes_b + com_b)
        factor_size = scaled * np.where(excess, np.maximum(terms / greatest, 1.0), 1.0)
    rows = [
        ratio(rigid.norm(fb - factor * force), factor_size * size),
        ratio(rigid.norm(fa + fb), scaled * size),
        ratio(rigid.norm(tb - factor * (lever_b + moment)), factor_size * (sizes_b + com_b)),
        ratio(rigid.norm(ta + factor * (lever_a + moment)), factor_size * (sizes + com_a)),
        # about node b; as the forces are opposite, about any point
        ratio(
            rigid.norm(ta - np.cross(s.frame.arm_a, fa) + tb - np.cross(s.frame.arm_b, fb)),
            scaled * (sizes + sizes_b + com_a + com_b),
        ),
    ]
    return np.asarray(np.max(rows, axis=0))


def common_factor(force: Array, whole: Array, torque: Array, whole_torque: Array) -> Array:
    """(n,) the factor from 0 to 1 by which force and torque are shares of their wholes."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        by_force = rigid.norm(force) / rigid.norm(whole)
        by_torque = rigid.norm(torque) / rigid.norm(whole_torque)
    found = np.where(rigid.norm(whole) > 0.0, by_force, by_torque)
    return np.clip(np.where(np.isnan(found), 0.0, found), 0.0, 1.0)


def applied_wrench(
    p: Parameters, body: Bodies, orientation: Array, half: Array, wrench: Array
) -> tuple[Array, Array]:
    """Force and torque about the mass centre, world axes, of a published wrench (n, 6).

    A wrench held in body axes is turned with the body by half a step. half: (n, 4) orientations
    after half a step.
    """
    axes = rigid.matrix(orientation)
    world_axes, at_com = p.world_axes[:, None], p.at_com[:, None]
    force = np.where(world_axes, wrench[:, :3], rigid.out_of(axes, wrench[:, :3]))
    torque = np.where(world_axes, wrench[:, 3:], rigid.out_of(axes, wrench[:, 3:]))
    torque = np.where(at_com, torque, torque - np.cross(rigid.out_of(axes, body.com), force))
    there = rigid.matrix(half)
    held = p.held_in_body[:, None]
    return (
        np.where(held, rigid.out_of(there, rigid.into(axes, force)), force),
        np.where(held, rigid.out_of(there, rigid.into(axes, torque)), torque),
    )


def component_residual(
    p: Parameters, o: SampleState, s: Step, out: Array, end: Array, size: Array
) -> Array:
    """Residual (n,): components add up; springs, dampers and contact forces by their formulas.

    end: (n, 6) J~ v+, and its size.
    """
    rows = []
    ends = end[:, FREE] + s.bracket[:, FREE]
    ends_size = size[:, FREE] + s.bracket_size[:, FREE]
    for k, first in enumerate((layout.FORCE_ELASTIC, layout.MOMENT_ELASTIC)):
        five = out[:, first : first + 5]
        reference = np.where(np.isnan(p.reference[:, k]), o.start[:, k], p.reference[:, k])
        travel = o.position[:, k] - reference + 0.25 * p.h * (o.w[:, FREE[k]] + ends[:, k])
        travel_size = o.position_size[:, k] + np.abs(reference)
        travel_size += 0.25 * p.h * (o.w_size[:, FREE[k]] + ends_size[:, k])
        spring, spring_size = p.stiffness[:, k] * travel, p.stiffness[:, k] * travel_size
        rows.append(ratio(five[:, 0] + spring, spring_size))
        speed = 0.5 * (o.w[:, FREE[k]] + ends[:, k])
        speed_size = 0.5 * (o.w_size[:, FREE[k]] + ends_size[:, k])
        damper, damper_size = p.damping[:, k] * speed, p.damping[:, k] * speed_size
        # their sum too: rounding of a stiff spring moves the end of the step, hence the damper
        both = five[:, 0] + five[:, 1] + spring + damper
        rows.append(ratio(both, spring_size + damper_size))
    rows += [sum_residual(out), contact_residual(p, out), actuation_residual(p, out)]
    return np.asarray(np.max(rows, axis=0))


def actuation_residual(p: Parameters, out: Array) -> Array:
    """Residual (n,): the actuation is the commanded force or moment, less the constant one."""
    wanted = p.imposed_force
    given = out[:, [layout.FORCE_ACTUATION, layout.MOMENT_ACTUATION]]
    return np.asarray(np.max(ratio(given - wanted, np.abs(wanted) + np.abs(p.offset)), axis=1))


def sum_residual(out: Array) -> Array:
    """Residual (n,): the five components of f1 and of m1 add up."""
    rows = []
    for total, first in (
        (layout.FORCE, layout.FORCE_ELASTIC),
        (layout.MOMENT, layout.MOMENT_ELASTIC),
    ):
        five = out[:, first : first + 5]
        rows.append(ratio(out[:, total] - five.sum(axis=1), np.abs(five).sum(axis=1)))
    return np.asarray(np.max(rows, axis=0))


def contact_residual(p: Parameters, out: Array) -> Array:
    """Residual (n,): overlap, its middle, Fr, Mbend, Fbend and FN follow from motion and wrench."""
    rows = [
        ratio(out[:, layout.OVERLAP] - p.overlap, p.overlap * p.overlap_size),
        ratio(out[:, layout.CONTACT_CENTRE] + p.centre, p.centre_size),
    ]
    force, moment = out[:, layout.FORCE : layout.MOMENT], _moment(out)
    parts_of = contact(p, force, moment)
    sizes = contact(p, np.abs(force), np.abs(moment), sizes=True)
    names = (layout.RADIAL_FORCE, layout.BENDING_MOMENT, layout.BENDING_FORCE, layout.NORMAL_FORCE)
    for at, value, size in zip(names, parts_of, sizes, strict=True):
        terms = size if at != layout.NORMAL_FORCE else sizes[0] + sizes[2] + np.abs(p.preload)
        rows.append(ratio(out[:, at] - value, terms))
    return np.asarray(np.max(rows, axis=0))
