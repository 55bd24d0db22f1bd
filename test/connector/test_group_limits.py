"""Stops and drives of connectors that share bodies: what holds for one holds for a group."""

import math

import numpy as np
import pytest

import cylconn_ros as cr
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import load_all
from cylconn_ros.simulation.group import GroupRun, simulate_group

UPRIGHT, LEVEL = (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)), (0.0, 0.0, 0.0, 1.0)
WEIGHT = 20.0 * 9.81
NO_STOP = cr.Stops()


def _rail(
    y: float, stops: cr.Stops = NO_STOP, mu: float = 0.0, axes: tuple[float, ...] = UPRIGHT,
    command: cr.Command | None = None,
) -> cr.Scene:  # fmt: skip
    """A rail beside the mass centre of a body of 20 kg."""
    friction = cr.Friction(coefficient=mu, radius=0.02, overlap=0.1) if mu > 0.0 else cr.Friction()
    return cr.Scene(
        period=1e-3,
        body_a=cr.Body(kind="fixed", frame="frame"),
        body_b=cr.Body(kind="free", frame="body", mass=20.0, inertia=(0.01, 0, 0, 0.02, 0, 0.02)),
        node_a=cr.Node(position=(0.0, y, 0.0), orientation=axes),
        node_b=cr.Node(position=(0.0, y, 0.0)),
        stops=stops,
        friction=friction,
        command=command or cr.Command(),
    )


def _flags(run: GroupRun) -> int:
    return int(np.bitwise_or.reduce(run.outs[:, :, layout.FLAGS].astype(int).ravel()))


@pytest.mark.parametrize("mu", [0.0, 0.05, 0.2])
def test_a_stop_of_one_rail_bounces_and_rests_as_that_of_a_single_one(mu: float) -> None:
    """Fall of 1 m, restitution 0.8: 0.64 m, at rest after 9 times the fall."""
    stop = cr.Stops(l_min=-1.0, restitution=0.8)
    run = simulate_group([_rail(0.2, stop, mu), _rail(-0.2, NO_STOP, mu)], 4200)
    height = 1.0 + run.outs[:, 0, layout.LENGTH]
    force = run.outs[:, :, layout.FORCE_REACTION]
    time = 1e-3 * np.arange(len(force))
    hop = (time > 0.5) & (time < 1.1)
    if mu == 0.0:
        assert abs(height[hop].max() - 0.64) < 2e-6
    assert height[hop].max() < 0.64 + 2e-6
    rest = 9.0 * math.sqrt(2.0 / 9.81)
    moving = np.abs(force[:, 0] - WEIGHT) > 1e-6
    assert time[moving][-1] <= rest + 1e-3
    assert np.all(force[:, 1] == 0.0)
    if mu > 0.0:
        assert np.all(run.outs[-100:, :, layout.REGIME] == layout.STICK)
        assert np.all(run.outs[-1, :, layout.FORCE_FRICTION] == 0.0)
    assert not _flags(run) & layout.NOT_CONVERGED


@pytest.mark.parametrize("restitution", [0.0, 0.8])
def test_two_stops_at_the_same_place_share_the_weight(restitution: float) -> None:
    stop = cr.Stops(l_min=-1.0, restitution=restitution)
    run = simulate_group([_rail(0.2, stop), _rail(-0.2, stop)], 4200)
    force = run.outs[-100:, :, layout.FORCE_REACTION]
    np.testing.assert_allclose(force, WEIGHT / 2.0, rtol=2e-2)
    np.testing.assert_allclose(force.sum(axis=1), WEIGHT, rtol=1e-9)


def test_an_elastic_stop_of_a_group_keeps_the_energy() -> None:
    stop = cr.Stops(l_min=-0.3, restitution=1.0)
    run = simulate_group([_rail(0.2, stop), _rail(-0.2)], 5000)
    out = run.outs[:, 0]
    energy = 9.81 * out[:, layout.LENGTH] + 0.5 * out[:, layout.VELOCITY] ** 2
    free = run.outs[:, :, layout.FORCE_REACTION].sum(axis=1) == 0.0
    assert np.abs(energy[free]).max() < 1e-9


def test_a_self_locking_pair_of_rails_does_not_gain_energy_at_its_stop() -> None:
    """With 2 mu/L times the arm of 1.2 of an impact has several solutions."""
    stop = cr.Stops(l_min=-1.0, restitution=0.8)
    run = simulate_group([_rail(0.2, stop, 0.3), _rail(-0.2, NO_STOP, 0.3)], 4200)
    out = run.outs[:, 0]
    energy = 9.81 * out[:, layout.LENGTH] + 0.5 * out[:, layout.VELOCITY] ** 2
    free = run.outs[:, :, layout.FORCE_REACTION].sum(axis=1) == 0.0
    assert energy[free].max() < 1e-9
    assert out[-1, layout.LENGTH] == pytest.approx(-1.0, abs=1e-9)


def test_a_drive_of_a_group_pushes_with_its_greatest_force_and_stops_win() -> None:
    motor = cr.Command(slide=cr.Imposed(velocity=1.0, max_force=10.0))
    stop = cr.Stops(l_max=0.2)
    driven = _rail(0.2, NO_STOP, axes=LEVEL, command=motor)
    run = simulate_group([driven, _rail(-0.2, stop, axes=LEVEL)], 3000)
    speed, x = run.outs[:, 0, layout.VELOCITY], run.outs[:, 0, layout.LENGTH]
    np.testing.assert_allclose(speed[:700], 0.5e-3 * np.arange(700), atol=1e-9)
    assert np.abs(run.outs[:, 0, layout.FORCE_REACTION]).max() <= 10.0 * (1.0 + 1e-9)
    assert x.max() < 0.2 + 1e-9
    assert x[-1] == pytest.approx(0.2, abs=1e-9)
    assert run.outs[-1, 1, layout.FORCE_REACTION] == pytest.approx(-10.0, rel=1e-6)


def test_a_stop_wins_over_the_drive_of_the_same_connector_in_a_group() -> None:
    motor = cr.Command(slide=cr.Imposed(velocity=1.0))
    driven = _rail(0.2, cr.Stops(l_max=0.05), axes=LEVEL, command=motor)
    run = simulate_group([driven, _rail(-0.2, axes=LEVEL)], 300)
    assert run.outs[:, 0, layout.LENGTH].max() < 0.05 + 1e-9
    assert run.outs[-1, 0, layout.STOP] == 2.0
    assert int(run.outs[-1, 0, layout.FLAGS]) & layout.DRIVE_BLOCKED


def test_a_stop_that_only_friction_of_another_connector_presses_is_no_contradiction() -> None:
    """A shaft is thrown out of its ring, which friction stops at the end of their travel."""
    scenes = load_all(cr.shipped("telescope_of_two_stages"))
    thrown = {"plant.body_b.load": [0.0] * 6, "plant.body_b.twist": [1.5, 0.0, 0.0, 0.0, 0.0, 0.0]}
    run = simulate_group([scenes["outer"], scenes["inner"].replace(thrown)], 801)
    flags = run.outs[:, :, layout.FLAGS].astype(int)
    assert not (flags & layout.NOT_CONVERGED).any()
    assert run.outs[:, :, layout.RESIDUAL].max() < 1e-12
