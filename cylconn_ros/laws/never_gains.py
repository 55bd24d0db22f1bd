"""Law never gains: the sent wrench, held over its period, puts no energy into the bodies.

Written independently of the solver, for all samples at once. The published wrench is integrated
over the period on the motion of the plant as declared, exact or semi-implicit, together with its
work W. With the spring energy V and the work D of the drives

    gain = W + V+ - V - D,      rise <- max(rise + gain, 0) <= bound

bound: ALLOWED_RISE of the kinetic energy of the bodies' relative motion, and the energy of pull-in
as far as it exceeds that; or what a spring stores without the wrench, if that is more.
A gain within TOLERANCE of the energy exchanged in the step is not counted. A single sample begins
with the rise 0; the samples of a run are summed. The law concerns steps in which the wrench turns
by more than LEAST_TURN against the arms (|w| h times arm over radius of gyration).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.balance import applied_wrench, common_factor
from cylconn_ros.laws.normalised import Block
from cylconn_ros.laws.parameters import Bodies, Bools, Parameters
from cylconn_ros.laws.sample_state import Motion, SampleState, frame
from cylconn_ros.laws.step import CONSTRAINED, Step, compliance, inverse, pull_in_rates

Array = NDArray[np.float64]

ALLOWED_RISE = 5e-3  # of the kinetic energy
TOLERANCE = 1e-6  # of the energy exchanged
SLACK = 1e-4  # of the bounds: two integrators of fourth order
LEAST_TURN = 0.05  # rad, at the mean of the least and the greatest radius of gyration
MOST_TURN = 10.0  # rad by which a body may turn in a step: beyond, it is not resolved
MOST_TURN_ALONE = 3.0  # the same for a single sample, whose loads are random
WITHOUT_STOPS = False  # leave out the steps in which a stop acts


@dataclasses.dataclass
class Gains:
    """Energy put into the bodies by each step (n,), what it exchanged, and its bound, J."""

    gain: Array
    exchanged: Array
    bound: Array
    least: Array  # gain without the wrench: what springs store
    applies: Bools
    unresolved: Bools  # steps that turn too far to be integrated: what they gain is not known


@dataclasses.dataclass
class _Path:
    end: Motion
    work: Array
    turn: Array  # rad, of the spin and of its nutation, from above


def residual(block: Block, o: SampleState, s: Step, in_order: bool) -> Array:
    """Residual (n,) of the law; NaN where it does not apply.

    in_order: the samples follow each other, so that gains add up.
    """
    g = gains(block, o, s, MOST_TURN if in_order else MOST_TURN_ALONE)
    bound = g.bound * (1.0 + SLACK)
    excess = np.maximum(g.gain - np.maximum(bound, g.least), 0.0)
    if in_order:
        rise = 0.0
        for k in np.flatnonzero(g.applies | g.unresolved):
            if g.unresolved[k]:
                rise = 0.0
                continue
            excess[k] = max(g.gain[k] - max(bound[k] - rise, g.least[k], 0.0), 0.0)
            rise = min(max(rise + g.gain[k], 0.0), bound[k])
    size = np.maximum(g.exchanged + g.bound, 1e-300)
    return np.where(g.applies, excess / size, np.nan)


def gains(block: Block, o: SampleState, s: Step, most_turn: float = MOST_TURN) -> Gains:
    """Energy that the published wrenches put into the bodies."""
    p, out = block.parameters, block.out
    if block.elements is not None:
        p, out = block.elements.original
    with np.errstate(all="ignore"):
        far = p.h * np.maximum(rigid.norm(o.a.spin), rigid.norm(o.b.spin)) * _arm_ratio(p, o)
        far = far > LEAST_TURN
        load_a = block.sample[:, layout.A_LOAD : layout.B_LOAD]
        load_b = block.sample[:, layout.B_LOAD :]
        a = _path(p, p.a, o.a, load_a, out[:, 0:6], far)
        b = _path(p, p.b, o.b, load_b, out[:, 6:12], far)
        gain, exchanged = a.work + b.work, np.abs(a.work) + np.abs(b.work)
        stored, drive = _springs_and_drives(block, p, o, out, a.end, b.end)
        drive = _sent_share(p, o, s, out) * drive
        gain = gain + stored - drive
        exchanged = exchanged + np.abs(stored) + np.abs(drive)
        gain = np.where(
            gain > 0.0, np.maximum(gain - TOLERANCE * (1 + SLACK) * exchanged, 0.0), gain
        )
        moving = _relative_energy(p, o)
        bound = ALLOWED_RISE * moving + np.maximum(_pull_in_energy(p, o, s) - moving, 0.0)
        turn = np.maximum(a.turn, b.turn)
        applies = far & (turn < most_turn) & np.isfinite(gain)
        # the reaction of a drive that a stop can hold back is not all its own
        held_back = np.isfinite(p.stops).any(axis=2) & p.imposed
        if block.elements is not None:
            held_back |= block.elements.compliant & p.imposed
        applies &= ~held_back.any(axis=1)
        beyond = applies & (gain > bound)  # a spring may store more without the wrench
        least = np.zeros_like(gain)
        if beyond.any():
            none = np.zeros_like(out[:, 0:6])
            a0 = _path(p, p.a, o.a, load_a, none, beyond)
            b0 = _path(p, p.b, o.b, load_b, none, beyond)
            kept = _springs_and_drives(block, p, o, out, a0.end, b0.end)[0]
            least = np.where(beyond, kept, 0.0)
    if WITHOUT_STOPS:
        applies &= (out[:, layout.STOP] == 0) & (out[:, layout.RESTITUTION] == 0.0)
    return Gains(gain, exchanged, bound, least, applies, far & ~applies)


def _sent_share(p: Parameters, o: SampleState, s: Step, out: Array) -> Array:
    """(n,) the share of the computed force, or moment, that was sent."""
    axes = s.frame
    wanted = out[:, layout.FORCE : layout.MOMENT], out[:, layout.MOMENT : layout.MOMENT + 3]
    force = rigid.out_of(axes.axes, wanted[0])
    torque = np.cross(axes.arm_b, force) + rigid.out_of(axes.untwisted, wanted[1])
    sent = applied_wrench(p, p.b, o.b.orientation, s.half_b, out[:, 6:12])
    return common_factor(sent[0], force, sent[1], torque)


def _arm_ratio(p: Parameters, o: SampleState) -> Array:
    """(n,) greatest arm over least radius of gyration of the free bodies, at least 1."""
    found = np.zeros(len(p.h))
    for body, arm in ((p.a, o.frame.arm_a), (p.b, o.frame.arm_b)):
        mass = 1.0 / np.where(body.free, body.inverse_mass, 1.0)
        least = np.maximum(np.linalg.eigvalsh(body.inertia)[:, 0], 1e-300)
        ratio = np.sqrt(1.0 + rigid.dot(arm, arm) * mass / least)
        found = np.maximum(found, np.where(body.free, ratio, 0.0))
    return found


def _slenderness(body: Bodies) -> Array:
    """(n,) greatest over least moment of inertia: nutation over spin, from above."""
    moments = np.linalg.eigvalsh(body.inertia)
    return np.asarray(moments[:, 2] / np.maximum(moments[:, 0], 1e-300), dtype=np.float64)


def _relative_energy(p: Parameters, o: SampleState) -> Array:
    """(n,) kinetic energy of the bodies' motion relative to each other, J."""
    total = p.a.inverse_mass + p.b.inverse_mass
    apart = o.b.velocity - o.a.velocity
    energy = 0.5 * rigid.dot(apart, apart) / np.where(total > 0.0, total, np.inf)
    for body, m in ((p.a, o.a), (p.b, o.b)):
        energy = energy + np.where(body.free, _rotational(body, m.orientation, m.spin), 0.0)
    return energy


def _rotational(body: Bodies, q: Array, spin: Array) -> Array:
    w = rigid.into(rigid.matrix(q), spin)
    return 0.5 * rigid.dot(w, rigid.out_of(body.inertia, w))


def _pull_in_energy(p: Parameters, o: SampleState, s: Step) -> Array:
    """(n,) kinetic energy of the constrained components at the rate of pull-in, J."""
    rate, _ = pull_in_rates(o, p.h, (p.pull_in_speed, p.pull_in_rate))
    g = compliance(p, s)[:, CONSTRAINED][:, :, CONSTRAINED]
    return 0.5 * np.einsum("ni,nij,nj->n", rate, inverse(g), rate)


def _springs_and_drives(
    block: Block, p: Parameters, o: SampleState, out: Array, a: Motion, b: Motion
) -> tuple[Array, Array]:
    """(n,) change of spring energy, and work of imposed forces and motions in the step, J."""
    f = frame(p, a, b, o.swing)
    arm = f.arm_a - rigid.out_of(rigid.matrix(a.orientation), p.a.node)
    slid = rigid.dot(f.axes[:, :, 0], arm) - o.position[:, 0]
    spin = rigid.dot(f.axes[:, :, 0], b.spin - a.spin)
    moved = np.stack([slid, 0.5 * p.h * (o.w[:, 3] + spin)], axis=1)
    rest = np.where(np.isnan(p.reference), o.start, p.reference)
    before = o.position - rest
    stored = 0.5 * np.sum(p.stiffness * moved * (2.0 * before + moved), axis=1)
    if block.elements is not None:
        stored = stored + block.elements.stored(moved)
    imposed = ~(np.isnan(p.command[:, :, 0]) & np.isnan(p.command[:, :, 1]))
    drive = out[:, [layout.FORCE_ACTUATION, layout.MOMENT_ACTUATION]]
    reaction = out[:, [layout.FORCE_REACTION, layout.MOMENT_REACTION]]
    return stored, np.sum((drive + np.where(imposed, reaction, 0.0)) * moved, axis=1)


def _path(p: Parameters, body: Bodies, m: Motion, load: Array, wrench: Array, far: Bools) -> _Path:
    """Motion over the period under a published wrench (n, 6) and a load, and the wrench's work.

    far: (n,) rows of which they are asked for.
    """
    force, torque = applied_wrench(p, body, m.orientation, m.orientation, wrench)
    known = load[:, 3:] + _lever(body, m.orientation, load[:, :3])
    rate = _rate_of_spin(body, m.orientation, m.spin, torque + known)
    faster = 0.5 * p.h * np.where(body.free, rigid.norm(rate), 0.0)
    turn = p.h * (rigid.norm(m.spin) + faster) * np.where(body.free, _slenderness(body), 1.0)
    least = np.maximum(np.linalg.eigvalsh(body.inertia)[:, 0], 1e-300)
    pendulum = np.sqrt(rigid.norm(load[:, :3]) * rigid.norm(body.com) / least)
    turn = turn + np.where(body.free, p.h * pendulum, 0.0)
    explicit = _semi_implicit(p, body, m, load, force, torque)
    rows = np.flatnonzero(far & ~p.explicit & (turn < MOST_TURN))
    some, work_of = _exact(
        p.take(rows), body.take(rows), m.take(rows),
        load[rows], force[rows], torque[rows], turn[rows],
    )  # fmt: skip
    end, work = explicit[0], np.where(p.explicit, explicit[1], np.nan)
    for name in ("com", "orientation", "velocity", "spin"):
        getattr(end, name)[rows] = getattr(some, name)
    work[rows] = work_of
    return _Path(end, work, turn)


def _lever(body: Bodies, q: Array, force: Array) -> Array:
    """(n, 3) torque about the mass centre of a force at the origin of the body frame."""
    return np.asarray(-np.cross(rigid.out_of(rigid.matrix(q), body.com), force), dtype=np.float64)


def _rate_of_spin(body: Bodies, q: Array, spin: Array, torque: Array) -> Array:
    axes = rigid.matrix(q)
    w = rigid.into(axes, spin)
    lever = rigid.into(axes, torque) - np.cross(w, rigid.out_of(body.inertia, w))
    return np.asarray(rigid.out_of(axes, rigid.out_of(body.inverse_inertia, lever)))


def _semi_implicit(
    p: Parameters, body: Bodies, m: Motion, load: Array, force: Array, torque: Array
) -> tuple[Motion, Array]:
    h, free = p.h[:, None], body.free[:, None]
    push = body.inverse_mass[:, None] * (force + load[:, :3])
    velocity = m.velocity + np.where(free, h * (p.gravity + push), 0.0)
    known = load[:, 3:] + _lever(body, m.orientation, load[:, :3])
    before, works, spins = _rotational(body, m.orientation, m.spin), [], []
    for acting in (torque, np.zeros_like(torque)):
        rate = _rate_of_spin(body, m.orientation, m.spin, acting + known)
        spin = m.spin + np.where(free, h * rate, 0.0)
        after = _rotational(body, rigid.turned(m.orientation, h * spin), spin)
        spins.append(spin)
        works.append(after - before - 0.5 * p.h * rigid.dot(known, m.spin + spin))
    work = 0.5 * p.h * rigid.dot(force, m.velocity + velocity) + works[0]
    work = work - np.maximum(works[1], 0.0)
    constant = p.h * (rigid.dot(force, m.velocity) + rigid.dot(torque, m.spin))
    end = dataclasses.replace(
        m,
        com=m.com + h * velocity,
        orientation=rigid.turned(m.orientation, h * spins[0]),
        velocity=velocity,
        spin=spins[0],
    )
    return end, np.where(body.free, work, constant)


def _exact(
    p: Parameters, body: Bodies, m: Motion, load: Array, force: Array, torque: Array, turn: Array
) -> tuple[Motion, Array]:
    """Runge-Kutta steps of quaternion, angular momentum, velocity and position."""
    steps = 1 + np.minimum(20.0 * np.where(turn < MOST_TURN, turn, 0.0), 400.0).astype(np.int64)
    h = (p.h / steps)[:, None]
    start = rigid.matrix(m.orientation)
    held, free = p.held_in_body[:, None], body.free[:, None]
    inside = rigid.into(start, force), rigid.into(start, torque)
    outer = np.where(free, p.gravity + body.inverse_mass[:, None] * load[:, :3], 0.0)

    def spin_of(axes: Array, momentum: Array) -> Array:
        spin = rigid.out_of(axes, rigid.out_of(body.inverse_inertia, rigid.into(axes, momentum)))
        return np.where(free, spin, m.spin)

    def rates(q: Array, v: Array, momentum: Array) -> tuple[Array, ...]:
        axes = rigid.matrix(q)
        w = spin_of(axes, momentum)
        push = np.where(held, rigid.out_of(axes, inside[0]), force)
        twist = np.where(held, rigid.out_of(axes, inside[1]), torque)
        lever = twist + load[:, 3:] + _lever(body, q, load[:, :3])
        quarter = 0.5 * rigid.multiply(np.concatenate([w, np.zeros((len(w), 1))], axis=1), q)
        faster = outer + body.inverse_mass[:, None] * push
        return v, quarter, faster, lever, (rigid.dot(push, v) + rigid.dot(twist, w))[:, None]

    momentum = rigid.out_of(start, rigid.out_of(body.inertia, rigid.into(start, m.spin)))
    y: tuple[Array, ...] = (m.com, m.orientation, m.velocity, momentum, np.zeros((len(p.h), 1)))
    for k in range(int(steps.max(initial=1))):
        k1 = rates(y[1], y[2], y[3])
        z = [one + 0.5 * h * d for one, d in zip(y, k1, strict=True)]
        k2 = rates(rigid.normalised(z[1]), z[2], z[3])
        z = [one + 0.5 * h * d for one, d in zip(y, k2, strict=True)]
        k3 = rates(rigid.normalised(z[1]), z[2], z[3])
        z = [one + h * d for one, d in zip(y, k3, strict=True)]
        k4 = rates(rigid.normalised(z[1]), z[2], z[3])
        goes = (k < steps)[:, None]
        new = [
            np.where(goes, one + h / 6.0 * (d1 + 2.0 * d2 + 2.0 * d3 + d4), one)
            for one, d1, d2, d3, d4 in zip(y, k1, k2, k3, k4, strict=True)
        ]
        y = (new[0], rigid.normalised(new[1]), new[2], new[3], new[4])
    spin = spin_of(rigid.matrix(y[1]), y[3])
    end = dataclasses.replace(m, com=y[0], orientation=y[1], velocity=y[2], spin=spin)
    return end, y[4][:, 0]
