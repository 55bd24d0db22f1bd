"""Target rates of a step with fast rotation, by prediction of its end; written independently.

For |w| h between LEAST_ROTATION and MOST_ROTATION, PASSES times: predict the end of the step under
the wrench for the present target, with f1 and m1 of the previous output, and take from there one
Newton step for J(q+) v+ + k e(q+)/h = 0; none at all if one leaves more of it than at first.
Rotations are integrated as the plant defines them: Runge-Kutta-Munthe-Kaas of fourth order, in
steps of at most a tenth of a radian.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid, turning
from cylconn_ros.laws.parameters import Bodies, Bools, Parameters, Rows
from cylconn_ros.laws.sample_state import Motion, SampleState, frame, relative, violation
from cylconn_ros.laws.step import (
    CONSTRAINED,
    FREE,
    MOST_ROTATION,
    Step,
    angular_acceleration,
    compliance,
    frozen,
    inverse,
    pull_in_limits,
    pull_in_rates,
    rates_from_wrench,
    with_others,
)

Array = NDArray[np.float64]
LEAST_ROTATION = 0.1
MOST_TURN = 1.5  # rad by which a body may turn under the wrench; beyond, the target stays
PASSES = 3  # Newton steps
GAIN = 5.0  # k


@dataclasses.dataclass
class _End(Rows):
    """Predicted end of steps under a wrench."""

    rates: Array  # (n, 6) J(q_p) v_p
    rates_size: Array
    error: Array  # (n, 4)
    error_size: Array
    known: Bools  # whether each body turns by less than MOST_TURN


def prepare_step(p: Parameters, o: SampleState, sample: Array, others: Array | None = None) -> Step:
    """The step without its wrench, corrected for fast rotation. sample: (n, NSAMPLE).

    others: as of :func:`~cylconn_ros.laws.step.with_others`; the end of a step with several
    connectors is not predicted.
    """
    s = frozen(p, o, sample)
    if others is not None:
        return with_others(p, s, others)
    rows = np.flatnonzero(is_fast(p, o))
    if not len(rows):
        return s
    better = with_predicted_end(p.take(rows), o.take(rows), s.take(rows), sample[rows])
    changed = {}
    for name in ("bracket", "bracket_size", "target", "target_size"):
        changed[name] = getattr(s, name).copy()
        changed[name][rows] = getattr(better, name)
    return dataclasses.replace(s, **changed)


def is_fast(p: Parameters, o: SampleState) -> Bools:
    """(n,) whether the end of the step is predicted."""
    turn = p.h * np.maximum(rigid.norm(o.a.spin), rigid.norm(o.b.spin))
    possible = ~p.explicit & ~p.held_in_body & (p.a.free | p.b.free)
    return np.asarray(possible & (turn > LEAST_ROTATION) & (turn < MOST_ROTATION))


def with_predicted_end(p: Parameters, o: SampleState, s: Step, sample: Array) -> Step:
    """The step with bracket and target from its predicted end; for fast rows only."""
    g = compliance(p, s)
    inner, across = g[:, CONSTRAINED][:, :, CONSTRAINED], g[:, CONSTRAINED][:, :, FREE]
    scale = np.sqrt(np.einsum("nii->ni", inner))
    even = inner / (scale[:, :, None] * scale[:, None, :])
    spread = np.abs(inverse(inner))
    h = p.h[:, None]
    going = np.ones(len(p.h), dtype=np.bool_)
    arms = rigid.norm(s.frame.arm_a) + rigid.norm(s.frame.arm_b)
    begun, least = s, np.asarray(np.zeros(len(p.h)))
    for number in range(PASSES):
        wrench, terms = np.zeros((len(p.h), 6)), np.zeros((len(p.h), 6))
        wrench[:, FREE] = o.total
        terms[:, FREE] = np.abs(o.total)
        needed = (s.target - s.free[:, CONSTRAINED]) / h
        needed -= np.einsum("nij,nj->ni", across, o.total)
        size = (s.target_size + s.free_size[:, CONSTRAINED]) / h
        size += np.einsum("nij,nj->ni", np.abs(across), np.abs(o.total))
        wrench[:, CONSTRAINED] = np.linalg.solve(even, (needed / scale)[:, :, None])[:, :, 0]
        wrench[:, CONSTRAINED] /= scale
        terms[:, CONSTRAINED] = np.einsum("nij,nj->ni", spread, size)
        added, added_size = rates_from_wrench(p, s, wrench, terms)
        rates, rates_size = s.free + added, s.free_size + added_size
        rates[:, CONSTRAINED] = s.target
        end = _end(p, o, s, sample, wrench, terms)
        away = dataclasses.replace(o, error=end.error, error_size=end.error_size)
        back, back_size = pull_in_rates(away, p.h / GAIN, pull_in_limits(p, o))
        d = end.rates[:, CONSTRAINED] - back
        left = rigid.dot(d[:, :2], d[:, :2]) + arms**2 * rigid.dot(d[:, 2:], d[:, 2:])
        least = left if number == 0 else least
        diverges = going & ~(end.known & (left <= least))
        s = _as_begun(s, begun, diverges)
        going &= ~diverges
        s = _newton_step(s, rates, rates_size, end, back, back_size, going)
    return s


def _as_begun(s: Step, begun: Step, rows: Bools) -> Step:
    """The step ``s`` with bracket and target of ``begun`` in the ``rows``."""
    at = rows[:, None]
    return dataclasses.replace(
        s,
        bracket=np.where(at, begun.bracket, s.bracket),
        bracket_size=np.where(at, begun.bracket_size, s.bracket_size),
        target=np.where(at, begun.target, s.target),
        target_size=np.where(at, begun.target_size, s.target_size),
    )


def _newton_step(
    s: Step, rates: Array, size: Array, end: _End, back: Array, back_size: Array, going: Bools
) -> Step:
    """One Newton step, for the rows in ``going``; back: rates of correction at the end."""
    share, rows = 1.0 / (1.0 + 0.5 * GAIN), going[:, None]
    target = s.target - share * (end.rates[:, CONSTRAINED] - back)
    target_size = s.target_size + share * (end.rates_size[:, CONSTRAINED] + back_size)
    return dataclasses.replace(
        s,
        bracket=np.where(rows, end.rates - rates, s.bracket),
        bracket_size=np.where(rows, end.rates_size + size, s.bracket_size),
        target=np.where(rows, target, s.target),
        target_size=np.where(rows, target_size, s.target_size),
    )


def _end(
    p: Parameters, o: SampleState, s: Step, sample: Array, wrench: Array, terms: Array
) -> _End:
    """Predicted end of the step under a wrench (n, 6) with terms of these sizes (n, 6)."""
    force = rigid.out_of(s.frame.axes, wrench[:, :3])
    moment = rigid.out_of(s.frame.untwisted, wrench[:, 3:])
    force_size = rigid.out_of(np.abs(s.frame.axes), terms[:, :3])
    moment_size = rigid.out_of(np.abs(s.frame.untwisted), terms[:, 3:])
    ends, spins, known = [], [], np.ones(len(p.h), dtype=np.bool_)
    for sign, body, m, arm, arm_size, inverted, load in (
        (-1.0, p.a, o.a, s.frame.arm_a, s.frame.arm_a_size, s.inverse_a, layout.A_LOAD),
        (1.0, p.b, o.b, s.frame.arm_b, s.frame.arm_b_size, s.inverse_b, layout.B_LOAD),
    ):
        outer = sample[:, load : load + 6]
        lever = rigid.out_of(rigid.matrix(m.orientation), body.com)
        push = sign * force + outer[:, :3]
        torque = sign * (np.cross(arm, force) + moment) + outer[:, 3:]
        torque_size = rigid.cross_size(arm_size, force_size) + moment_size
        torque_size += np.abs(outer[:, 3:]) + rigid.cross_size(lever, outer[:, :3])
        end, turn = _moved(
            p, body, m, push, force_size + np.abs(outer[:, :3]), torque, outer[:, :3]
        )
        known &= turn < MOST_TURN
        ends.append(end)
        turned = p.h[:, None] * rigid.out_of(np.abs(inverted), torque_size)
        spins.append(np.abs(m.spin) + np.abs(end.spin) + turned)
    a, b = ends
    with np.errstate(over="ignore", invalid="ignore"):
        f = frame(p, a, b, o.swing)
        rates, _ = relative(f, a.velocity, a.spin, b.velocity, b.spin)
        _, size = relative(f, a.velocity_size, spins[0], b.velocity_size, spins[1])
        error, error_size = violation(p, a, b, f, o)
        error_size = error_size + p.h[:, None] * size[:, CONSTRAINED]
    return _End(rates, size, error, error_size, known)


def _moved(
    p: Parameters, body: Bodies, m: Motion, push: Array, push_size: Array, torque: Array,
    pull: Array,
) -> tuple[Motion, Array]:  # fmt: skip
    """Motion after h under force and torque about the mass centre, and the angle of its turn.

    pull: (n, 3) the part of the force that acts at the origin of the body frame.
    """
    h, free = p.h[:, None], body.free[:, None]
    gain = np.where(free, p.gravity + body.inverse_mass[:, None] * push, 0.0)
    gain_size = np.abs(p.gravity) + body.inverse_mass[:, None] * push_size
    gain_size = np.where(free, gain_size, 0.0)
    first = torque + _lever_torque(body, m.orientation, pull)
    rate = angular_acceleration(body, m.orientation, m.spin, np.abs(m.spin), first, np.abs(first))[
        0
    ]
    bent = np.where(body.free, 0.5 * p.h * rigid.norm(rate), 0.0)
    turn = p.h * (rigid.norm(m.spin) + bent)
    q, spin = _turned(p, body, m, torque, pull, _fine(p, body, pull, turn))
    still = rigid.turned(m.orientation, h * m.spin)
    end = Motion(
        m.com + h * m.velocity + 0.5 * h * h * gain,
        np.where(free, q, still),
        m.velocity + h * gain,
        np.where(free, spin, m.spin),
        m.com_size + h * m.velocity_size + 0.5 * h * h * gain_size,
        m.velocity_size + h * gain_size,
    )
    return end, turn


def _fine(p: Parameters, body: Bodies, pull: Array, turn: Array) -> Array:
    """(n,) rad that determine the number of steps: of the turn, and of the load's pendulum."""
    j = body.inverse_inertia
    trace = np.einsum("nii->n", j)
    swings = np.sqrt(rigid.norm(pull) * rigid.norm(body.com) * trace)
    return np.where(turn < MOST_TURN, turn + p.h * swings, 0.0)


def _lever_torque(body: Bodies, q: Array, pull: Array) -> Array:
    """(n, 3) torque about the mass centre of a force at the origin of the body frame."""
    return np.asarray(-np.cross(rigid.out_of(rigid.matrix(q), body.com), pull), dtype=np.float64)


def _turned(
    p: Parameters, body: Bodies, m: Motion, torque: Array, pull: Array, turn: Array
) -> tuple[Array, Array]:
    """Orientation and angular velocity after h; ``torque`` is constant in world axes."""
    steps = 1 + (10.0 * turn).astype(np.int64)
    q, spin = m.orientation.copy(), m.spin.copy()
    torque, pull = np.ascontiguousarray(torque), np.ascontiguousarray(pull)
    turning.turn(
        body.com, body.inertia, body.inverse_inertia, torque, pull, p.h / steps, steps, q, spin
    )
    return q, spin
