"""A: action and reaction, about any point; parts add up; the wrenches say what they are said to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.friction import contact
from cylconn_ros.laws.normalised import ratio
from cylconn_ros.laws.parameters import Bodies, Parameters
from cylconn_ros.laws.sample_state import Observed
from cylconn_ros.laws.step import AVAILABLE, Step

Array = NDArray[np.float64]


def _moment(out: Array) -> Array:
    return out[:, layout.MOMENT : layout.MOMENT + 3]


def balance(p: Parameters, o: Observed, s: Step, out: Array) -> Array:
    """A: the published wrenches are J~^T Lambda, opposite at node b in the configuration q~."""
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
    fa, ta = received(p, p.a, o.a.orientation, s.half_a, out[:, layout.FORCE_A : layout.FORCE_B])
    fb, tb = received(p, p.b, o.b.orientation, s.half_b, out[:, layout.FORCE_B : layout.STATE0])
    scaled = factor[:, 0]
    com_a = rigid.norm(p.a.com) * size  # a published torque is moved to the mass centre and back
    com_b = rigid.norm(p.b.com) * size
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # a torque that is limited may be the small difference of large terms: the factor's rounding
        terms = np.maximum(sizes + com_a, sizes_b + com_b)
        blurred = scaled * np.where(excess, np.maximum(terms / greatest, 1.0), 1.0)
    rows = [
        ratio(rigid.norm(fb - factor * force), blurred * size),
        ratio(rigid.norm(fa + fb), scaled * size),
        ratio(rigid.norm(tb - factor * (lever_b + moment)), blurred * (sizes_b + com_b)),
        ratio(rigid.norm(ta + factor * (lever_a + moment)), blurred * (sizes + com_a)),
        # about node b, and as the forces are opposite about any point
        ratio(
            rigid.norm(ta - np.cross(s.frame.arm_a, fa) + tb - np.cross(s.frame.arm_b, fb)),
            scaled * (sizes + sizes_b + com_a + com_b),
        ),
    ]
    return np.asarray(np.max(rows, axis=0))


def received(
    p: Parameters, body: Bodies, orientation: Array, half: Array, wrench: Array
) -> tuple[Array, Array]:
    """Force and torque about the mass centre, world axes, that a published wrench comes to.

    One that is held in body axes counts with the axes of half a step on.
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


def parts(p: Parameters, o: Observed, s: Step, out: Array, end: Array, size: Array) -> Array:
    """A: parts add up; springs, dampers and contact forces are those of their formulas."""
    rows = []
    ends = end[:, AVAILABLE] + s.bracket[:, AVAILABLE]
    ends_size = size[:, AVAILABLE] + s.bracket_size[:, AVAILABLE]
    for k, first in enumerate((layout.FORCE_ELASTIC, layout.MOMENT_ELASTIC)):
        five = out[:, first : first + 5]
        reference = np.where(np.isnan(p.reference[:, k]), o.start[:, k], p.reference[:, k])
        way = o.place[:, k] - reference + 0.25 * p.h * (o.w[:, AVAILABLE[k]] + ends[:, k])
        way_size = o.place_size[:, k] + np.abs(reference)
        way_size += 0.25 * p.h * (o.w_size[:, AVAILABLE[k]] + ends_size[:, k])
        spring, spring_size = p.stiffness[:, k] * way, p.stiffness[:, k] * way_size
        rows.append(ratio(five[:, 0] + spring, spring_size))
        speed = 0.5 * (o.w[:, AVAILABLE[k]] + ends[:, k])
        speed_size = 0.5 * (o.w_size[:, AVAILABLE[k]] + ends_size[:, k])
        damper, damper_size = p.damping[:, k] * speed, p.damping[:, k] * speed_size
        # both in one row: a stiff spring's rounding moves the end of the step for the damper
        both = five[:, 0] + five[:, 1] + spring + damper
        rows.append(ratio(both, spring_size + damper_size))
    rows += [sums(out), pressed(p, out), driven(p, out)]
    return np.asarray(np.max(rows, axis=0))


def driven(p: Parameters, out: Array) -> Array:
    """A: the imposed force is the commanded one."""
    wanted = np.where(np.isnan(p.command[:, :, 2]), 0.0, p.command[:, :, 2])
    given = out[:, [layout.FORCE_ACTUATION, layout.MOMENT_ACTUATION]]
    return np.asarray(np.max(ratio(given - wanted, np.abs(wanted)), axis=1))


def sums(out: Array) -> Array:
    """A: the five parts of f1 and of m1 add up."""
    rows = []
    for total, first in (
        (layout.FORCE, layout.FORCE_ELASTIC),
        (layout.MOMENT, layout.MOMENT_ELASTIC),
    ):
        five = out[:, first : first + 5]
        rows.append(ratio(out[:, total] - five.sum(axis=1), np.abs(five).sum(axis=1)))
    return np.asarray(np.max(rows, axis=0))


def pressed(p: Parameters, out: Array) -> Array:
    """A: Fr, Mbend, Fbend and FN are those of the reported wrench."""
    rows = []
    parts_of = contact(p, out[:, layout.FORCE : layout.MOMENT], _moment(out))
    names = (layout.RADIAL_FORCE, layout.BENDING_MOMENT, layout.BENDING_FORCE, layout.NORMAL_FORCE)
    for at, value in zip(names, parts_of, strict=True):
        terms = (
            value if at != layout.NORMAL_FORCE else parts_of[0] + parts_of[2] + np.abs(p.preload)
        )
        rows.append(ratio(out[:, at] - value, terms))
    return np.asarray(np.max(rows, axis=0))
