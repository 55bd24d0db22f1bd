"""Sweeps of several connectors: columns and outputs by connector, rows again as recordings."""

from pathlib import Path

import numpy as np
import pytest

import cylconn_ros as cr
from cylconn_ros.cli.main import main
from cylconn_ros.core import layout
from cylconn_ros.errors import StudyError
from cylconn_ros.scene.scene import Scene, load_all
from cylconn_ros.simulation.group import simulate_group
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.page import sweep_page
from cylconn_ros.study.rows import axis_of, combine
from cylconn_ros.study.sweep import Sweep

SCENE = "drawer_on_two_rails"
VARY = {"left.friction.coefficient": [0.05, 0.3], "right.friction.radius": [0.01, 0.02, 0.03]}
OUTPUTS = ["displacement.end", "right.normal_force.max", "energy_lost", "jam"]
MASS, SPEED, GRAVITY, DURATION = 12.0, 0.7, 9.81, 0.05


def scenes() -> dict[str, Scene]:
    return load_all(cr.shipped(SCENE))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    folder = tmp_path_factory.mktemp("study") / "one"
    return cr.sweep(scenes(), VARY, DURATION, output=folder, outputs=OUTPUTS, workers=1, chunk=4)


def test_an_output_without_a_connector_is_one_of_each(done: Sweep) -> None:
    columns = done.to_dataframe().columns.tolist()
    assert columns[5:] == [
        "left.displacement.end", "left.energy_lost", "left.jam",
        "right.displacement.end", "right.normal_force.max", "right.energy_lost", "right.jam",
    ]  # fmt: skip
    assert "left.normal_force.max" not in columns


def test_a_row_is_the_drawer_slowed_by_the_friction_of_its_own_rails(done: Sweep) -> None:
    """Each rail carries half of the weight: a = -g (mu_left + mu_right) / 2, mu_right = 0.02."""
    table = done.to_dataframe()
    assert table["status"].tolist() == 6 * ["ok"]
    for row in table.to_dict("records"):
        slowed = GRAVITY * 0.5 * (row["left.friction.coefficient"] + 0.02)
        moved = -(SPEED * DURATION - 0.5 * slowed * DURATION**2)
        lost = 0.5 * MASS * (SPEED**2 - (SPEED - slowed * DURATION) ** 2)
        for rail in ("left", "right"):
            assert row[f"{rail}.displacement.end"] == pytest.approx(moved, rel=1e-9)
            assert row[f"{rail}.energy_lost"] == pytest.approx(lost, rel=1e-9)
        assert row["right.normal_force.max"] == pytest.approx(0.5 * MASS * GRAVITY, rel=1e-9)


def test_a_row_runs_again_bit_for_bit(done: Sweep) -> None:
    again = done.run(4)
    assert isinstance(again, dict)
    (names, run), *others = again.items()
    assert (names, others) == (("left", "right"), [])
    row = done.to_dataframe().iloc[4]
    assert row["left.displacement.end"] == run.outs[-1, 0, layout.DISPLACEMENT]
    assert done.scenes(4)["right"].friction.radius == row["right.friction.radius"] == 0.02


def test_a_row_becomes_a_recording_that_replays(done: Sweep, tmp_path: Path) -> None:
    again = tmp_path / "again"
    assert main(["sweep", done.dataset.address, "--row", "4", "-o", str(again)]) == 0
    assert main(["replay", str(again), "--compare"]) == 0


def test_blocks_are_those_of_the_whole_run() -> None:
    """A run longer than a block, reduced block by block, has the extremes of the whole one."""
    whole = simulate_group(list(scenes().values()), 2501)
    found = cr.sweep(
        scenes(), {"left.friction.coefficient": [0.02]}, 2.5,
        output="memory://group/study", outputs=["normal_force.max", "velocity[0].time_of_max"],
        workers=1,
    ).to_dataframe()  # fmt: skip
    for c, name in enumerate(("left", "right")):
        force, rate = whole.outs[:, c, layout.NORMAL_FORCE], whole.outs[:, c, layout.VELOCITY]
        assert found[f"{name}.normal_force.max"][0] == force.max()
        assert found[f"{name}.velocity[0].time_of_max"][0] == whole.time[np.argmax(rate)]


def test_the_page_takes_the_connectors_together(done: Sweep) -> None:
    page = sweep_page(Dataset.existing(done.dataset.address))
    assert "0 % of 6 runs jam" in page
    assert "right.friction.radius" in page


@pytest.mark.parametrize(
    ("column", "message"),
    [
        ("middle.friction.radius", r"no such connector \(left, right\)"),
        ("left.access.frozen", "belongs to the node: vary access.frozen"),
        ("left.friction.mu", "no such parameter"),
    ],
)
def test_a_wrong_connector_is_named_before_anything_runs(
    column: str, message: str, tmp_path: Path
) -> None:
    values = [True, False] if column.endswith("frozen") else [0.1, 0.2]
    with pytest.raises(StudyError, match=f"{column}: {message}"):
        cr.sweep(scenes(), {column: values}, output=tmp_path / "out", workers=1)
    assert not (tmp_path / "out").exists()


def test_bodies_that_no_longer_agree_are_a_wrong_row(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"^row 0: .*body_b.mass.*; nothing was run$"):
        cr.sweep(scenes(), {"left.body_b.mass": [1.0, 2.0]}, output=tmp_path / "out", workers=1)


def test_one_number_by_two_names_is_varied_twice() -> None:
    own, of_all = axis_of("left.body_b.com[1]", [0.0, 0.1]), axis_of("body_b.com[1]", [0.0, 0.1])
    with pytest.raises(StudyError, match="is varied twice, also as left"):
        combine([own, of_all])
    other = axis_of("right.body_b.com[1]", [0.0, 0.1])
    assert len(combine([own, other, axis_of("body_b.com[2]", [0.0, 0.1])])) == 8
