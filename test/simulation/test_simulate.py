"""simulate() and sweep(): what a run contains, its end, its columns; the loop step by step."""

import math

import numpy as np
import pytest

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
