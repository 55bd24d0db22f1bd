"""Sleeves whose contact moves: the references agree, and every order is measured."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import bundled, with_period

from cylconn_ros.core import layout
from cylconn_ros.reference import library
from cylconn_ros.reference.answers import stop_time
from cylconn_ros.reference.moving_contact import slide
from cylconn_ros.simulation.minimal import solve
from cylconn_ros.simulation.simulate import simulate

MOVING = ("drawer_binds", "telescope_binds", "telescope_pushed_in", "piston_rod")


@pytest.mark.parametrize("name", ["telescope_binds", "piston_rod", "sledge", "hydraulic_ram"])
def test_the_integration_has_the_closed_form(name: str) -> None:
    scene = bundled(name)
    end = scene.plant.duration
    found = slide(scene, end)
    expected = {each.name: each.value for each in library.expected(name, scene, end)}
    assert found.distance == pytest.approx(expected["distance"], abs=1e-10)
    if "stop time" in expected:
        assert found.stop_time == pytest.approx(expected["stop time"], abs=1e-9)
    else:
        assert found.velocity == pytest.approx(expected.get("velocity", 0.0), abs=1e-9)


@pytest.mark.parametrize("name", MOVING)
def test_minimal_keeps_to_the_reference(name: str) -> None:
    scene = bundled(name).replace({"method": "minimal"})
    end = scene.plant.duration
    found, expected = solve(scene, end), slide(scene, end)
    moved = found.length[-1] - found.length[0]
    assert moved == pytest.approx(expected.distance, abs=1e-9)
    assert found.stop_time == pytest.approx(expected.stop_time, abs=1e-8)


@pytest.mark.parametrize("name", MOVING)
def test_slide_and_stop_time_are_second_order(name: str) -> None:
    """Errors over three halvings of the period, 4 ms to 0.5 ms; of the slide before the stop."""
    scene = bundled(name)
    stop = slide(scene, scene.plant.duration).stop_time
    before = 4e-3 * math.floor(0.8 * min(stop, scene.plant.duration) / 4e-3)
    expected = slide(scene, before).distance
    far, late = [], []
    for period in (4e-3, 2e-3, 1e-3, 5e-4):
        run = simulate(with_period(scene, period))
        far.append(abs(run["displacement"][round(before / period)] - expected))
        late.append(abs(stop_time(run) - stop))
    for errors in (far, late) if math.isfinite(stop) else (far,):
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert np.all(orders > 1.85), (errors, orders)


def test_a_jammed_telescope_moves_under_no_pull_at_its_mass_centre() -> None:
    """Below the overlap Lj = 60 mm; a push on its axis frees it, and so does any overlap above."""
    scene = bundled("telescope_pushed_in").replace({"plant.duration": 0.05})
    for slid, pull, moves in ((0.245, 1e4, False), (0.22, 1e4, True)):
        pose = [slid, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        load = [pull, 0.0, 0.0, 0.0, -0.15 * pull, 0.0]  # through the mass centre
        out = scene.replace({"plant.body_b.pose": pose, "plant.body_b.load": load})
        run = simulate(out)
        assert (run["displacement"][-1] > 0.01) == moves  # as far as to the overlap Lj
        assert run.outs[-1, layout.REGIME] == layout.STICK
        pushed = simulate(out.replace({"plant.body_b.load": [-6.0, 0, 0, 0, 0, 0]}))
        assert pushed["displacement"][-1] < -1e-3
