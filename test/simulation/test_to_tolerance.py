"""A stated tolerance is kept, on random scenes against independent solutions."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scenes import bundled, merged, pair, sleeve

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.reference import free_pair, slide_and_spin
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation import minimal
from cylconn_ros.simulation.simulate import Run, simulate
from cylconn_ros.simulation.to_tolerance import relative_error

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8)


def friction_of(rng: np.random.Generator, greatest: float) -> dict[str, Any]:
    """Friction that neither stops nor jams the scenes below."""
    return {
        "coefficient": float(rng.uniform(0.01, greatest)),
        "radius": float(rng.uniform(0.01, 0.1)),
        "overlap": float(rng.uniform(0.1, 0.4)),
        "preload": float(rng.uniform(0.0, 3.0)),
    }


def sleeves() -> list[Scene]:
    """Random eccentric sleeves sliding and spinning on inclined shafts, some of them to rest."""
    scenes = []
    for seed in range(6):
        rng = np.random.default_rng([seed, 11])
        scenes.append(
            sleeve(
                mass=float(rng.uniform(0.5, 5.0)),
                com=(0.02, float(rng.uniform(0.0, 0.01)), float(rng.uniform(-0.01, 0.01))),
                v=float(rng.uniform(0.5, 2.0)),
                spin=float(rng.uniform(-20.0, 20.0)),
                friction=friction_of(rng, 0.3),
                gravity=[0.0, float(rng.uniform(-2.0, 2.0)), -9.81],
            )
        )
    return scenes


def pairs() -> list[Scene]:
    """Random pairs of free bodies that slide and spin on each other throughout."""
    scenes = []
    for seed in range(6):
        rng = np.random.default_rng([seed, 12])
        scenes.append(
            pair(
                mass_a=float(10.0 ** rng.uniform(0.0, 2.0)),
                v=float(rng.uniform(0.5, 1.0)),
                spin=float(rng.uniform(4.0, 10.0)),
                turning=(float(rng.uniform(-2.0, 2.0)), 1.0, float(rng.uniform(-2.0, 2.0))),
                friction=friction_of(rng, 0.05),
            )
        )
    return scenes


def within(scene: Scene, tolerance: float, duration: float) -> Run:
    """A run of ``duration``, its last sample at the end."""
    asked = dataclasses.replace(scene, tolerance=tolerance)
    return simulate(asked, samples=round(duration / scene.period) + 1)


@pytest.mark.parametrize("number", range(6))
def test_sleeves_against_reduced_equations(number: int) -> None:
    scene = sleeves()[number]
    reference = slide_and_spin(scene, 1.0, 1001)
    right = np.column_stack([reference.l, reference.alpha])
    for tolerance in TOLERANCES:
        run = within(scene, tolerance, 1.0)
        found = np.column_stack([run["displacement"], run["rotation"]])
        assert run.accuracy is not None
        assert run.accuracy.method == "minimal"
        assert relative_error(found, right) <= tolerance


@pytest.mark.parametrize("number", range(6))
def test_pairs_against_newton_and_euler(number: int) -> None:
    scene = pairs()[number]
    reference = free_pair(scene, 0.3)
    right = np.array([[0.0, 0.0], [reference.distance, reference.angle]])
    for tolerance in TOLERANCES:
        run = within(scene, tolerance, 0.3)
        found = np.array([[0.0, 0.0], [run[n][-1] for n in ("displacement", "rotation")]])
        assert relative_error(found, right) <= tolerance


def test_substeps_where_minimal_does_not_serve(monkeypatch: pytest.MonkeyPatch) -> None:
    """An imposed spin on two free bodies: against the same with many more substeps."""

    def crowded(*given: Any) -> Any:
        return dataclasses.replace(solve(*given), coarse=0.05)

    solve = minimal.solve
    monkeypatch.setattr(minimal, "solve", crowded)
    imposed = merged({"friction": friction_of(np.random.default_rng(1), 0.05)},
                     {"command": {"spin": {"velocity": 6.0}}})  # fmt: skip
    scene = pair(spin=6.0, **imposed)
    best = dataclasses.replace(scene, period=scene.period / 128.0)
    right = simulate(best, samples=128 * 100 + 1)
    right_at = right.outs[::128, [layout.LENGTH, layout.ANGLE]]
    counts = []
    for tolerance in (1e-3, 1e-8):
        run = within(scene, tolerance, 0.1)
        assert run.accuracy is not None
        assert run.accuracy.method == "impulse"
        counts.append(run.accuracy.substeps)
        found = run.outs[:, [layout.LENGTH, layout.ANGLE]]
        assert relative_error(found, right_at) <= max(tolerance, 2e-8)  # its own error
        assert f"{counts[-1]} substeps" in str(run.accuracy)
    assert counts[1] > counts[0], "more accuracy takes more substeps"


def test_where_minimal_gives_up_impulse_takes_over(monkeypatch: pytest.MonkeyPatch) -> None:
    def gives_up(*_: Any) -> None:
        raise RuntimeError("stopped at t = 0.1 s")

    scene = sleeves()[0]
    exact = within(scene, 1e-8, 0.2).outs[:, [layout.LENGTH, layout.ANGLE]]
    monkeypatch.setattr(minimal, "solve", gives_up)
    run = within(scene, 1e-4, 0.2)
    assert run.accuracy is not None
    assert run.accuracy.method == "impulse"
    assert relative_error(run.outs[:, [layout.LENGTH, layout.ANGLE]], exact) <= 1e-4


def test_a_connector_with_a_tolerance_uses_impulse() -> None:
    scene = bundled("demo")
    for tolerance in (0.0, 1e-2, 1e-6):
        assert Connector(dataclasses.replace(scene, tolerance=tolerance)).method == "impulse"


def test_a_connector_refuses_an_offline_method() -> None:
    scene = dataclasses.replace(bundled("demo"), method="minimal")
    with pytest.raises(SceneError, match="method = 'minimal': simulates whole motions offline"):
        Connector(scene)


def test_method_minimal_simulates_the_motion() -> None:
    """The states are those of the offline solution; impulse processes its samples."""
    scene = dataclasses.replace(bundled("demo"), method="minimal")
    run = simulate(scene, samples=101)
    assert run.accuracy is not None
    assert (run.accuracy.method, run.connector.method) == ("minimal", "impulse")
    times = scene.period * np.arange(102)
    whole = minimal.solve(scene, float(times[-1]), times=times)
    np.testing.assert_array_equal(run.states, whole.states[:-1])
    assert not run.outs[:, layout.STATUS].any()


def test_what_cannot_be_promised_is_refused() -> None:
    settings = bundled("demo").parameters() | {"tolerance": 1e-6}
    unknown = settings | {"body_b.kind": "unknown", "penalty.stiffness": 1e5}
    with pytest.raises(SceneError, match="inertia of body_b is unknown"):
        Scene.from_parameters(unknown | {"penalty.damping": 1e2})
    with pytest.raises(SceneError, match="the accuracy of baumgarte follows from the period"):
        Scene.from_parameters(settings | {"method": "baumgarte"})


def test_relative_error_is_over_the_way() -> None:
    reference = np.array([[1.0, 0.0], [3.0, 0.0]])
    assert relative_error(reference + [[0.0, 0.1], [0.2, 0.0]], reference) == pytest.approx(0.1)
    assert math.isclose(relative_error(reference, reference), 0.0)
