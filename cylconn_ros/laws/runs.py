"""Samples of a recorded or simulated run with their histories, and the check of their laws.

A recording's messages pass through the synchronizer of the node, in the order in which they were
recorded. States and wrenches belong to the sample with their stamp. Histories follow from the
samples and the reported regimes.
"""

from __future__ import annotations

import dataclasses
import itertools
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.batch import PeriodInUse
from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.core import layout
from cylconn_ros.errors import RecordingError
from cylconn_ros.laws import elastic, residuals
from cylconn_ros.laws.approach import Approach, Held, approach, nothing
from cylconn_ros.laws.bounds import (
    CARRIED,
    bounds,
    held_of,
    motion_bounds,
    next_bounds_history,
)
from cylconn_ros.laws.commands import Commanded, commanded, of_scene, with_commands
from cylconn_ros.laws.elements import block_of, substituted
from cylconn_ros.laws.friction import at_sample
from cylconn_ros.laws.guarantees import title
from cylconn_ros.laws.normalised import TOLERANCE, Block
from cylconn_ros.laws.parameters import Parameters, parameters_of, tables_of, with_period
from cylconn_ros.laws.parameters import Table as FrictionTable
from cylconn_ros.laws.predicted_end import prepare_step
from cylconn_ros.laws.sample_state import (
    History,
    SampleState,
    com_motion,
    next_history,
    no_history,
    pose_jumped,
    state_of,
)
from cylconn_ros.laws.step import Step
from cylconn_ros.laws.summary import LawSummary
from cylconn_ros.recording.connector_part import refuse_coupled
from cylconn_ros.recording.files.source import Paths
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.samples import synchronized_samples, vectors
from cylconn_ros.recording.table import Table
from cylconn_ros.scene import over_time
from cylconn_ros.scene.packing import choose_method
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_BODIES = ("body_a", "body_b")
_ENUMS = {
    "regime": layout.REGIME,
    "stop": layout.STOP,
    "lock": layout.LOCK,
    "status": layout.STATUS,
    "flags": layout.FLAGS,
}


@dataclasses.dataclass
class RunSamples:
    """Samples of a run with their outputs; each history begins at its reference configuration."""

    method: str
    scene: Scene
    sample: Array  # (n, NSAMPLE)
    out: Array  # (n, NOUT)
    h: Array  # (n,) period of each step, s
    since: Array  # (n,) time since the previous sample, s
    begins: NDArray[np.bool_]  # (n,) whether a history begins with the sample
    skipped: int = 0  # states without a sample, or with a history that is not in the recording
    skip_reason: str = ""
    commanded: Commanded | None = None  # None: nothing but the scene's parameters
    others: Array | None = None  # (n, 12) wrenches of connectors on the same bodies (together.py)

    @property
    def histories(self) -> int:
        """Number of histories, each of which is a block."""
        return int(self.begins.sum())

    def blocks(self) -> Iterator[tuple[Block, Index]]:
        """Each history as a block, with the row numbers of its samples."""
        first = np.flatnonzero(self.begins)
        for low, high in itertools.pairwise([*first, len(self.h)]):
            yield self._block(int(low), int(high)), np.arange(low, high)

    def _block(self, low: int, high: int) -> Block:
        one = parameters_of([self.scene])
        p = with_period(one.take(np.zeros(high - low, dtype=np.intp)), self.h[low:high])
        if self.commanded is not None:
            p = with_commands(p, self.commanded, slice(low, high))
        sample, out = self.sample[low:high], self.out[low:high]
        tables = tables_of([self.scene])
        others = None if self.others is None else self.others[low:high]
        past = _history(p, one, sample, out, self.since[low:high])
        o = state_of(p, sample, past)
        block = Block(at_sample(p, o), tables, sample, out, past, others)
        of = np.zeros(high - low, dtype=np.intp)
        found = substituted([self.scene], of, block.parameters, o, sample, out, others, self.method)
        block = block_of(block, found)
        if one.bounded[0]:
            p = block.parameters
            block.past, block.near = _with_bounds(p, tables, sample, block.out, past, others)
        return block


NO_LOADS = (0.0,) * 12


def simulated(
    scene: Scene, method: str, states: Array, outs: Array, loads: Sequence[float] = NO_LOADS
) -> RunSamples:
    """Samples of a simulated run from its start.

    Args:
        states: (n, 26) poses and twists of both bodies.
        outs: (n, NOUT) outputs of the connector.
        loads: (12,) force (N) and torque (N m) on body A, then on body B, where they are constant.

    What changes over time in the scene is taken from it.
    """
    n = len(states)
    samples = np.zeros((n, layout.NSAMPLE))
    samples[:, layout.MOTION], samples[:, layout.LOADS] = states, loads
    begins, periods = np.arange(n) == 0, np.full(n, scene.period)
    found = RunSamples(method, scene, samples, outs, periods, periods, begins)
    if over_time.changes(scene):
        changing = OverTime(scene)
        samples[:, layout.LOADS] = [changing.loads(k) for k in range(n)]
        found.commanded = of_scene(scene, n)
    return found


def first_violation(scene: Scene, states: Array, outs: Array) -> str:
    """The first law that a run violates, with its largest residual; empty if all laws hold.

    Args:
        scene: the scene of the run, which has no loads; its method's guaranteed laws are checked.
        states: (n, 26) poses and twists of both bodies.
        outs: (n, NOUT) outputs of the connector, from the first sample on.

    """
    method = choose_method(scene)
    if method not in residuals.RESIDUALS:
        return ""
    block, _ = next(simulated(scene, method, states, outs).blocks())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a diverged run overflows
        found = residuals.check(block, method, in_order=True)
    for law, values in found.items():
        worst = float(np.max(values, initial=0.0, where=~np.isnan(values)))
        if not worst <= TOLERANCE:
            return f"law {title(law)}: residual {worst:.1e}"
    return ""


def check_recording(
    paths: Paths,
    progress: Callable[[int, int], object],
    connector: str = "",
    scene: Scene | None = None,
) -> tuple[RunSamples, LawSummary]:
    """Check the samples of a recorded run.

    Args:
        paths: recorded directory, file or files.
        progress: called with (checked, all) histories.
        connector: name of the connector, if the recording holds several.
        scene: its parameters; None: those stored with the recording.

    Raises RecordingError if the recording cannot be read, or if no laws are stated for its method,
    for coupled connectors, for its latency or for the constraint of a simulator.

    """
    run = read_run(paths, connector)
    path = run.path
    refuse_coupled(
        run.metadata, connector, "its laws are those of all of them; leave out --connector"
    )
    recorded = samples_of(run, scene)
    if recorded.method not in residuals.RESIDUALS:
        raise RecordingError(f"{path}: no laws of a sample are stated for method {recorded.method}")
    if recorded.scene.latency > 0:
        raise RecordingError(
            f"{path}: latency = {recorded.scene.latency}: the outputs belong to predicted states, "
            "which the recording does not contain; laws are stated for lock step"
        )
    if recorded.scene.constraint == "simulator":
        raise RecordingError(
            f"{path}: constraint = 'simulator': the reactions are not sent, and the gain on slide "
            "and spin is not recorded; laws are stated for the constraint 'connector'"
        )
    summary = LawSummary()
    for done, (block, index) in enumerate(recorded.blocks()):
        summary.add(residuals.check(block, recorded.method), block.out, (index,))
        progress(done + 1, recorded.histories)
    return recorded, summary


def _history(p: Parameters, one: Parameters, sample: Array, out: Array, since: Array) -> History:
    """The history before each sample of one connector, from its reference configuration on."""
    n = len(sample)
    first = next_history(one, state_of(one, sample[:1], no_history(1)), no_history(1), out[:1])
    past = first.take(np.zeros(n, dtype=np.intp))
    past.started[0], past.stuck[0] = False, 0.0
    past.angle[1:], past.spin[1:] = out[:-1, layout.ANGLE], out[:-1, layout.ANGULAR_VELOCITY]
    past.period[1:], past.period[0] = since[1:], 0.0
    past.total[1:], past.total[0] = out[:-1, [layout.FORCE, layout.MOMENT]], 0.0
    stick = out[:, layout.REGIME] == layout.STICK
    o = state_of(p, sample, past)
    past.last_motion[1:] = com_motion(o.a, o.b)[:-1]
    jumps = pose_jumped(p, o.a, o.b, past)
    for k in range(1, n):
        before = min(past.stuck[k - 1], 1.0) if jumps[k - 1] else past.stuck[k - 1]
        past.stuck[k] = before + 1.0 if stick[k - 1] else 0.0
    for k in range(1, n):  # stick holds the position of its second sample, or of a pose jump
        past.held[k] = past.held[k - 1] if past.stuck[k] > 1.0 else o.position[k]
        if past.stuck[k] > 1.0 and (past.stuck[k - 1] == 1.0 or jumps[k - 1]):
            past.held[k] = o.position[k - 1]
    if not np.isnan(one.gains[0, 4]):
        _set_elastic_slip(p, sample, out, past)
    return past


def _set_elastic_slip(p: Parameters, sample: Array, out: Array, past: History) -> None:
    """Fill in the elastic slip of a penalty method's stick, in place."""
    s, s_size = elastic.slip_of_sample(p, state_of(p, sample, past))
    spring = np.abs(elastic.friction(p, out)) / p.gains[:, 4][:, None]
    slipped = -np.sign(elastic.friction(p, out)) * spring
    slips = out[:, layout.REGIME] == layout.SLIP
    for k in range(1, len(sample)):
        last = past.period[k - 1]
        d = past.elastic[k - 1] + last * s[k - 1]
        size = past.elastic_size[k - 1] + last * s_size[k - 1]
        past.elastic[k] = slipped[k - 1] if slips[k - 1] else d
        past.elastic_size[k] = spring[k - 1] if slips[k - 1] else size


def _with_bounds(
    p: Parameters, tables: Sequence[FrictionTable], sample: Array, out: Array, past: History,
    others: Array | None,
) -> tuple[History, Approach]:  # fmt: skip
    """``past`` with the history of stops, locks and imposed motion, sample by sample.

    Also what slide and spin do at stops.
    """
    o = state_of(p, sample, past)
    s = prepare_step(p, o, sample, others)
    names = ("locked", "locked_at", "lock_last", "imposed_at")
    last = past.take(np.zeros(1, dtype=np.intp))
    for k in range(len(sample)):
        row = np.array([k])
        _carry(past, last, k, names)
        of, state, here = p.take(row), o.take(row), past.take(row)
        last = next_bounds_history(of, state, here, motion_bounds(of, state, here), out[row])
    # what slide and spin do at stops does not depend on the impacts before: all at once
    near = nothing(len(sample))
    if np.isnan(p.gains[:, 0]).all():  # a penalty method's stops are springs, its inertia unknown
        near = _approach(p, tables, o, s, held_of(p, o, s, motion_bounds(p, o, past)), out)
    last = past.take(np.zeros(1, dtype=np.intp))
    for k in range(len(sample)):
        row = np.array([k])
        _carry(past, last, k, ("pending", "ambiguous", *CARRIED))
        of, state, here = p.take(row), o.take(row), past.take(row)
        b = bounds(of, tables, state, s.take(row), here, out[row], near.take(row))
        last = next_bounds_history(of, state, here, b, out[row])
    return past, near


def _approach(
    p: Parameters, tables: Sequence[FrictionTable], o: SampleState, s: Step, held: Held, out: Array
) -> Approach:
    """:func:`approach` of the samples of one scene: equal ones, as at rest, are solved once."""
    used = [layout.STOP, layout.RESTITUTION, *range(layout.FORCE, layout.FORCE + 6)]
    fields: list[NDArray[Any]] = [
        o.position, o.w, o.held, s.free, s.bracket, s.target, s.hold, held.rate,
        s.inverse_a.reshape(-1, 9), s.inverse_b.reshape(-1, 9), s.frame.axes.reshape(-1, 9),
        s.frame.arm_a, s.frame.arm_b, p.h[:, None],
        held.rows, held.rests, o.holding[:, None], out[:, used],
    ]  # fmt: skip
    keys = np.concatenate([np.asarray(f, dtype=np.float64) for f in fields], axis=1)
    counted = keys[:, [not np.all(k == k[0]) for k in keys.T]]
    _, first, of = np.unique(counted, axis=0, return_index=True, return_inverse=True)
    of = of.reshape(-1)
    return approach(
        p.take(first), tables, o.take(first), s.take(first), held.take(first), out[first]
    ).take(of)


def _carry(past: History, last: History, k: int, names: Sequence[str]) -> None:
    """Set row k of ``past`` to the row that the sample before leads to, in place."""
    for name in names:
        getattr(past, name)[k] = getattr(last, name)[0]


def samples_of(run: Run, scene: Scene | None = None) -> RunSamples:
    """Combine the inputs of a recorded run with its outputs; ``scene`` as of check_recording.

    Raises RecordingError if parameters, inputs or states are missing.
    """
    if scene is None:
        if not run.parameters:
            raise RecordingError(
                f"{run.path}: no parameters were stored with the run; give --params FILE"
            )
        scene = Scene.from_parameters(run.parameters)
    state = run.state
    if not len(state):
        raise RecordingError(f"{run.path}: no state was recorded")
    outputs = _outputs(run, state, scene)
    samples, outs, periods, since, begins, stamps = [], [], [], [], [], []
    known, skipped, exchanged, history = False, 0, 0.0, 0
    period = PeriodInUse(scene.period)
    for stamp, h, restarted, sample in synchronized_samples(run, scene):
        history += restarted
        used = period.of(sample, h)
        out = outputs.pop((history, stamp), None)
        if out is None or out[layout.STATUS] != layout.OK:
            continue
        at_reference = out[layout.DISPLACEMENT] == 0.0 and out[layout.ROTATION] == 0.0
        new = restarted or out[layout.ENERGY_EXCHANGED] < exchanged or not known
        exchanged = out[layout.ENERGY_EXCHANGED]
        if new:
            known = bool(at_reference)
        if not known:
            skipped += 1
            continue
        samples.append(sample)
        stamps.append(stamp)
        outs.append(out)
        periods.append(used)
        since.append(h or used)
        begins.append(new)
    refused = sum(out[layout.STATUS] != layout.OK for out in outputs.values())
    skipped += len(outputs) - int(refused)
    return RunSamples(
        str(state["method"][0]),
        scene,
        np.array(samples).reshape(-1, layout.NSAMPLE),
        np.array(outs).reshape(-1, layout.NOUT),
        np.array(periods),
        np.array(since),
        np.array(begins, dtype=np.bool_),
        skipped,
        "the recording begins after the reference configuration, which the laws need",
        commanded(run, scene, stamps),
    )


Key = tuple[int, int]
"""Identifies a sample of a run: number of earlier histories, and stamp (ns)."""


def sample_keys(stamps: NDArray[np.int64]) -> list[Key]:
    """Keys of the samples to which messages with these stamps belong.

    A stamp before its predecessor begins a new history. The zero wrench after an input timeout is
    stamped one nanosecond after the last sample and does not.
    """
    histories = np.concatenate([[0], np.cumsum(np.diff(stamps) < -1)])[: len(stamps)]
    return list(zip(histories.tolist(), stamps.tolist(), strict=True))


def _outputs(run: Run, state: Table, scene: Scene) -> dict[Key, Array]:
    """The output array (NOUT,) of each recorded state, with its wrenches.

    States from before the fields of overlap and contact have the scene's overlap, its middle at b.
    """
    n = len(state)
    out = np.zeros((n, layout.NOUT))
    out[:, layout.OVERLAP] = scene.friction.overlap
    for name, width in layout.STATE_FIELDS:
        at = layout.STATE_INDEX[name]
        if name in state.columns or name not in ("overlap", "contact_centre"):
            out[:, at : at + width] = np.asarray(state[name]).reshape(n, width)
    for name, at in _ENUMS.items():
        out[:, at] = state[name]
    rows = {key: row for row, key in enumerate(sample_keys(state.stamp))}
    for body, at in zip(_BODIES, (layout.FORCE_A, layout.FORCE_B), strict=True):
        table = run.table(run.topic(f"{body}/wrench"))
        values = vectors(table, ("wrench.force", "wrench.torque"))
        for key, wrench in zip(sample_keys(table.stamp), values, strict=True):
            row = rows.get(key)
            if row is not None:
                out[row, at : at + 6] = wrench
    return {key: out[row] for key, row in rows.items()}
