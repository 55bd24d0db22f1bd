"""Outputs for random samples: connectors as black boxes, a few successive samples each.

The next sample follows from the output by a coarse step of the bodies, and loads change in between,
so that stick after stick, slip after stick and held positions occur. The laws are those of one step
and hold for any sample, so the accuracy of the coarse step is irrelevant.
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
from cylconn_ros.laws.balance import applied_wrench
from cylconn_ros.laws.bounds import next_bounds_history
from cylconn_ros.laws.elements import block_of, substituted
from cylconn_ros.laws.friction import at_sample
from cylconn_ros.laws.normalised import Block
from cylconn_ros.laws.parameters import parameters_of, tables_of
from cylconn_ros.laws.predicted_end import prepare_step
from cylconn_ros.laws.random import Random, generator
from cylconn_ros.laws.sample_state import History, next_history, no_history, state_of
from cylconn_ros.laws.step import frozen
from cylconn_ros.laws.stops import bounds_of
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
CHAINS = 16  # random initial samples of one scene
LENGTH = 8  # successive samples of each chain
BLOCK = 64  # scenes in one block
LARGEST_RATE = 1e3  # m/s and rad/s
LARGEST_ERROR = 1.0  # of the constraint, m and rad
MOVING = [*range(7, 13), *range(20, layout.NSAMPLE)]  # twists and loads


class Stepper(Protocol):
    """Protocol of a connector with replaceable memory; :class:`Connector` implements it."""

    memory: Array

    def step(self, sample: Array, h: float = 0.0, out: Array | None = None) -> Array:
        """Process one sample; returns the output (NOUT,)."""


@dataclasses.dataclass
class SampledBlock:
    """A block of samples, and the scene, chain and index of each sample."""

    block: Block
    number: NDArray[np.intp]  # (n,) of the scene
    chain: NDArray[np.intp]  # (n,) of the initial sample
    index: NDArray[np.intp]  # (n,) in the chain


def blocks_for(samples: int) -> int:
    """Number of blocks with at least ``samples`` samples."""
    return max(1, -(-samples // (BLOCK * CHAINS * LENGTH)))


def blocks(
    seed: int, number: int, method: str, make: Callable[[Scene], Stepper] = Connector
) -> Iterator[SampledBlock]:
    """Samples of the block of scenes ``number``, one part for each index in the chains.

    The samples depend on the seed and the block's number only, so each block is reproducible alone.
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
    for _ in range(60):  # reduce speeds and loads that lead out of reach
        rows = random_states.out_of_reach(p, frozen(p, state_of(p, sample, past), sample))
        sample[np.ix_(rows, MOVING)] *= 0.5
    connectors = [make(scene) for scene in scenes]
    memory = [connector.memory for connector in connectors for _ in range(CHAINS)]
    for index in range(LENGTH):
        out = np.empty((len(of), layout.NOUT))
        for row, at in enumerate(of):
            connector = connectors[at]
            connector.memory = memory[row]
            connector.step(sample[row], out=out[row])
            memory[row] = connector.memory
        o = state_of(p, sample, past)
        block = Block(at_sample(p, o), tables, sample, out, past)
        found = substituted(scenes, of, block.parameters, o, sample, out, None, method)
        block = block_of(block, found)
        yield SampledBlock(block, np.asarray(numbers)[of], chain, np.full(len(of), index))
        sample, past = _next(rng, block, names)


def _next(rng: Random, block: Block, names: NDArray[np.str_]) -> tuple[Array, History]:
    """The samples after the outputs of a block, and their history."""
    p, sample, out = block.parameters, block.sample, block.out
    o = state_of(p, sample, block.past)
    b = bounds_of(block, o, prepare_step(p, o, sample))
    d, d_size = elastic.next_elastic_slip(p, o, block.past, out)
    past = next_bounds_history(p, o, next_history(p, o, block.past, out), b, out)
    past = dataclasses.replace(past, elastic=d, elastic_size=d_size)
    s = frozen(p, o, sample)
    moved = sample.copy()
    for body, m, half, inverse, gain, at, wrench in (
        (p.a, o.a, s.half_a, s.inverse_a, s.gain_a, layout.A_POSE, layout.FORCE_A),
        (p.b, o.b, s.half_b, s.inverse_b, s.gain_b, layout.B_POSE, layout.FORCE_B),
    ):
        force, torque = applied_wrench(p, body, m.orientation, half, out[:, wrench : wrench + 6])
        h = p.h[:, None]
        velocity = m.velocity + gain[:, :3] + h * body.inverse_mass[:, None] * force
        spin = m.spin + gain[:, 3:] + h * rigid.out_of(inverse, torque)
        velocity, spin = _bounded(velocity), _bounded(spin)
        com = m.com + 0.5 * h * (m.velocity + velocity)
        q = rigid.turned(m.orientation, 0.5 * h * (m.spin + spin))
        arm = rigid.out_of(rigid.matrix(q), body.com)
        random_states.put(moved, at, com - arm, q, velocity - np.cross(spin, arm), spin)
    o = state_of(p, moved, past)
    far = rigid.norm(o.error[:, :2]) > LARGEST_ERROR  # the coarse step left the constraint
    far |= rigid.norm(o.error[:, 2:]) > LARGEST_ERROR
    moved[far] = sample[far]
    fresh = moved.copy()
    random_states.load(rng, p, fresh, names)
    change = rng.random(len(moved)) < 0.25
    moved[change, layout.LOADS] = fresh[change, layout.LOADS]
    far = random_states.out_of_reach(p, frozen(p, state_of(p, moved, past), moved))
    moved[far] = sample[far]
    return moved, past


def _bounded(v: Array) -> Array:
    """Limit the length of vectors to LARGEST_RATE, as a coarse step can diverge."""
    size = rigid.norm(v)
    return np.asarray(
        v
        * np.where(size > LARGEST_RATE, LARGEST_RATE / np.where(size > 0, size, 1.0), 1.0)[:, None]
    )
