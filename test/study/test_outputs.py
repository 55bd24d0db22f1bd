"""Outputs of a simulation by name, against the columns of the whole run."""

import math

import numpy as np
import pytest
from scenes import bundled

import cylconn_ros as cr
from cylconn_ros.core import layout
from cylconn_ros.errors import StudyError
from cylconn_ros.simulation.simulate import simulate_blocks
from cylconn_ros.study.outputs import DEFAULT, NAMED, REDUCTIONS, Outputs

DURATION = 4.5  # s: three blocks of the loop


@pytest.fixture(scope="module")
def run() -> cr.Run:
    return cr.simulate(bundled("demo"), DURATION)


def test_reductions_are_those_of_the_whole_run(run: cr.Run) -> None:
    fields = ("displacement", "velocity[1]", "pose_b[2]", "force_b[0]", "energy")
    found = Outputs([f"{f}.{r}" for f in fields for r in REDUCTIONS]).reduce(
        simulate_blocks(run.scene, DURATION)
    )
    for field in fields:
        name, _, component = field.rstrip("]").partition("[")
        values = run[name][:, int(component)] if component else run[name]
        exact = {
            "start": values[0], "end": values[-1], "min": values.min(), "max": values.max(),
            "maxabs": np.abs(values).max(), "range": values.max() - values.min(),
            "time_of_max": run.time[np.argmax(values)],
        }  # fmt: skip
        assert {r: found[f"{field}.{r}"] for r in exact} == exact
        assert found[f"{field}.mean"] == pytest.approx(values.mean(), rel=1e-12)
        assert found[f"{field}.rms"] == pytest.approx(math.sqrt((values**2).mean()), rel=1e-12)


def test_named_outputs(run: cr.Run) -> None:
    found = Outputs(list(NAMED)).reduce(simulate_blocks(run.scene, DURATION))
    assert found["stop_time"] == pytest.approx(3.53956, abs=1e-4)  # s
    assert (found["jam"], found["usable"], found["refused"]) == (False, True, 0)
    assert "stopped" in found["flags"]
    assert found["energy_lost"] == run.energy[0] - run.energy[-1]
    assert found["slip_share"] == pytest.approx(np.mean(run["regime"] == layout.SLIP))
    assert math.isnan(found["jam_time"])


def test_a_jam_is_found() -> None:
    scene = bundled("jam")
    found = Outputs(["jam", "jam_time"]).reduce(simulate_blocks(scene, 0.2))
    flags = cr.simulate(scene, 0.2)["flags"].astype(int)
    assert found["jam"]
    assert found["jam_time"] == pytest.approx(np.argmax(flags & layout.JAMMED > 0) * scene.period)


def test_motions_without_wrenches_have_the_same_outputs() -> None:
    scene = bundled("coast").replace({"method": "minimal"})
    found = Outputs(DEFAULT).reduce(simulate_blocks(scene, 0.5))
    run = cr.simulate(scene, 0.5)
    assert found["displacement.end"] == run["displacement"][-1]


def test_a_vector_is_a_column_a_component() -> None:
    assert list(Outputs(["offset.end", "jam"]).types) == ["offset[0].end", "offset[1].end", "jam"]


def test_accelerations_go_on_from_block_to_block(run: cr.Run) -> None:
    """The last sample has none: its period is not part of the run."""
    names = [f"{f}.{r}" for f in ("acceleration", "angular_acceleration") for r in REDUCTIONS]
    found = Outputs(names).reduce(simulate_blocks(run.scene, DURATION))
    for field in ("acceleration", "angular_acceleration"):
        values = run[field][:-1]
        assert found[f"{field}.start"] == values[0]
        assert found[f"{field}.end"] == values[-1]
        assert found[f"{field}.maxabs"] == np.abs(values).max()
        assert found[f"{field}.time_of_max"] == run.time[np.argmax(values)]
        assert found[f"{field}.mean"] == pytest.approx(values.mean(), rel=1e-9, abs=1e-12)
    alone = Outputs(["acceleration.max", "acceleration.mean"]).reduce(
        simulate_blocks(run.scene, 0.0)
    )
    assert math.isnan(alone["acceleration.mean"])


@pytest.mark.parametrize("name", ["jamm", "displacement", "displacement.last", "x.end"])
def test_a_name_that_does_not_exist(name: str) -> None:
    with pytest.raises(StudyError, match=f"output {name}: must be one of stop_time, jam, "):
        Outputs([name])
    with pytest.raises(StudyError, match="no component 2"):
        Outputs(["offset[2].end"])
