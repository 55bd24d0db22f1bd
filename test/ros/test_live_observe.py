"""Node with method ``observe``: forces of a joint that another connector drives, no command."""

from pathlib import Path

import numpy as np
from recorded_loops import scene_arguments
from ros_processes import module, program

from cylconn_ros.core.layout import SLIP
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.table import Table

STEPS = 400
FIELDS = ("force_friction", "moment_friction", "normal_force", "traction")


def recorded(directory: Path) -> Run:
    return read_run(next(directory.iterdir()))


def at(table: Table, stamps: np.ndarray, name: str) -> np.ndarray:
    """A field at the first message of each of ``stamps``."""
    known, first = np.unique(table.stamp, return_index=True)
    return np.asarray(table[name], float)[first][np.searchsorted(known, stamps)]


def test_observer_measures_the_forces_of_another_connector(tmp_path: Path) -> None:
    """Three processes: plant, connector, and a node that only observes.

    The wrench that the observer finds at a sample is that of the interval before it, which the
    connector commanded one sample earlier.
    """
    rules = [f"plant.duration:={STEPS / 1000}", "record.enabled:=true"]
    connector = [*module("connector.node"), *scene_arguments("demo", *rules)]
    looking = [*rules, "method:=observe", "record.directory:=seen"]
    remapped = [f"body_{name}/wrench:=seen/body_{name}/wrench" for name in "ab"]
    renamed = [word for rule in ("__node:=observer", *remapped) for word in ("-r", rule)]
    observer = [*module("connector.node"), *scene_arguments("demo", *looking), *renamed]
    plant = [*module("plant.node"), *scene_arguments("demo", *rules)]
    with program(observer, tmp_path) as watching, program(connector, tmp_path) as connecting:
        watching.wait_for("recording to")
        connecting.wait_for("recording to")
        with program(plant, tmp_path) as moving:
            assert moving.wait() == 0, moving.output
        assert connecting.stop() == 0, connecting.output
        assert watching.stop() == 0, watching.output
    assert "method observe" in watching.output

    acted, seen = recorded(tmp_path / "runs"), recorded(tmp_path / "seen")
    for name in "ab":
        wrench = seen.table(f"/seen/body_{name}/wrench")
        assert not any(np.any(wrench[f"wrench.{part}.{c}"]) for part in ("force", "torque")
                       for c in "xyz")  # fmt: skip
    period = 1_000_000
    stamps = np.unique(seen.state.stamp)[1:]  # the first of a history has no interval before it
    stamps = stamps[np.isin(stamps - period, acted.state.stamp)]
    assert len(stamps) > STEPS // 2
    stamps = stamps[np.isin(stamps - period, seen.state.stamp)]
    for field in FIELDS:
        found, commanded = at(seen.state, stamps, field), at(acted.state, stamps - period, field)
        greatest = np.abs(commanded).max()
        assert np.abs(found - commanded).max() < 5e-3 * greatest, field
    assert (at(seen.state, stamps, "regime") == SLIP).all()
