"""Relative kinematics of a sample and the history that a connector keeps, written independently.

The relative twist of b against a at node b is w = (v1 v2 v3 w1 w2 w3). Its linear part is in the
axes of a, E. Its angular part is in the axes N = E S, with S the held swing. Every quantity that
enters a law comes with its size: the sum of the absolute values of its terms.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.parameters import Bodies, Bools, Parameters, Rows

Array = NDArray[np.float64]

JUMP_TOLERANCE = 0.08  # of the sum of the squared displacements measured and predicted


@dataclasses.dataclass
class History(Rows):
    """State kept from the previous samples, one row per connector."""

    started: Bools
    target: Array  # (n, 4) of y, z and both swings
    axes_b: Array  # (n, 4) node b's axes in body B
    start: Array  # (n, 2) length and angle of the reference configuration
    stuck: Array  # (n,) consecutive stuck samples, up to the previous one
    held: Array  # (n, 2) position that stick holds
    angle: Array  # (n,) previous angle; its rate and the period after it follow
    spin: Array
    period: Array
    pending: Array  # (n, 2) side (-1, 1) of an impact that goes on, doubled: that ended; 0: none
    rebound: Array  # (n, 2) rate of the gap after that impact
    rebound_size: Array
    acceleration: Array  # (n, 2) of the gap after it
    time: Array  # (n, 2) of the impact, from the previous sample
    restitution: Array  # (n, 2)
    rates: Array  # (n, 2, 2) of slide and spin at the impact of each component
    before: Array  # (n, 2, 2) friction until it, N, N.m
    after: Array  # (n, 2, 2) friction after it
    ambiguous: Bools  # rounding decides whether an impact goes on
    locked: Bools
    locked_at: Array
    lock_last: Array  # (n,) previous position of the component that can lock
    total: Array  # (n, 2) f1, m1 of the previous output
    imposed_at: Array  # (n, 2) current position of imposed motions
    elastic: Array  # (n, 2) elastic slip of a penalty method's stick; its size follows
    elastic_size: Array
    last_motion: Array  # (n, 12) mass centre and its velocity, for A and for B


def no_history(n: int) -> History:
    """History of n connectors before their first sample."""
    return History(
        started=np.zeros(n, dtype=np.bool_),
        target=np.zeros((n, 4)),
        axes_b=np.zeros((n, 4)),
        start=np.zeros((n, 2)),
        stuck=np.zeros(n),
        held=np.zeros((n, 2)),
        angle=np.zeros(n),
        spin=np.zeros(n),
        period=np.zeros(n),
        pending=np.zeros((n, 2)),
        rebound=np.zeros((n, 2)),
        rebound_size=np.zeros((n, 2)),
        acceleration=np.zeros((n, 2)),
        time=np.zeros((n, 2)),
        restitution=np.zeros((n, 2)),
        rates=np.zeros((n, 2, 2)),
        before=np.zeros((n, 2, 2)),
        after=np.zeros((n, 2, 2)),
        ambiguous=np.zeros(n, dtype=np.bool_),
        locked=np.zeros(n, dtype=np.bool_),
        locked_at=np.zeros(n),
        lock_last=np.zeros(n),
        total=np.zeros((n, 2)),
        imposed_at=np.zeros((n, 2)),
        elastic=np.zeros((n, 2)),
        elastic_size=np.zeros((n, 2)),
        last_motion=np.zeros((n, 12)),
    )


@dataclasses.dataclass
class Motion(Rows):
    """Position and velocity of bodies at their mass centres, world axes."""

    com: Array
    orientation: Array
    velocity: Array
    spin: Array
    com_size: Array
    velocity_size: Array


@dataclasses.dataclass
class Frame(Rows):
    """Connector frame in one configuration: axes, and node b from both mass centres."""

    axes: Array  # (n, 3, 3) E
    untwisted: Array  # (n, 3, 3) N
    arm_a: Array
    arm_b: Array
    arm_a_size: Array
    arm_b_size: Array


@dataclasses.dataclass
class SampleState(Rows):
    """Relative kinematics of samples, and the part of the history that the laws use."""

    a: Motion
    b: Motion
    frame: Frame
    w: Array  # (n, 6) w-
    w_size: Array
    position: Array  # (n, 2) l and the angle
    position_size: Array
    error: Array  # (n, 4) y and z minus their targets, and the swing from S, in N
    error_size: Array
    target: Array  # (n, 4) of y, z and both swings
    swing: Array  # (n, 4) S as a quaternion: turns e1a to the held direction of e1b
    axes_b: Array  # (n, 4) node b's axes in body B
    total: Array  # (n, 2) f1, m1 of the previous output
    held: Array  # (n, 2) position that stick holds, from this sample or before
    holding: Bools  # stuck at the previous sample: a position is held
    new_hold: Bools  # the held position is that of this sample
    start: Array  # (n, 2) length and angle of the reference configuration


def motion(body: Bodies, sample: Array, pose: int, twist: int) -> Motion:
    """Motion of the mass centres. pose, twist: first columns in the sample."""
    q = rigid.normalised(sample[:, pose + 3 : pose + 7])
    spin = sample[:, twist + 3 : twist + 6]
    arm = rigid.out_of(rigid.matrix(q), body.com)
    at, speed = sample[:, pose : pose + 3], sample[:, twist : twist + 3]
    return Motion(
        at + arm,
        q,
        speed + np.cross(spin, arm),
        spin,
        np.abs(at) + np.abs(arm),
        np.abs(speed) + rigid.cross_size(spin, arm),
    )


def held_swing(target: Array) -> Array:
    """(n, 4) S as a quaternion, from targets (n, 4), whose vectors turn e1b to e1a."""
    none = np.zeros((len(target), 1))
    return rigid.exp(np.concatenate([none, -target[:, 2:]], axis=1))


def frame(p: Parameters, a: Motion, b: Motion, swing: Array) -> Frame:
    """Connector frame; the wrench acts at node b on both bodies."""
    arm_b = rigid.out_of(rigid.matrix(b.orientation), p.b.node)
    axes = rigid.matrix(rigid.multiply(a.orientation, p.axes_a))
    turned = rigid.matrix(rigid.multiply(rigid.multiply(a.orientation, p.axes_a), swing))
    size = np.abs(arm_b)
    return Frame(axes, turned, b.com - a.com + arm_b, arm_b, a.com_size + b.com_size + size, size)


def relative(f: Frame, va: Array, wa: Array, vb: Array, wb: Array) -> tuple[Array, Array]:
    """(n, 6) J applied to linear and angular velocities of A and B, and its size."""
    linear = vb - va + np.cross(wb, f.arm_b) - np.cross(wa, f.arm_a)
    linear_size = np.abs(vb) + np.abs(va)
    linear_size += rigid.cross_size(wb, f.arm_b_size) + rigid.cross_size(wa, f.arm_a_size)
    total = [rigid.into(f.axes, linear), rigid.into(f.untwisted, wb - wa)]
    axes, untwisted = np.abs(f.axes), np.abs(f.untwisted)
    size = [rigid.into(axes, linear_size), rigid.into(untwisted, np.abs(wb) + np.abs(wa))]
    return np.concatenate(total, axis=1), np.concatenate(size, axis=1)


def state_of(p: Parameters, sample: Array, past: History) -> SampleState:
    """Relative kinematics of one sample (n, NSAMPLE) of n connectors."""
    a = motion(p.a, sample, layout.A_POSE, layout.A_TWIST)
    b = motion(p.b, sample, layout.B_POSE, layout.B_TWIST)
    relative_turn = rigid.multiply(
        rigid.conjugate(rigid.multiply(a.orientation, p.axes_a)),
        rigid.multiply(b.orientation, _axes_b(p, a, b, past)),
    )
    first = np.where(p.hold_misalignment[:, None], rigid.swing(relative_turn), 0.0)
    swings = np.where(past.started[:, None], past.target[:, 2:], first)
    swing = held_swing(np.concatenate([np.zeros_like(swings), swings], axis=1))
    f = frame(p, a, b, swing)
    w, _ = relative(f, a.velocity, a.spin, b.velocity, b.spin)
    _, w_size = relative(f, a.velocity_size, a.spin, b.velocity_size, b.spin)
    d, far = _position(p, a, f)
    rest = rigid.multiply(rigid.conjugate(swing), relative_turn)  # orientation of b from S on
    angle = rigid.twist_angle(rest)
    predicted = past.angle + 0.5 * past.period * (past.spin + w[:, 3])
    turns = np.floor((predicted - angle) / (2.0 * np.pi) + 0.5)
    angle = np.where(past.started, angle + 2.0 * np.pi * turns, angle)
    position = np.stack([d[:, 0], angle], axis=1)
    offsets = np.where(p.hold_offsets[:, None], d[:, 1:], 0.0)
    offsets = np.where(past.started[:, None], past.target[:, :2], offsets)
    target = np.concatenate([offsets, swings], axis=1)
    error = np.concatenate([d[:, 1:] - offsets, -rigid.swing(rest)], axis=1)
    ones = np.ones((len(sample), 2))
    new_hold = (past.stuck <= 1.0) | ~past.started | pose_jumped(p, a, b, past)
    return SampleState(
        a=a,
        b=b,
        frame=f,
        w=w,
        w_size=w_size,
        position=position,
        position_size=np.stack([far[:, 0], 1.0 + np.abs(angle)], axis=1),
        error=error,
        error_size=np.concatenate([far[:, 1:], 2.0 * ones], axis=1) + np.abs(target),
        target=target,
        swing=swing,
        axes_b=_axes_b(p, a, b, past),
        total=past.total,
        held=np.where(new_hold[:, None], position, past.held),
        holding=past.stuck >= 1.0,
        new_hold=new_hold,
        start=np.where(past.started[:, None], past.start, position),
    )


def pose_jumped(p: Parameters, a: Motion, b: Motion, past: History) -> Bools:
    """(n,) whether a pose differs from the integrated twist: stick then holds the new position."""
    found, dt = np.zeros(len(past.period), dtype=np.bool_), past.period[:, None]
    for m, at in ((a, 0), (b, 6)):
        moved, expected = m.com - past.last_motion[:, at : at + 3], dt * m.velocity
        mean = 0.5 * dt * (past.last_motion[:, at + 3 : at + 6] + m.velocity)
        error = np.minimum(_square(moved - expected), _square(moved - mean))
        least = p.pull_in_speed * past.period
        found |= error > JUMP_TOLERANCE * (_square(moved) + _square(expected)) + least**2
    return np.asarray(found & past.started)


def _square(v: Array) -> Array:
    return np.asarray(np.sum(v * v, axis=1))


def com_motion(a: Motion, b: Motion) -> Array:
    """(n, 12) mass centre and velocity of A and of B, for the history."""
    return np.concatenate([a.com, a.velocity, b.com, b.velocity], axis=1)


def _position(p: Parameters, a: Motion, f: Frame) -> tuple[Array, Array]:
    """(n, 3) l, y, z and their sizes."""
    d = rigid.into(f.axes, f.arm_a - rigid.out_of(rigid.matrix(a.orientation), p.a.node))
    return d, rigid.into(np.abs(f.axes), f.arm_a_size)


def violation(p: Parameters, a: Motion, b: Motion, f: Frame, o: SampleState) -> tuple[Array, Array]:
    """(n, 4) constraint error in another configuration than that of ``o``, and its size."""
    d, far = _position(p, a, f)
    axes = rigid.multiply(rigid.multiply(a.orientation, p.axes_a), o.swing)
    rest = rigid.multiply(rigid.conjugate(axes), rigid.multiply(b.orientation, o.axes_b))
    error = np.concatenate([d[:, 1:] - o.target[:, :2], -rigid.swing(rest)], axis=1)
    size = np.concatenate([far[:, 1:], np.full((len(d), 2), 2.0)], axis=1)
    return error, size + np.abs(o.target)


def _axes_b(p: Parameters, a: Motion, b: Motion, past: History) -> Array:
    """(n, 4) node b's axes in body B: given, or equal to node a's at the first sample."""
    aligned = rigid.normalised(
        rigid.multiply(rigid.conjugate(b.orientation), rigid.multiply(a.orientation, p.axes_a))
    )
    first = np.where(np.isnan(p.axes_b[:, :1]), aligned, p.axes_b)
    return np.asarray(np.where(past.started[:, None], past.axes_b, first))


def next_history(p: Parameters, o: SampleState, past: History, out: Array) -> History:
    """History after the samples ``o`` with outputs ``out`` (n, NOUT).

    :func:`cylconn_ros.laws.bounds.next_bounds_history` adds the history of the bounds.
    """
    stick, one = out[:, layout.REGIME] == layout.STICK, np.minimum(past.stuck, 1.0)
    return dataclasses.replace(
        past,
        started=np.ones_like(past.started),
        target=o.target,
        axes_b=o.axes_b,
        start=o.start,
        stuck=np.where(stick, np.where(o.new_hold, one, past.stuck) + 1.0, 0.0),
        last_motion=com_motion(o.a, o.b),
        held=o.held,
        angle=o.position[:, 1],
        spin=o.w[:, 3],
        period=p.h,
        total=out[:, [layout.FORCE, layout.MOMENT]],
    )
