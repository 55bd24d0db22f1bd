"""An overlap that changes with the slide, and the moving middle of the contact.

References: the equation of one sleeve on a fixed shaft, integrated by SciPy up to its stop. Under
the weight m g across the slot, the moment M about the vertical and the pull F along it

    FN = m g + 2/L sqrt(M^2 + (d m g)^2),    m l'' = F - mu FN
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cylconn_ros as cr
from cylconn_ros.connector.start import start_warnings
from cylconn_ros.core import layout
from cylconn_ros.laws import residuals
from cylconn_ros.laws.runs import simulated
from cylconn_ros.reference.moving_contact import slide
from cylconn_ros.simulation.simulate import simulate

MASS, G, MU, L0 = 2.0, 9.81, 0.1, 0.2
KAPPA = {"body_b": 0.0, "between": 0.5, "body_a": 1.0}
ELASTIC = ("penalty", "augmented_lagrangian")
SIGMA = {"constant": 0.0, "increasing": 1.0, "decreasing": -1.0}


def drawer(
    change: str, centre: str, pull: float = 10.0, moment: float = -1.962, **friction: Any
) -> cr.Scene:
    """A drawer that is pulled beside its rail."""
    return cr.Scene.from_parameters(
        {
            "period": 1e-3,
            "latency": 0,
            "body_b": {"kind": "free", "mass": MASS,
                       "inertia": [0.0016, 0.0, 0.0, 0.0022, 0.0, 0.0022]},
            "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
            "friction": {"coefficient": MU, "radius": 0.01, "overlap": L0,
                         "overlap_change": change, "contact_centre": centre} | friction,
            "plant": {"body_b": {"load": [pull, 0.0, 0.0, 0.0, 0.0, moment]}},
        }
    )  # fmt: skip


def slid(
    change: str, centre: str, duration: float, pull: float = 10.0, moment: float = -1.962
) -> tuple[float, float]:
    """Slide at the end and time of the stop; infinite if it still slides."""

    def rate(_: float, y: np.ndarray) -> list[float]:
        overlap = L0 + SIGMA[change] * y[0]
        bending = 2.0 / overlap * math.hypot(moment, KAPPA[centre] * y[0] * MASS * G)
        return [y[1], (pull - math.copysign(MU * (MASS * G + bending), pull)) / MASS]

    def stops(_: float, y: np.ndarray) -> float:
        return y[1] * math.copysign(1.0, pull)

    stops.terminal, stops.direction = True, -1.0  # type: ignore[attr-defined]
    begin = [0.0, math.copysign(1e-300, pull)]
    found = solve_ivp(rate, (0.0, duration), begin, events=stops, rtol=1e-12, atol=1e-15)
    end = found.t_events[0][0] if len(found.t_events[0]) and found.t[-1] > 0.01 else math.inf
    return float(found.y[0, -1]), float(end)


@pytest.mark.parametrize("centre", KAPPA)
def test_a_drawer_binds_as_it_is_pulled_out(centre: str) -> None:
    """Minimal to its tolerance; impulse with second order up to the stop."""
    place, end = slid("decreasing", centre, 0.5)
    assert 0.36 < end < 0.45
    scene = drawer("decreasing", centre, overlap_min=1e-4)
    exact = cr.simulate(scene.replace({"method": "minimal"}), duration=0.5)
    assert exact["displacement"][-1] == pytest.approx(place, abs=1e-9)
    assert exact["velocity"][-1, 0] == 0.0
    errors = []
    for h in (2e-3, 1e-3, 5e-4):
        run = cr.simulate(scene.replace({"period": h}), duration=0.3)
        at = cr.simulate(scene.replace({"period": h, "method": "minimal"}), duration=0.3)
        errors.append(abs(run["displacement"][-1] - at["displacement"][-1]))
        stopped = cr.simulate(scene.replace({"period": h}), duration=0.5)
        assert stopped["displacement"][-1] == pytest.approx(place, abs=4e-4 * h / 1e-3)
        assert abs(stopped["velocity"][-1, 0]) < 1e-15
        assert stopped["regime"][-1] == layout.STICK
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 1.9)


def test_the_published_drawer_binds_where_the_closed_form_says() -> None:
    """With the middle of the contact fixed in B: 0.1964 m after 0.396 s."""
    place, end = slid("decreasing", "body_b", 0.5)
    assert (round(place, 4), round(end, 3)) == (0.1964, 0.396)


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [("impulse", 1e-5), ("baumgarte", 1e-3), ("penalty", 4e-3), ("augmented_lagrangian", 4e-3)],
)
def test_a_rod_that_is_pushed_in_slides_farther(method: str, tolerance: float) -> None:
    """Beside the same rod with a constant overlap: a method's own error at the start drops out."""
    gains = {
        "penalty.stiffness": 1e5, "penalty.damping": 300.0, "penalty.rotational_stiffness": 200.0,
        "penalty.rotational_damping": 0.6, "penalty.stick_stiffness": 1e4,
    }  # fmt: skip
    gains = gains if method in ELASTIC else {}
    places, expected = [], []
    for change in ("increasing", "constant"):
        scene = drawer(change, "between", pull=6.5).replace({"method": method} | gains)
        places.append(cr.simulate(scene, duration=0.4)["displacement"][-1])
        expected.append(slid(change, "between", 0.4, pull=6.5)[0])
    assert places[0] / places[1] == pytest.approx(expected[0] / expected[1], rel=tolerance)
    assert expected[0] > 1.05 * expected[1]


@pytest.mark.parametrize("change", ["increasing", "decreasing"])
def test_observe_sees_the_coefficient_along_the_motion(change: str) -> None:
    scene = drawer(change, "between", overlap_min=1e-4)
    moved = simulate(scene.replace({"method": "minimal"}), 0.35)
    observer = cr.Connector(scene.replace({"method": "observe"}))
    rows = np.zeros((len(moved.states), layout.NSAMPLE))
    rows[:, layout.MOTION], rows[:, layout.LOADS] = moved.states, moved.plant.loads
    seen = observer.run(rows)
    sliding = seen[:, layout.SLIP_RATE] > 0.05
    assert sliding.sum() > 200
    assert np.abs(seen[sliding, layout.FRICTION_COEFFICIENT] - MU).max() < 2e-4


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("centre", KAPPA)
@pytest.mark.parametrize("change", ["increasing", "decreasing"])
def test_the_laws_hold(change: str, centre: str, integration: str) -> None:
    scene = drawer(change, centre, overlap_min=1e-4).replace(
        {"plant_integration": integration, "plant.body_b.twist": [0.3, 0, 0, 4.0, 0, 0],
         "body_b.com": [0.02, 0.01, 0.0], "stops.l_max": 0.1, "stops.restitution": 0.5}
    )  # fmt: skip
    run = simulate(scene, 0.3)
    loads = tuple(float(x) for x in run.plant.loads)
    samples = simulated(scene, "impulse", run.states, run.outs, loads)
    for block, _ in samples.blocks():
        found = residuals.check(block)
        assert {
            law: worst for law, r in found.items() if (worst := np.max(np.nan_to_num(r))) > 1e-12
        } == {}


def test_what_comes_apart_is_flagged_and_a_full_insertion_ends_the_change() -> None:
    scene = drawer("decreasing", "body_b", moment=0.0, overlap_min=0.15)
    run = cr.simulate(scene, duration=0.3)
    apart = (run["flags"].astype(int) & layout.DISENGAGED) != 0
    middle = run["displacement"] + 0.5e-3 * run["velocity"][:, 0]
    assert np.array_equal(apart, middle > 0.05 + 1e-12)
    assert apart.any()
    assert not apart.all()
    bent = drawer("increasing", "body_b", pull=12.0, overlap_max=0.21)
    outs = cr.simulate(bent, duration=0.4)
    inserted = outs["displacement"] > 0.0101
    lever = outs["bending_force"][inserted] / outs["bending_moment"][inserted]
    assert inserted.any()
    assert lever == pytest.approx(2.0 / 0.21, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"overlap": 0.0}, "overlap_change = 'decreasing': needs friction.overlap > 0"),
        ({"overlap_min": 0.3}, r"must be from friction.overlap_min \(0.3 m\)"),
        ({"overlap_max": 0.1}, r"to friction.overlap_max \(0.1 m\) if it changes"),
        ({"overlap_min": -0.1}, r"overlap_min = -0.1: must be a number > 0"),
    ],
)
def test_impossible_overlaps_are_refused(changes: dict[str, float], words: str) -> None:
    with pytest.raises(cr.SceneError, match=words):
        drawer("decreasing", "body_b", **changes)


@pytest.mark.parametrize("method", ["impulse", "minimal"])
def test_a_start_apart_is_refused_with_its_numbers(method: str) -> None:
    scene = drawer("decreasing", "body_b", overlap_at=0.0).replace(
        {"method": method, "plant.body_b.pose": [0.25, 0, 0, 0, 0, 0, 1.0]}
    )
    words = r"starts at 0.25 m with an overlap of -0.05 m, below friction.overlap_min \(0.001 m\)"
    with pytest.raises(cr.SceneError, match=words):
        cr.simulate(scene, duration=0.01)
    turned = {"node_a.orientation": [0.0, 0.0, 1.0, 0.0]}  # e1 the other way: the slide is -0.25 m
    cr.simulate(scene.replace(turned), duration=0.01)


def test_a_foreign_simulator_that_starts_apart_is_warned_of() -> None:
    scene = drawer("decreasing", "body_b", overlap_at=-0.25)
    connector = cr.Connector(scene)
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.A_POSE + 6] = sample[layout.B_POSE + 6] = 1.0
    assert start_warnings(connector) == []
    connector.step(sample)
    (warning,) = start_warnings(connector)
    assert "with an overlap of -0.05 m" in warning


def test_the_state_has_overlap_and_middle() -> None:
    """Those of the step: the bending force is 2 Mbend over this overlap, also where it is held."""
    scene = drawer("increasing", "between", pull=12.0, overlap_max=0.205)
    run = cr.simulate(scene, duration=0.3)
    middle = run["displacement"] + 0.5e-3 * run["velocity"][:, 0]
    np.testing.assert_allclose(run["overlap"], np.minimum(0.2 + middle, 0.205), rtol=1e-14)
    moved = np.minimum(middle, 0.005)  # fully inserted, the middle stays with B's bearing
    np.testing.assert_allclose(run["contact_centre"], -0.5 * moved, rtol=1e-12)
    assert run["overlap"][-1] == 0.205
    pressed = 2.0 * run["bending_moment"] / run["overlap"]
    np.testing.assert_allclose(run["bending_force"], pressed, rtol=1e-14)
    constant = cr.simulate(
        scene.replace({"friction.overlap_change": "constant", "friction.contact_centre": "auto"}),
        duration=0.01,
    )
    assert set(constant["overlap"]) == {0.2}
    assert not constant["contact_centre"].any()


def test_beyond_full_insertion_the_middle_stays_with_the_bearing_of_b() -> None:
    """Minimal and impulse against the integrated reference, across the change of slope."""
    scene = drawer("increasing", "between", pull=8.0, moment=0.0, overlap_max=0.22)
    expected = slide(scene, 0.6)
    exact = cr.simulate(scene.replace({"method": "minimal"}), duration=0.6)
    assert expected.distance > 0.08
    assert exact["displacement"][-1] == pytest.approx(expected.distance, abs=1e-7)
    run = cr.simulate(scene, duration=0.6)
    assert run["displacement"][-1] == pytest.approx(expected.distance, abs=3e-6)
    assert run["contact_centre"][-1] == pytest.approx(-0.01, abs=1e-15)
    for_samples = simulate(scene, 0.6)
    loads = tuple(float(x) for x in for_samples.plant.loads)
    samples = simulated(scene, "impulse", for_samples.states, for_samples.outs, loads)
    for block, _ in samples.blocks():
        assert max(np.max(np.nan_to_num(r)) for r in residuals.check(block).values()) < 1e-12


def test_a_constant_overlap_knows_no_bounds() -> None:
    """Shorter than overlap_min, with a middle that moves: as given, and not apart."""
    scene = drawer("constant", "body_a", pull=12.0, moment=0.0, overlap=5e-4, overlap_at=-1e-5)
    run = cr.simulate(scene, duration=0.1)
    assert set(run["overlap"]) == {5e-4}
    assert not (run["flags"].astype(int) & layout.DISENGAGED).any()
    pressed = 2.0 * run["bending_moment"] / 5e-4
    np.testing.assert_allclose(run["bending_force"], pressed, rtol=1e-14)
    assert run["displacement"][-1] == pytest.approx(slide(scene, 0.1).distance, rel=1e-3)
