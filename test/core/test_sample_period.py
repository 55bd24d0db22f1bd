"""A declared period that the samples contradict: cylconn_ros/core/sample_period.py."""

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled

import cylconn_ros as cr
from cylconn_ros.connector.batch import PeriodInUse
from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.group import Group
from cylconn_ros.core import layout, model
from cylconn_ros.scene.behaviour import Penalty
from cylconn_ros.scene.scene import Scene, load_all
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]
WRENCH_A = slice(layout.FORCE_A, layout.FORCE_A + 6)
WRENCH_B = slice(layout.FORCE_B, layout.FORCE_B + 6)


class Loop:
    """A plant with steps of ``scene.period`` whose connector has another period declared."""

    def __init__(self, scene: Scene, ratio: float) -> None:
        """``ratio``: true period over the declared one."""
        self.plant = Plant(scene)
        self.h = scene.period
        self.connector = Connector(dataclasses.replace(scene, period=scene.period / ratio))
        self.samples: list[Array] = []
        self.intervals: list[float] = []
        self.outs: list[Array] = []
        self.used: list[float] = []

    def run(self, steps: int, stamps: float = 1.0, every: int = 1) -> None:
        """Step on; ``stamps``: their interval, periods. Only each ``every``-th sample is sent."""
        for k in range(steps):
            sample = np.concatenate([self.plant.state, self.plant.loads])
            if k % every == 0:
                interval = self.h * stamps * every if self.samples else 0.0
                out = self.connector.step(sample, interval)
                self.samples.append(sample)
                self.intervals.append(interval)
                self.outs.append(out)
                self.used.append(self.connector.period)
            else:
                out = self.outs[-1]
            self.plant.step(out[WRENCH_A], out[WRENCH_B])

    def worst(self, at: int) -> float:
        """Largest violation after the first 50 samples."""
        return float(max(abs(out[at]) for out in self.outs[50:] or self.outs))


def scene_of(name: str, integration: str = "exact", method: str = "auto") -> Scene:
    return dataclasses.replace(bundled(name), plant_integration=integration, method=method)


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("ratio", [0.2, 2.0, 16.0])
@pytest.mark.parametrize("name", ["demo", "incline_stick", "hub_and_rotor", "near_jam"])
def test_a_wrong_period_is_replaced(name: str, ratio: float, integration: str) -> None:
    """A run with the declared period diverges from a ratio of 2 on; friction holds to 2e-8 m."""
    scene = scene_of(name, integration)
    right, wrong = Loop(scene, 1.0), Loop(scene, ratio)
    right.run(150)
    wrong.run(150)
    used = scene.period / ratio if name == "incline_stick" and ratio < 1.0 else scene.period
    assert wrong.connector.period == pytest.approx(used, rel=1e-12)  # rest confirms nothing
    for at, allowed in ((layout.OFFSET_VIOLATION, 1e-6), (layout.ANGULAR_VIOLATION, 1e-5)):
        assert wrong.worst(at) <= 2.0 * right.worst(at) + allowed
    apart = wrong.plant.state - right.plant.state
    allowed = 5e-4 if ratio == 2.0 else 2e-5  # m; two periods may be a lost sample: one step more
    assert np.abs(apart[[*range(3), *range(13, 16)]]).max() < allowed


@pytest.mark.parametrize("latency", [-1, 0])
@pytest.mark.parametrize("method", ["impulse", "penalty", "augmented_lagrangian", "baumgarte"])
def test_every_method_takes_the_period_in_use(method: str, latency: int) -> None:
    stiffness = 0.05 * 2.0 / 1e-3**2  # 0.05 m/h^2 of the true period
    penalty = Penalty(stiffness=stiffness, damping=300.0)
    scene = dataclasses.replace(scene_of("demo", method=method), penalty=penalty, latency=latency)
    right, wrong = Loop(scene, 1.0), Loop(scene, 3.0)
    right.run(150)
    wrong.run(150)
    assert wrong.connector.period == pytest.approx(scene.period, rel=1e-12)
    assert wrong.worst(layout.OFFSET_VIOLATION) <= 2.0 * right.worst(layout.OFFSET_VIOLATION)


def test_connectors_of_a_group_take_the_same_period() -> None:
    scenes = load_all(cr.shipped("drawer_on_two_rails")).values()
    wrong = Group([dataclasses.replace(scene, period=scene.period / 4.0) for scene in scenes])
    plant, h = Plant(next(iter(scenes))), next(iter(scenes)).period
    for k in range(200):
        samples = np.tile(np.concatenate([plant.state, plant.loads]), (len(scenes), 1))
        outs = wrong.step(samples, h if k else 0.0)
        plant.step(outs[:, WRENCH_A].sum(axis=0), outs[:, WRENCH_B].sum(axis=0))
        assert outs[:, layout.OFFSET_VIOLATION].max() < 1e-5
    assert [c.period for c in wrong.connectors] == pytest.approx([h, h], rel=1e-12)


@pytest.mark.parametrize("stamps", [0.4, 2.0, 3.3])
def test_stamps_of_the_clock_are_no_period(stamps: float) -> None:
    """A simulator of fixed steps at another rate than real time moves by its own period."""
    loop = Loop(scene_of("demo"), 1.0)
    loop.run(200, stamps)
    assert loop.connector.period == loop.h
    assert loop.worst(layout.OFFSET_VIOLATION) < 1e-6


def test_lost_samples_are_no_period() -> None:
    """Three intervals of three periods in succession; the declared period returns at once."""
    loop = Loop(scene_of("demo"), 1.0)
    loop.run(20)
    loop.run(9, every=3)
    loop.run(1)
    assert set(loop.used) == {loop.h}
    loop.run(12, every=2)  # six of them: samples are thinned out
    assert loop.used[-1] == pytest.approx(2.0 * loop.h)
    loop.run(2)
    assert loop.used[-1] == loop.h


def test_a_first_sample_that_is_lost_changes_nothing() -> None:
    loop = Loop(scene_of("demo"), 1.0)
    loop.run(3, every=2)  # the second sample is lost
    loop.run(3)
    assert set(loop.used) == {loop.h}


def test_a_sample_that_cannot_be_used_is_not_compared() -> None:
    """Two of them among the first samples of a simulator at three times the period."""
    loop = Loop(scene_of("demo"), 3.0)
    loop.run(1)
    bad = np.full(layout.NSAMPLE, np.nan)
    kept = loop.connector.memory[model.PERIOD_IN_USE :]
    assert loop.connector.step(bad)[layout.STATUS] == layout.NOT_FINITE
    np.testing.assert_array_equal(loop.connector.memory[model.PERIOD_IN_USE :], kept)
    loop.connector.step(bad, loop.h)
    assert loop.connector.period == pytest.approx(loop.h / 3.0)
    loop.run(10)
    assert loop.connector.period == pytest.approx(loop.h)
    assert loop.worst(layout.OFFSET_VIOLATION) < 1e-6


def test_the_period_in_use_survives_a_restart() -> None:
    loop = Loop(scene_of("demo"), 2.0)
    loop.run(20)
    loop.connector.reset(keep_in_flight=True)
    assert loop.connector.period == pytest.approx(loop.h)
    loop.connector.reset()
    assert loop.connector.period == pytest.approx(0.5 * loop.h)


def test_the_laws_know_the_period_in_use() -> None:
    """The law checker finds for each sample the period that its wrench was computed for."""
    loop = Loop(scene_of("demo"), 3.0)
    loop.run(30)
    periods = PeriodInUse(loop.h / 3.0)
    found = [periods.of(s, h) for s, h in zip(loop.samples, loop.intervals, strict=True)]
    assert found == loop.used
    assert found[0] == pytest.approx(loop.h / 3.0)
    assert found[-1] == pytest.approx(loop.h)
