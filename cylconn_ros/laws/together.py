"""Laws of connectors that share bodies: those of each, the wrenches of the others being known.

The published wrenches of the other connectors act on the shared bodies as loads that are held over
the step. With them, the step of each connector has to satisfy the laws of a single one: its
constraint at the end of the step, friction within its limit and against its slip, stops, balance.
Excluded: impacts, whose forces the others do not have before, and the law "never gains". The
tolerance is that of the iteration which solves the group.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.errors import RecordingError
from cylconn_ros.laws import residuals
from cylconn_ros.laws.balance import applied_wrench
from cylconn_ros.laws.runs import RunSamples, samples_of
from cylconn_ros.laws.sample_state import state_of
from cylconn_ros.laws.step import frozen
from cylconn_ros.laws.summary import LawSummary
from cylconn_ros.recording.files.source import Paths
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene import shared_bodies

Array = NDArray[np.float64]
TOLERANCE = 1e-9  # residual of a solution of the group (methods/coupled/step.py)
WRENCHES = (layout.FORCE_A, layout.FORCE_B)


def add_others(runs: Mapping[str, RunSamples]) -> None:
    """Set ``others`` of the runs of connectors, by name, that share bodies.

    Raises RecordingError if connectors that share a body do not have the same samples.
    """
    scenes = {name: run.scene for name, run in runs.items()}
    applied = {name: _applied(run) for name, run in runs.items()}
    for places in shared_bodies.shared(scenes).values():
        for name, k in places:
            for other, j in places:
                if other == name:
                    continue
                if len(applied[other][j]) != len(runs[name].h):
                    raise RecordingError(
                        f"{name} has {len(runs[name].h)} samples and {other} "
                        f"{len(runs[other].h)}: connectors that share bodies need the same"
                    )
                if runs[name].others is None:
                    runs[name].others = np.zeros((len(runs[name].h), 12))
                total = runs[name].others
                assert total is not None
                total[:, 6 * k : 6 * k + 6] += applied[other][j]


def _applied(run: RunSamples) -> tuple[Array, Array]:
    """(n, 6) force and torque of a connector on A and B about their mass centres, world axes."""
    found: tuple[list[Array], list[Array]] = ([], [])
    for block, _ in run.blocks():
        p, o = block.parameters, state_of(block.parameters, block.sample, block.past)
        s = frozen(p, o, block.sample)
        for k, (body, m, half) in enumerate(((p.a, o.a, s.half_a), (p.b, o.b, s.half_b))):
            wrench = block.out[:, WRENCHES[k] : WRENCHES[k] + 6]
            force, torque = applied_wrench(p, body, m.orientation, half, wrench)
            found[k].append(np.concatenate([force, torque], axis=1))
    return np.concatenate(found[0]), np.concatenate(found[1])


def check(runs: Mapping[str, RunSamples], summary: LawSummary) -> None:
    """Add the residuals of all connectors to ``summary``; locations name connector and sample."""
    add_others(runs)
    for name, run in runs.items():
        part = LawSummary(tolerance=TOLERANCE)
        for block, index in run.blocks():
            part.add(residuals.check(block, run.method), block.out, (index,))
        summary.merge(part.with_prefix(name))


def check_recording(
    paths: Paths, names: list[str], progress: Callable[[int, int], object]
) -> tuple[dict[str, RunSamples], LawSummary]:
    """Check the samples of all connectors of a recorded run; ``progress``: (read, all).

    Raises RecordingError if it cannot be read, or a method has no laws of a sample.
    """
    runs = {}
    for done, name in enumerate(names):
        run = read_run(paths, name)
        runs[name] = samples_of(run)
        if runs[name].method not in residuals.RESIDUALS:
            raise RecordingError(
                f"{run.path}: {name}: no laws of a sample are stated for method {runs[name].method}"
            )
        progress(done, len(names))
    summary = LawSummary(tolerance=TOLERANCE)
    check(runs, summary)
    progress(1, 1)
    return runs, summary
