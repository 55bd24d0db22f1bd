"""Random samples of random scenes: poses, twists and loads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.parameters import Bodies, Bools, Parameters
from cylconn_ros.laws.random import Random, decades, direction, orientation
from cylconn_ros.laws.random_scenes import LONGEST_ARM
from cylconn_ros.laws.step import Step

Array = NDArray[np.float64]
Names = NDArray[np.str_]
HELD_TILT = math.radians(150.0)  # largest held misalignment; 1 rad if it is to be corrected


def out_of_reach(p: Parameters, s: Step) -> Bools:
    """(n,) whether an arm of the wrench exceeds LONGEST_ARM least radii of gyration."""
    found = np.zeros(len(p.h), dtype=np.bool_)
    for body, arm in ((p.a, s.frame.arm_a), (p.b, s.frame.arm_b)):
        found |= body.free & (rigid.norm(arm) > LONGEST_ARM * _gyration(body))
    return found


def _gyration(body: Bodies) -> Array:
    """(n,) least radii of gyration, m; infinite for a body that is not free."""
    least = np.linalg.eigvalsh(body.inertia)[:, 0] * body.inverse_mass
    return np.where(body.free, np.sqrt(least), np.inf)


def states(rng: Random, p: Parameters, family_of: Names, fixed: tuple[Bools, Bools]) -> Array:
    """(n, NSAMPLE) random samples without loads, one for each row of ``p``.

    Poses and twists satisfy the constraint except for random violations.

    Args:
        family_of: (n,) names of families.
        fixed: (n,) whether A is fixed, and whether B is.

    """
    n = len(p.h)
    sample = np.zeros((n, layout.NSAMPLE))
    calm = (family_of == "roots") & (rng.random(n) < 0.8)
    qa, at_a = orientation(rng, n), rng.normal(size=(n, 3))
    q_node = rigid.multiply(qa, p.axes_a)
    axes = rigid.matrix(q_node)
    wrong = np.where(calm[:, None], 0.0, 1.0)
    tilt = wrong * _sometimes(rng, n) * direction(rng, n) * decades(rng, -12.0, 0.0, n)[:, None]
    held = (p.hold_misalignment & ~np.isnan(p.axes_b[:, 0]))[:, None]
    tilt *= np.where(held, HELD_TILT, 1.0)
    v, w = _rates(rng, n, calm)
    length = rng.normal(size=n) * decades(rng, -2.0, 0.5, n)
    reach = 0.5 * LONGEST_ARM * _gyration(p.a)
    length = _near(rng, p, 0, np.minimum(reach, 1e3) * np.clip(length / reach, -1.0, 1.0), v[:, 0])
    angle = _near(rng, p, 1, rng.uniform(-math.pi, math.pi, n), w[:, 0])
    swing = rigid.exp(tilt * np.array([0.0, 1.0, 1.0]))
    turn = rigid.multiply(swing, rigid.exp(angle[:, None] * np.array([1.0, 0.0, 0.0])))
    untwisted = rigid.matrix(np.where(held, rigid.multiply(q_node, swing), q_node))
    given = np.where(np.isnan(p.axes_b[:, :1]), orientation(rng, n), p.axes_b)
    qb = rigid.normalised(rigid.multiply(rigid.multiply(q_node, turn), rigid.conjugate(given)))
    offset = wrong * _sometimes(rng, n) * direction(rng, n) * decades(rng, -12.0, -0.5, n)[:, None]
    offset *= np.minimum(1.0, 0.1 * reach)[:, None]
    offset[:, 0] = length
    arm_a = rigid.out_of(rigid.matrix(qa), p.a.com + p.a.node) + rigid.out_of(axes, offset)
    arm_b = rigid.out_of(rigid.matrix(qb), p.b.com + p.b.node)

    still = (rng.random(n) < np.where(family_of == "wide", 0.2, 0.5)) | calm
    spin_a = direction(rng, n) * np.where(still, 0.0, decades(rng, -3.0, 3.0, n))[:, None]
    speed_a = direction(rng, n) * decades(rng, -3.0, 1.5, n)[:, None]
    spin_b = spin_a + rigid.out_of(untwisted, w)
    speed_b = speed_a + np.cross(spin_a, arm_a) + rigid.out_of(axes, v) - np.cross(spin_b, arm_b)
    at_b = at_a + arm_a - arm_b
    # relative to a fixed body
    apart = at_b - at_a
    from_a, from_b = fixed[0][:, None], fixed[1][:, None]
    speed_b = np.where(from_a, speed_b - speed_a - np.cross(spin_a, apart), speed_b)
    speed_a = np.where(from_b, speed_a - speed_b + np.cross(spin_b, apart), speed_a)
    spin_a, spin_b = (
        np.where(from_b, spin_a - spin_b, spin_a),
        np.where(from_a, spin_b - spin_a, spin_b),
    )
    put(sample, layout.A_POSE, at_a, qa, np.where(from_a, 0.0, speed_a), spin_a * ~from_a)
    put(sample, layout.B_POSE, at_b, qb, np.where(from_b, 0.0, speed_b), spin_b * ~from_b)
    return sample


def _near(rng: Random, p: Parameters, k: int, position: Array, rate: Array) -> Array:
    """(n,) positions of component k; if it has a stop, most are within two steps of it."""
    n = len(position)
    stops = p.stops[:, k]
    there = np.isfinite(stops)
    upper = np.where(there.all(axis=1), rng.random(n) < 0.5, there[:, 1])
    stop = np.where(upper, stops[:, 1], stops[:, 0])
    ahead = np.where(rng.random(n) < 0.8, p.h * np.abs(rate), decades(rng, -9.0, -2.0, n))
    gap = ahead * rng.uniform(-0.1, 2.0, n)
    near = there.any(axis=1) & (rng.random(n) < 0.8)
    return np.where(near, np.where(near, stop, 0.0) + np.where(upper, -gap, gap), position)


def put(sample: Array, at: int, position: Array, q: Array, speed: Array, spin: Array) -> None:
    """Write pose and twist of one body into the columns from ``at`` of (n, NSAMPLE)."""
    sample[:, at : at + 13] = np.concatenate([position, q, speed, spin], axis=1)


def _sometimes(rng: Random, n: int) -> Array:
    return rng.choice([0.0, 1.0], n)[:, None]


def _rates(rng: Random, n: int, calm: Bools) -> tuple[Array, Array]:
    """(n, 3) v and w of b against a: slide and spin over all scales, the others small."""
    wrong = rng.choice([0.0, 1.0, 1.0], n)[:, None] * decades(rng, -9.0, 0.0, n)[:, None]
    wrong = np.where(calm[:, None], 1e-3 * wrong, wrong)
    v, w = wrong * rng.normal(size=(n, 3)), wrong * rng.normal(size=(n, 3))
    v[:, 0] = rng.normal(size=n) * decades(rng, -4.0, 2.0, n)
    w[:, 0] = rng.normal(size=n) * decades(rng, -3.0, 2.8, n) * np.where(calm, 1e-2, 1.0)
    quiet = rng.random((2, n)) < np.where(calm, 0.0, 0.15)
    v[quiet[0], 0] = 0.0
    w[quiet[1], 0] = 0.0
    return v, w


def load(rng: Random, p: Parameters, sample: Array, family_of: Names) -> None:
    """Replace the loads of (n, NSAMPLE) samples by random ones, in place.

    In the family ``roots`` the load bends B against the moment of friction about its mass centre.
    Bending then decreases and later increases with friction, which leads to several solutions.
    """
    n = len(sample)
    for at, body in ((layout.A_LOAD, p.a), (layout.B_LOAD, p.b)):
        mass = np.where(body.free, 1.0 / np.where(body.free, body.inverse_mass, 1.0), 0.0)
        force = 9.81 * mass * decades(rng, -3.0, 3.0, n)
        moment = force * decades(rng, -3.0, 0.5, n)
        sample[:, at : at + 3] = direction(rng, n) * (force * rng.choice([0, 1], n))[:, None]
        sample[:, at + 3 : at + 6] = direction(rng, n) * (moment * rng.choice([0, 1], n))[:, None]
    rows = np.flatnonzero((family_of == "roots") & p.b.free & (rng.random(n) < 0.8))
    if not len(rows):
        return
    q, sub = p.take(rows), sample[rows]
    a, b = (
        rigid.matrix(rigid.multiply(rigid.normalised(sub[:, 3:7]), q.axes_a)),
        rigid.matrix(rigid.normalised(sub[:, 16:20])),
    )
    arm, com = rigid.out_of(b, q.b.node), rigid.out_of(b, q.b.com)
    slide = rigid.dot(a[:, :, 0], sub[:, 20:23] - sub[:, 7:10])
    axis = np.cross(arm, a[:, :, 0])
    weight = 9.81 / q.b.inverse_mass
    force = direction(rng, len(rows)) * (weight * decades(rng, -3.0, 1.0, len(rows)))[:, None]
    moment = (
        axis
        * (
            np.sign(slide)
            * np.maximum(q.kinetic, 0.01)
            * (weight + np.abs(q.preload))
            * decades(rng, -0.5, 2.5, len(rows))
        )[:, None]
    )
    sample[rows, layout.A_LOAD : layout.B_LOAD] = 0.0
    sample[rows, layout.B_LOAD : layout.B_LOAD + 3] = force
    sample[rows, layout.B_LOAD + 3 : layout.NSAMPLE] = moment + np.cross(com, force)
