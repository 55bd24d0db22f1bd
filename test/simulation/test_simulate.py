"""simulate() and sweep(): what a run contains, its end, its columns; the loop step by step."""

import math

import numpy as np
import pytest
from scenes import sleeve

import cylconn_ros as cr
from cylconn_ros.core import layout
from cylconn_ros.simulation.plant import Plant


@pytest.fixture(scope="module")
def scene() -> cr.Scene:
    return cr.load(cr.shipped("demo"))


def test_a_run_includes_its_end(scene: cr.Scene) -> None:
    run = cr.simulate(scene, duration=1.0)
    assert run.time[0] == 0.0
    assert run.time[-1] == 1.0
    assert len(run) == 1001 == len(run["displacement"])
    assert repr(run) == "Run(1001 samples, 0 to 1 s)"
    assert cr.simulate(scene, samples=5).time.tolist() == [0.0, 0.001, 0.002, 0.003, 0.004]
    assert len(cr.simulate(scene, duration=0.0)) == 1
    short = scene.replace({"plant.duration": 0.25})
    assert cr.simulate(short).time[-1] == 0.25


def test_a_duration_must_be_finite(scene: cr.Scene) -> None:
    with pytest.raises(cr.SceneError, match="duration = 'x': must be a number of seconds"):
        cr.simulate(scene, duration="x")  # type: ignore[arg-type]
    for duration in (math.inf, math.nan, -1.0):
        with pytest.raises(cr.SceneError, match="must be finite and >= 0"):
            cr.simulate(scene, duration=duration)
    with pytest.raises(cr.SceneError, match=r"plant\.duration"):
        cr.simulate(scene.replace({"plant.duration": math.inf}))
    with pytest.raises(cr.SceneError, match=r"period = 0.0"):
        cr.simulate(scene.replace({"period": 0.0}), duration=1.0)
    with pytest.raises(ValueError, match="samples = 3"):
        cr.simulate(scene, 1.0, samples=3)


def test_the_compiled_loop_is_the_two_steps_in_turn(scene: cr.Scene) -> None:
    run = cr.simulate(scene, samples=300)
    plant, connector = Plant(scene), cr.Connector(scene)
    for k in range(300):
        assert run.states[k].tolist() == plant.state.tolist()
        out = connector.step(np.concatenate([plant.state, plant.loads]))
        assert run.outs[k].tolist() == out.tolist()
        plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
    assert run.plant.state.tolist() == plant.state.tolist()
    assert run.plant.time_ns == plant.time_ns


def test_columns_by_name(scene: cr.Scene) -> None:
    run = cr.simulate(scene, duration=0.1)
    for name in run.names:
        assert len(run[name]) == len(run), name
    assert run["pose_b"].shape == (101, 7)
    assert run["offset"].shape == (101, 2)
    with pytest.raises(cr.UnknownNameError, match="dispalcement: no such name; there are time, "):
        run["dispalcement"]
    with pytest.raises(KeyError):
        run["x"]


def test_acceleration_is_that_of_the_forces_of_the_same_row() -> None:
    """M a = f1 + load and I a = m1, row by row, for a sleeve on a fixed shaft."""
    inertia = [0.002, 0.0, 0.0, 0.004, 0.0, 0.004]
    scene = sleeve(
        mass=2.0, inertia=inertia, v=0.5, spin=3.0, gravity=[-1.5, 0.0, -9.81],
        elasticity={"k1": 80.0}, damping={"cr1": 1e-4},
        friction={"coefficient": 0.1, "radius": 0.02},
    )  # fmt: skip
    run = cr.simulate(scene, duration=0.3)
    along = run["force"][:, 0] - 2.0 * 1.5
    np.testing.assert_allclose(2.0 * run["acceleration"][:-1], along[:-1], atol=1e-9)
    np.testing.assert_allclose(0.002 * run["angular_acceleration"][:-1], run["moment"][:-1, 0],
                               atol=1e-9)  # fmt: skip
    assert np.isnan(run["acceleration"][-1])


def test_acceleration_in_the_middle_of_the_period_is_second_order() -> None:
    """An oscillator, u1 = (v/w) sin(w t): a = -v w sin(w (t + h/2))."""
    omega, errors = 20.0, []
    for h in (4e-3, 2e-3, 1e-3):
        scene = sleeve(mass=2.0, v=1.0, period=h, gravity=[0.0] * 3,
                       elasticity={"k1": 2.0 * omega**2})  # fmt: skip
        run = cr.simulate(scene, duration=0.4)
        exact = -omega * np.sin(omega * (run.time + 0.5 * h))
        errors.append(np.abs(run["acceleration"] - exact)[:-1].max())
    assert np.log2(errors[0] / errors[1]) > 1.9
    assert np.log2(errors[1] / errors[2]) > 1.9


def test_progress_ends_with_everything_done(scene: cr.Scene) -> None:
    calls: list[tuple[int, int]] = []
    cr.simulate(scene, samples=5000, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (5000, 5000)
    assert [done for done, _ in calls] == sorted({done for done, _ in calls})


def test_a_sweep_gives_the_runs_of_single_simulations(scene: cr.Scene) -> None:
    vary = {"friction.coefficient": [0.1, 0.2], "body_b.mass": [1.0, 2.0, 3.0]}
    runs = cr.sweep(scene, vary, duration=0.2, workers=2)
    assert [(r.scene.friction.coefficient, r.scene.body_b.mass) for r in runs] == [
        (mu, mass) for mu in (0.1, 0.2) for mass in (1.0, 2.0, 3.0)
    ]
    for run in runs:
        assert run.outs.tolist() == cr.simulate(run.scene, duration=0.2).outs.tolist()
    assert cr.sweep(scene, {"friction.coefficient": []}) == []


def test_a_sweep_checks_every_scene_before_the_first_run(scene: cr.Scene) -> None:
    ran: list[int] = []
    with pytest.raises(cr.SceneError, match=r"friction.coefficient = -1.0"):
        cr.sweep(
            scene,
            {"friction.coefficient": [0.1, -1.0]},
            duration=0.1,
            progress=lambda done, _: ran.append(done),
        )
    assert ran == []


def test_a_dataframe_has_the_columns(scene: cr.Scene) -> None:
    run = cr.simulate(scene, duration=0.1)
    frame = run.to_dataframe()
    assert frame.index.name == "time"
    assert frame["offset[1]"].to_numpy().tolist() == run["offset"][:, 1].tolist()
    assert frame["regime"].dtype == np.int64
