"""The step with known inertia, written independently from its definition (equations.md).

    w+ = J~ (v_f + h M^-1 J~^T Lambda)        Lambda = (f1 f2 f3 m1 m2 m3) on B at node b

Forces in the axes of a, E; moments in N = E S, S the held swing.
q~: orientations after half a step, mass centres at their mean over the free step. v_f: the free
velocity, with the angular velocity by the midpoint rule of Euler's equation. Every function works
on all samples at once, one row per sample.
"""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.parameters import Bodies, Parameters, Rows, world
from cylconn_ros.laws.sample_state import Frame, Motion, SampleState, frame, relative

Array = NDArray[np.float64]
CONSTRAINED = [1, 2, 4, 5]  # rows of w: y, z and both swings
FREE = [0, 3]  # slide and spin
MOST_ROTATION = 0.6  # |w| h up to which the constraint is imposed at the end of the step


@dataclasses.dataclass
class Step(Rows):
    """A step without its wrench; sizes are sums of the absolute values of terms."""

    frame: Frame  # in the configuration q~
    half_a: Array  # (n, 4) orientations after half a step
    half_b: Array
    inverse_a: Array  # (n, 3, 3) inverse inertias in q~, world axes
    inverse_b: Array
    gain_a: Array  # (n, 6) change of v and w of A by gravity, loads and gyroscopic terms
    gain_b: Array
    free: Array  # (n, 6) J~ v_f
    free_size: Array
    bracket: Array  # (n, 6) (J(q^) - J~) v
    bracket_size: Array
    target: Array  # (n, 4) of the constrained rows
    target_size: Array
    hold: Array  # (n, 2) rates of slide and spin by which stick returns to its held position
    hold_size: Array


@dataclasses.dataclass
class _Free(Rows):
    """Free step of a body: configuration q~ and the changes of its velocities."""

    middle: Motion
    half: Array
    gain: Array  # h a
    turn: Array  # h dw
    turn_size: Array


def _column(x: NDArray[Any]) -> NDArray[Any]:
    return x[:, None]


def angular_acceleration(
    body: Bodies, orientation: Array, spin: Array, spin_size: Array, torque: Array, size: Array
) -> tuple[Array, Array]:
    """(n, 3) dw/dt from I dw/dt = torque - w x I w, world axes, and its size."""
    axes = rigid.matrix(orientation)
    w = rigid.into(axes, spin)
    lever = rigid.into(axes, torque) - np.cross(w, rigid.out_of(body.inertia, w))
    rate = rigid.out_of(axes, rigid.out_of(body.inverse_inertia, lever))
    axes = np.abs(axes)
    w = rigid.into(axes, spin_size)
    lever = rigid.into(axes, size) + rigid.cross_size(w, rigid.out_of(np.abs(body.inertia), w))
    return rate, rigid.out_of(axes, rigid.out_of(np.abs(body.inverse_inertia), lever))


def _free_step(p: Parameters, body: Bodies, m: Motion, load: Array) -> _Free:
    """Step of a body under gravity, load (n, 6) and gyroscopic torque, without the connector."""
    h = _column(p.h)
    explicit, free = _column(p.explicit), _column(body.free)
    force = load[:, :3]
    arm = rigid.out_of(rigid.matrix(m.orientation), body.com)
    torque = load[:, 3:] - np.cross(arm, force)  # about the mass centre
    size = np.abs(load[:, 3:]) + rigid.cross_size(arm, force)
    acceleration = np.where(free, p.gravity + _column(body.inverse_mass) * force, 0.0)
    half = rigid.turned(m.orientation, 0.5 * h * m.spin)
    spin, none = np.abs(m.spin), np.zeros_like(torque)
    start, start_size = angular_acceleration(body, m.orientation, m.spin, spin, none, none)
    spins = m.spin + 0.5 * h * start, spin + 0.5 * h * start_size
    later = rigid.out_of(rigid.matrix(half), body.com)  # the point of application turns too
    turned = load[:, 3:] - np.cross(later, force)
    turned_size = np.abs(load[:, 3:]) + rigid.cross_size(later, force)
    middle = angular_acceleration(body, half, *spins, turned, turned_size)
    frozen = angular_acceleration(body, m.orientation, m.spin, spin, torque, size)
    turn, turn_size = (
        np.where(free, np.where(explicit, one, other), 0.0)
        for one, other in zip(frozen, middle, strict=True)
    )
    com = m.com + 0.5 * h * m.velocity + h * h / 6.0 * acceleration
    ahead = 0.5 * h * m.velocity_size + h * h / 6.0 * np.abs(acceleration)
    there = Motion(
        np.where(explicit, m.com, com),
        np.where(explicit, m.orientation, half),
        m.velocity,
        m.spin,
        m.com_size + np.where(explicit, 0.0, ahead),
        m.velocity_size,
    )
    half = np.where(explicit, m.orientation, half)
    return _Free(there, half, h * acceleration, h * turn, h * turn_size)


def frozen(p: Parameters, o: SampleState, sample: Array) -> Step:
    """The step with the end configuration q^ = q + h v, before the correction for fast rotation.

    sample: (n, NSAMPLE).
    """
    loads_a = sample[:, layout.A_LOAD : layout.B_LOAD]
    loads_b = sample[:, layout.B_LOAD : layout.NSAMPLE]
    a, b = _free_step(p, p.a, o.a, loads_a), _free_step(p, p.b, o.b, loads_b)
    acting = frame(p, a.middle, b.middle, o.swing)
    still, still_size = _of_motion(acting, o)
    gain, _ = relative(acting, a.gain, a.turn, b.gain, b.turn)
    _, gain_size = relative(acting, a.gain, a.turn_size, b.gain, b.turn_size)
    ahead = frame(p, _ahead(p, o.a), _ahead(p, o.b), o.swing)
    there, there_size = _of_motion(ahead, o)
    both = p.h * np.minimum(rigid.norm(o.a.spin), rigid.norm(o.b.spin))
    exact = _column(~p.explicit & ~(both > MOST_ROTATION)).astype(np.float64)
    keep_place = 0.5 * _column(~p.explicit).astype(np.float64)
    keep = 0.5 * exact
    bracket, bracket_size = exact * (there - still), exact * (there_size + still_size)
    h = _column(p.h)
    back_in, back_in_size = pull_in_rates(o, p.h, pull_in_limits(p, o))
    back = (o.position - o.held) / h + keep_place * o.w[:, FREE]
    back = np.where(_column(o.holding), back, 0.0)
    away = np.where(_column(o.new_hold), 0.0, o.position_size + np.abs(o.held))
    back_size = away / h + keep_place * o.w_size[:, FREE]
    return Step(
        frame=acting,
        half_a=a.half,
        half_b=b.half,
        inverse_a=world(p.a.inverse_inertia, rigid.matrix(a.middle.orientation)),
        inverse_b=world(p.b.inverse_inertia, rigid.matrix(b.middle.orientation)),
        gain_a=np.concatenate([a.gain, a.turn], axis=1),
        gain_b=np.concatenate([b.gain, b.turn], axis=1),
        free=still + gain,
        free_size=still_size + gain_size,
        bracket=bracket,
        bracket_size=bracket_size,
        target=back_in - keep * o.w[:, CONSTRAINED] - bracket[:, CONSTRAINED],
        target_size=back_in_size + keep * o.w_size[:, CONSTRAINED] + bracket_size[:, CONSTRAINED],
        hold=back,
        hold_size=np.where(_column(o.holding), back_size, 0.0),
    )


def with_others(p: Parameters, s: Step, others: Array) -> Step:
    """The step with the wrenches of other connectors among what is known.

    others: (n, 12) force (N) and torque (N.m) about the mass centre in q~, world axes; A, then B.
    """
    h = _column(p.h)
    gains, sizes = [], []
    for body, inverse, w in (
        (p.a, s.inverse_a, others[:, :6]), (p.b, s.inverse_b, others[:, 6:]),
    ):  # fmt: skip
        gain = h * _column(body.inverse_mass) * w[:, :3]
        turn = h * rigid.out_of(inverse, w[:, 3:])
        gains.append(np.where(_column(body.free), np.concatenate([gain, turn], axis=1), 0.0))
        turn_size = h * rigid.out_of(np.abs(inverse), np.abs(w[:, 3:]))
        size = np.concatenate([np.abs(gain), turn_size], axis=1)
        sizes.append(np.where(_column(body.free), size, 0.0))
    (a, b), (a_size, b_size) = gains, sizes
    added, _ = relative(s.frame, a[:, :3], a[:, 3:], b[:, :3], b[:, 3:])
    _, size = relative(s.frame, a_size[:, :3], a_size[:, 3:], b_size[:, :3], b_size[:, 3:])
    return dataclasses.replace(
        s, gain_a=s.gain_a + a, gain_b=s.gain_b + b,
        free=s.free + added, free_size=s.free_size + size,
    )  # fmt: skip


def _of_motion(f: Frame, o: SampleState) -> tuple[Array, Array]:
    """(n, 6) J v for the sample's velocities in another configuration, and its size."""
    value, _ = relative(f, o.a.velocity, o.a.spin, o.b.velocity, o.b.spin)
    _, size = relative(f, o.a.velocity_size, o.a.spin, o.b.velocity_size, o.b.spin)
    return value, size


def _ahead(p: Parameters, m: Motion) -> Motion:
    """Motion in the configuration q^ = q + h v."""
    h = _column(p.h)
    turned = rigid.turned(m.orientation, h * m.spin)
    size = m.com_size + h * m.velocity_size
    return Motion(m.com + h * m.velocity, turned, m.velocity, m.spin, size, m.velocity_size)


def pull_in_limits(p: Parameters, o: SampleState) -> tuple[Array, Array]:
    """(n,) maximum rates at which offsets (m/s) and swings (rad/s) are corrected.

    The truncation error of a step needs an additional (|w| h)^2 |w|, times the arms for offsets.
    This addition decreases from |w| h = 0.5 on and is 0 from 0.75 on.
    """
    spin = np.maximum(rigid.norm(o.a.spin), rigid.norm(o.b.spin))
    own = np.clip(6.0 - 10.0 * spin * p.h, 0.0, 1.0) * (spin * p.h) ** 2 * spin
    arms = rigid.norm(o.frame.arm_a) + rigid.norm(o.frame.arm_b)
    return p.pull_in_speed + own * arms, p.pull_in_rate + own


def pull_in_rates(
    o: SampleState, time_constant: Array, limits: tuple[Array, Array]
) -> tuple[Array, Array]:
    """(n, 4) -e/time_constant, offsets and swings each limited in length, and its size."""
    found, size = [], []
    for rows, greatest in zip((slice(0, 2), slice(2, 4)), limits, strict=True):
        e, terms = o.error[:, rows], o.error_size[:, rows]
        long = _column(rigid.norm(e))
        far = long > _column(greatest * time_constant)
        rate = np.where(
            far, _column(greatest) / np.where(far, long, 1.0), 1.0 / _column(time_constant)
        )
        found.append(-rate * e)
        size.append(rate * terms)
    return np.concatenate(found, axis=1), np.concatenate(size, axis=1)


def accelerations(p: Parameters, o: SampleState, sample: Array) -> tuple[Array, Array]:
    """(n, 6) J a in q under gravity, loads and gyroscopic torques, and its size."""
    values: list[Array] = []
    sizes: list[Array] = []
    for body, m, at in ((p.a, o.a, layout.A_LOAD), (p.b, o.b, layout.B_LOAD)):
        load, free = sample[:, at : at + 6], _column(body.free)
        arm = rigid.out_of(rigid.matrix(m.orientation), body.com)
        torque = load[:, 3:] - np.cross(arm, load[:, :3])
        size = np.abs(load[:, 3:]) + rigid.cross_size(arm, load[:, :3])
        push = _column(body.inverse_mass) * load[:, :3]
        turn, turn_size = angular_acceleration(
            body, m.orientation, m.spin, np.abs(m.spin), torque, size
        )
        values += [np.where(free, p.gravity + push, 0.0), np.where(free, turn, 0.0)]
        sizes += [np.where(free, np.abs(p.gravity) + np.abs(push), 0.0)]
        sizes += [np.where(free, turn_size, 0.0)]
    value, _ = relative(o.frame, *values)
    _, size = relative(o.frame, *sizes)
    return value, size


def rates_from_wrench(p: Parameters, s: Step, wrench: Array, terms: Array) -> tuple[Array, Array]:
    """(n, 6) change of the relative rates by a wrench, h J~ M^-1 J~^T Lambda, and its size.

    wrench: (n, 6) Lambda; terms: (n, 6) sums of the absolute values of its components.
    """
    force = rigid.out_of(s.frame.axes, wrench[:, :3])
    moment = rigid.out_of(s.frame.untwisted, wrench[:, 3:])
    zero = np.zeros_like(force)
    total, size = np.zeros_like(wrench), np.zeros_like(wrench)
    force_size = rigid.out_of(np.abs(s.frame.axes), terms[:, :3])
    moment_size = rigid.out_of(np.abs(s.frame.untwisted), terms[:, 3:])
    h = _column(p.h)
    for sign, body, inverse, arm, arm_size in (
        (1.0, p.b, s.inverse_b, s.frame.arm_b, s.frame.arm_b_size),
        (-1.0, p.a, s.inverse_a, s.frame.arm_a, s.frame.arm_a_size),
    ):
        gain = h * _column(body.inverse_mass)
        push = sign * gain * force
        turn = sign * h * rigid.out_of(inverse, np.cross(arm, force) + moment)
        lever = rigid.cross_size(arm_size, force_size) + moment_size
        push_size, turn_size = gain * force_size, h * rigid.out_of(np.abs(inverse), lever)
        if sign > 0.0:
            part, _ = relative(s.frame, zero, zero, push, turn)
            _, part_size = relative(s.frame, zero, zero, push_size, turn_size)
        else:
            part, _ = relative(s.frame, push, turn, zero, zero)
            _, part_size = relative(s.frame, push_size, turn_size, zero, zero)
        total, size = total + part, size + part_size
    return total, size


def compliance(p: Parameters, s: Step) -> Array:
    """(n, 6, 6) Delassus operator G = J~ M^-1 J~^T, in the axes of Lambda."""
    n = len(p.h)
    back = s.frame.axes.transpose(0, 2, 1) @ s.frame.untwisted  # from N to E
    total = np.zeros((n, 6, 6))
    for body, inverse, arm in (
        (p.b, s.inverse_b, s.frame.arm_b),
        (p.a, s.inverse_a, s.frame.arm_a),
    ):
        turns = s.frame.axes.transpose(0, 2, 1) @ inverse @ s.frame.axes
        lever = rigid.skew(rigid.into(s.frame.axes, arm))
        total[:, :3, :3] += body.inverse_mass[:, None, None] * np.eye(3) - lever @ turns @ lever
        total[:, :3, 3:] -= lever @ turns @ back
        total[:, 3:, :3] += back.transpose(0, 2, 1) @ turns @ lever
        total[:, 3:, 3:] += back.transpose(0, 2, 1) @ turns @ back
    return total


def reaction_size(p: Parameters, s: Step, wrench: Array, terms: Array) -> Array:
    """(n, 4) sums of the terms of the reactions f2, f3, m2, m3 as functions of f1 and m1.

    (f2 f3 m2 m3) = base + C (f1, m1): |base| + |C| terms. wrench, terms: as in :func:`by_wrench`.
    """
    g = compliance(p, s)
    by = -inverse(g[:, CONSTRAINED][:, :, CONSTRAINED]) @ g[:, CONSTRAINED][:, :, FREE]
    base = wrench[:, CONSTRAINED] - np.einsum("nij,nj->ni", by, wrench[:, FREE])
    return np.abs(base) + np.einsum("nij,nj->ni", np.abs(by), terms[:, FREE])


def inverse(g: Array) -> Array:
    """(n, k, k) inverses of positive definite matrices, finite also for nearly singular ones."""
    scale = np.sqrt(np.einsum("nii->ni", g))
    scales = scale[:, :, None] * scale[:, None, :]  # ones on the diagonal
    values, vectors = np.linalg.eigh(g / scales)
    even = vectors / np.maximum(values, 1e-16)[:, None, :] @ vectors.transpose(0, 2, 1)
    return np.asarray(even / scales)
