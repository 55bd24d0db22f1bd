"""Answers to random samples: connectors as black boxes, a few successive samples each.

The next sample follows from the answer by a coarse step of our own, and loads change in between, so
that stick after stick, slip after stick and the place that stick holds occur. The laws are those of
one step and hold for any sample: nothing depends on how well that step is made.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.laws import elastic, random_scenes, random_states, rigid
from cylconn_ros.laws.balance import received
from cylconn_ros.laws.bounds import after
from cylconn_ros.laws.normalised import Block
from cylconn_ros.laws.parameters import parameters_of, tables_of
from cylconn_ros.laws.random import Random, generator
from cylconn_ros.laws.sample_state import History, no_history, observe, remember
from cylconn_ros.laws.step import frozen
from cylconn_ros.laws.stops import bounds_of
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
CHAINS = 16  # random starts of one scene
LENGTH = 8  # successive samples of each
BLOCK = 64  # scenes drawn together
FASTEST = 1e3  # m/s and rad/s
ASTRAY = 1.0  # m and rad
MOVING = [*range(7, 13), *range(20, layout.NSAMPLE)]  # twists and loads


class Answers(Protocol):
    """What makes the answers of one scene: :class:`Connector` does."""

    memory: Array

    def step(self, sample: Array, h: float = 0.0, out: Array | None = None) -> Array:
        """Answer one sample."""


@dataclasses.dataclass
class Drawn:
    """A block of samples and where each one comes from."""

    block: Block
    number: NDArray[np.intp]  # (n,) of the scene
    chain: NDArray[np.intp]  # (n,) of the start
    place: NDArray[np.intp]  # (n,) in the chain


def blocks_for(samples: int) -> int:
    """How many blocks hold at least ``samples`` samples."""
    return max(1, -(-samples // (BLOCK * CHAINS * LENGTH)))


def blocks(
    seed: int, number: int, method: str, make: Callable[[Scene], Answers] = Connector
) -> Iterator[Drawn]:
    """The samples of the block of scenes ``number``, a part for each place in the chains.

    Everything follows from the seed and the block's number: any part can be had again alone.
    """
    numbers = range(number * BLOCK, (number + 1) * BLOCK)
    scenes = [random_scenes.scene(seed, k, method) for k in numbers]
    tables = tables_of(scenes)
    of = np.repeat(np.arange(len(scenes)), CHAINS)
    chain = np.tile(np.arange(CHAINS), len(scenes))
    p = parameters_of(scenes).take(of)
    names = np.array([random_scenes.family(k) for k in numbers])[of]
    fixed = (
        np.array([s.body_a.kind == "fixed" for s in scenes])[of],
        np.array([s.body_b.kind == "fixed" for s in scenes])[of],
    )
    rng = generator(seed, 1_000_000_000 + number)
    sample = random_states.states(rng, p, names, fixed)
    random_states.load(rng, p, sample, names)
    past = no_history(len(of))
    for _ in range(60):  # what speeds and loads carry out of reach is slowed down
        rows = random_states.out_of_reach(p, frozen(p, observe(p, sample, past), sample))
        sample[np.ix_(rows, MOVING)] *= 0.5
    connectors = [make(scene) for scene in scenes]
    memory = [connector.memory for connector in connectors for _ in range(CHAINS)]
    for place in range(LENGTH):
        out = np.empty((len(of), layout.NOUT))
        for row, at in enumerate(of):
            connector = connectors[at]
            connector.memory = memory[row]
            connector.step(sample[row], out=out[row])
            memory[row] = connector.memory
        block = Block(p, tables, sample, out, past)
        yield Drawn(block, np.asarray(numbers)[of], chain, np.full(len(of), place))
        sample, past = _next(rng, block, names)


def _next(rng: Random, block: Block, names: NDArray[np.str_]) -> tuple[Array, History]:
    """The samples after the answers, and the history that comes with them."""
    p, sample, out = block.parameters, block.sample, block.out
    o = observe(p, sample, block.past)
    b = bounds_of(block, o)
    d, d_size = elastic.after(p, o, block.past, out)
    past = after(p, o, remember(p, o, block.past, out), b, out)
    past = dataclasses.replace(past, elastic=d, elastic_size=d_size)
    s = frozen(p, o, sample)
    moved = sample.copy()
    for body, m, half, inverse, gain, at, wrench in (
        (p.a, o.a, s.half_a, s.inverse_a, s.gain_a, layout.A_POSE, layout.FORCE_A),
        (p.b, o.b, s.half_b, s.inverse_b, s.gain_b, layout.B_POSE, layout.FORCE_B),
    ):
        force, torque = received(p, body, m.orientation, half, out[:, wrench : wrench + 6])
        h = p.h[:, None]
        velocity = m.velocity + gain[:, :3] + h * body.inverse_mass[:, None] * force
        spin = m.spin + gain[:, 3:] + h * rigid.out_of(inverse, torque)
        velocity, spin = _bounded(velocity), _bounded(spin)
        com = m.com + 0.5 * h * (m.velocity + velocity)
        q = rigid.turned(m.orientation, 0.5 * h * (m.spin + spin))
        arm = rigid.out_of(rigid.matrix(q), body.com)
        random_states.put(moved, at, com - arm, q, velocity - np.cross(spin, arm), spin)
    o = observe(p, moved, past)
    far = rigid.norm(o.error[:, :2]) > ASTRAY  # a coarse step may also leave the connector behind
    far |= rigid.norm(o.error[:, 2:]) > ASTRAY
    moved[far] = sample[far]
    fresh = moved.copy()
    random_states.load(rng, p, fresh, names)
    change = rng.random(len(moved)) < 0.25
    moved[change, layout.LOADS] = fresh[change, layout.LOADS]
    far = random_states.out_of_reach(p, frozen(p, observe(p, moved, past), moved))
    moved[far] = sample[far]
    return moved, past


def _bounded(v: Array) -> Array:
    """Vectors no longer than FASTEST: a coarse step may run away."""
    size = rigid.norm(v)
    return np.asarray(
        v * np.where(size > FASTEST, FASTEST / np.where(size > 0, size, 1.0), 1.0)[:, None]
    )
