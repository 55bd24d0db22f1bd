"""The samples of a recorded run, with the history that each answer had.

Messages go through the node's own matching, in the order in which they were recorded; states and
wrenches belong to the sample of their stamp. History follows from the samples and the regimes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.errors import RecordingError
from cylconn_ros.laws import elastic
from cylconn_ros.laws.bounds import after, bounds
from cylconn_ros.laws.normalised import Block
from cylconn_ros.laws.parameters import Parameters, parameters_of, tables_of, with_period
from cylconn_ros.laws.sample_state import History, came_of, jumped, no_history, observe, remember
from cylconn_ros.recording.run import Run, Table
from cylconn_ros.recording.samples import matched, vectors
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_BODIES = ("body_a", "body_b")
_WHOLE = {
    "regime": layout.REGIME,
    "stop": layout.STOP,
    "lock": layout.LOCK,
    "status": layout.STATUS,
    "flags": layout.FLAGS,
}


@dataclasses.dataclass
class Recorded:
    """Answered samples of a run, in histories that begin with their reference configuration."""

    method: str
    scene: Scene
    sample: Array  # (n, NSAMPLE)
    out: Array  # (n, NOUT)
    h: Array  # (n,) periods as the connector had them
    since: Array  # (n,) s since the sample before
    begins: NDArray[np.bool_]  # (n,) a new history
    left_out: int  # states without a sample, or whose history is not in the recording
    why: str

    @property
    def parts(self) -> int:
        """How many blocks there are."""
        return int(self.begins.sum())

    def blocks(self) -> Iterator[tuple[Block, Index]]:
        """A block for every history, and the numbers of its samples."""
        first = np.flatnonzero(self.begins)
        for low, high in zip(first, [*first[1:], len(self.h)], strict=True):
            yield self._block(int(low), int(high)), np.arange(low, high)

    def _block(self, low: int, high: int) -> Block:
        one = parameters_of([self.scene])
        p = with_period(one.take(np.zeros(high - low, dtype=np.intp)), self.h[low:high])
        sample, out = self.sample[low:high], self.out[low:high]
        past = _history(p, one, sample, out, self.since[low:high])
        return Block(p, tables_of([self.scene]), sample, out, past)


def _history(p: Parameters, one: Parameters, sample: Array, out: Array, since: Array) -> History:
    """The history before each of the samples of one connector since its start."""
    n = len(sample)
    first = remember(one, observe(one, sample[:1], no_history(1)), no_history(1), out[:1])
    past = first.take(np.zeros(n, dtype=np.intp))
    past.started[0], past.stuck[0] = False, 0.0
    past.angle[1:], past.spin[1:] = out[:-1, layout.ANGLE], out[:-1, layout.ANGULAR_VELOCITY]
    past.period[1:], past.period[0] = since[1:], 0.0
    past.total[1:], past.total[0] = out[:-1, [layout.FORCE, layout.MOMENT]], 0.0
    stick = out[:, layout.REGIME] == layout.STICK
    o = observe(p, sample, past)
    past.came[1:] = came_of(o.a, o.b)[:-1]
    jumps = jumped(p, o.a, o.b, past)
    for k in range(1, n):
        before = min(past.stuck[k - 1], 1.0) if jumps[k - 1] else past.stuck[k - 1]
        past.stuck[k] = before + 1.0 if stick[k - 1] else 0.0
    for k in range(1, n):  # the place that stick holds is that of its second sample, or of a jump
        past.held[k] = past.held[k - 1] if past.stuck[k] > 1.0 else o.place[k]
        if past.stuck[k] > 1.0 and (past.stuck[k - 1] == 1.0 or jumps[k - 1]):
            past.held[k] = o.place[k - 1]
    if not np.isnan(one.gains[0, 4]):
        _stretched(p, sample, out, past)
    return _bounded(p, sample, out, past) if one.bounded[0] else past


def _stretched(p: Parameters, sample: Array, out: Array, past: History) -> None:
    """Put the elastic slip of a penalty method's stick into ``past``."""
    s, s_size = elastic.slip_of_sample(p, observe(p, sample, past))
    spring = np.abs(elastic.friction(p, out)) / p.gains[:, 4][:, None]
    slipped = -np.sign(elastic.friction(p, out)) * spring
    slips = out[:, layout.REGIME] == layout.SLIP
    for k in range(1, len(sample)):
        last = past.period[k - 1]
        d = past.elastic[k - 1] + last * s[k - 1]
        size = past.elastic_size[k - 1] + last * s_size[k - 1]
        past.elastic[k] = slipped[k - 1] if slips[k - 1] else d
        past.elastic_size[k] = spring[k - 1] if slips[k - 1] else size


def _bounded(p: Parameters, sample: Array, out: Array, past: History) -> History:
    """``past`` with what stops, locks and imposed motion remember, one sample after the other."""
    o = observe(p, sample, past)
    reported = out[:, layout.RESTITUTION]
    last = past.take(np.zeros(1, dtype=np.intp))
    names = (
        "pending",
        "leaving",
        "leaving_size",
        "bounce",
        "unsure",
        "locked",
        "locked_at",
        "lock_last",
        "imposed_at",
    )
    for k in range(len(sample)):
        row = np.array([k])
        here = dataclasses.replace(past.take(row), **{name: getattr(last, name) for name in names})
        for name in names:
            getattr(past, name)[k] = getattr(last, name)[0]
        of, seen = p.take(row), o.take(row)
        last = after(of, seen, here, bounds(of, seen, here, reported[row]), out[row])
    return past


def samples_of(run: Run) -> Recorded:
    """Match the inputs of a run with its answers.

    Raises RecordingError where parameters, inputs or states are missing.
    """
    if not run.parameters:
        raise RecordingError(f"{run.path}: no parameters were stored with the run")
    scene = Scene.from_parameters(run.parameters)
    state = run.state
    if not len(state):
        raise RecordingError(f"{run.path}: no state was recorded")
    answers = _answers(run, state)
    samples, outs, periods, gaps, begins = [], [], [], [], []
    known, left_out = False, 0
    why = "the recording begins after the reference configuration, which the laws need"
    exchanged = 0.0
    history = 0
    for stamp, h, restarted, sample in matched(run, scene):
        history += restarted
        out = answers.pop((history, stamp), None)
        if out is None or out[layout.STATUS] != layout.OK:
            continue
        fresh = out[layout.DISPLACEMENT] == 0.0 and out[layout.ROTATION] == 0.0
        again = restarted or out[layout.ENERGY_EXCHANGED] < exchanged or not known
        exchanged = out[layout.ENERGY_EXCHANGED]
        if again:
            known = bool(fresh)
        if not known:
            left_out += 1
            continue
        samples.append(sample)
        outs.append(out)
        periods.append(scene.period or h)
        gaps.append(h or periods[-1])
        begins.append(again)
    refused = sum(out[layout.STATUS] != layout.OK for out in answers.values())
    left_out += len(answers) - int(refused)
    return Recorded(
        str(state["method"][0]),
        scene,
        np.array(samples).reshape(-1, layout.NSAMPLE),
        np.array(outs).reshape(-1, layout.NOUT),
        np.array(periods),
        np.array(gaps),
        np.array(begins, dtype=np.bool_),
        left_out,
        why,
    )


Key = tuple[int, int]
"""A sample of a run: how many histories were before its own, and its stamp, ns."""


def _keys(stamps: NDArray[np.int64]) -> list[Key]:
    """The samples that messages belong to: a new history begins where stamps go back.

    A zero wrench for samples that have stopped is one nanosecond newer than the last of them.
    """
    histories = np.concatenate([[0], np.cumsum(np.diff(stamps) < -1)])[: len(stamps)]
    return list(zip(histories.tolist(), stamps.tolist(), strict=True))


def _answers(run: Run, state: Table) -> dict[Key, Array]:
    """OUT of every sample."""
    n = len(state)
    out = np.zeros((n, layout.NOUT))
    for name, width in layout.STATE_FIELDS:
        at = layout.STATE_INDEX[name]
        out[:, at : at + width] = np.asarray(state[name]).reshape(n, width)
    for name, at in _WHOLE.items():
        out[:, at] = state[name]
    rows = {key: row for row, key in enumerate(_keys(state.stamp))}
    for body, at in zip(_BODIES, (layout.FORCE_A, layout.FORCE_B), strict=True):
        table = run.table(run.topic(f"{body}/wrench"))
        values = vectors(table, ("wrench.force", "wrench.torque"))
        for key, wrench in zip(_keys(table.stamp), values, strict=True):
            row = rows.get(key)
            if row is not None:
                out[row, at : at + 6] = wrench
    return {key: out[row] for key, row in rows.items()}
