"""Tasks of an archive: what is computed of one recording, as a row.

Each class is the function of a row for one command: ``replay``, ``identify``, ``laws``, ``info``.
``passed`` is whether the command for a single recording would have succeeded, ``problem`` why not.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from cylconn_ros.connector.enums import FLAGS
from cylconn_ros.connector.summary import FIELDS, Reduction
from cylconn_ros.errors import IndeterminateError, RecordingError
from cylconn_ros.identification.recording import identify
from cylconn_ros.laws import together
from cylconn_ros.laws.guarantees import title
from cylconn_ros.laws.runs import check_recording
from cylconn_ros.recording import connector_part
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.run import read_run, why_incomplete
from cylconn_ros.recording.table import STAMP
from cylconn_ros.replay.batches import Batch
from cylconn_ros.replay.compare import Comparison, agree
from cylconn_ros.replay.replay import Item, Replay
from cylconn_ros.replay.together import ReplayTogether
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene
from cylconn_ros.study.archive.bags import PATH, local

_COMMON = {"passed": "bool", "problem": "string", "samples": "int64"}

UNITS: Mapping[str, str] = {
    "duration": "s",
    "stop_time": "s",
    "displacement.end": "m",
    "rotation.end": "rad",
    "offset_violation.max": "m",
    "angular_violation.max": "rad",
    "normal_force.max": "N",
    "noise": "m/s",
    "preload": "N",
    "overlap": "m",
    "radius": "m",
    "c1": "N.s/m",
    "cr1": "N.m.s",
}
"""Units of the outputs; what is not here is a number without a unit."""


def unit_of(output: str) -> str:
    """Unit of an output or of an end of its interval; '' for a number without a unit."""
    return UNITS.get(output, UNITS.get(output.removesuffix(".low").removesuffix(".high"), ""))


@dataclass(frozen=True)
class ReplayTask:
    """Replay a recording and compare the outputs with the recorded ones, if there are some.

    Attributes
    ----------
        changes: parameters that replace recorded ones. tolerance: relative difference accepted.
    """

    changes: Mapping[str, Any] = field(default_factory=dict)
    tolerance: float = 0.0
    outputs: ClassVar[Mapping[str, str]] = {
        **_COMMON,
        "compared": "int64",
        "different": "int64",
        "worst_field": "string",
        "worst_relative": "float64",
        "irregular": "string",
        "digest": "string",
    }

    def __call__(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the record; ``digest`` is that of all outputs but the computing time."""
        with local(row[PATH]) as path:
            return self._replay(Bag(path))

    def _scene(self, metadata: Mapping[str, str], path: Path) -> Scene:
        if "parameters" not in metadata:
            raise RecordingError(f"{path}: no parameters were stored with it")
        stored = parameter_file.parameters_of(metadata["parameters"])
        return Scene.from_parameters({**stored, **self.changes})

    def _replay(self, bag: Bag) -> Mapping[str, Any]:
        names = connector_part.names(bag.metadata)
        members: Mapping[str, Replay]
        stream: Iterator[Item | Batch]
        if names:
            parts = {n: connector_part.select(bag.metadata, n).metadata for n in names}
            whole = ReplayTogether(bag, {n: self._scene(m, bag.path) for n, m in parts.items()})
            members, stream = whole.members, whole.messages()
        else:
            single = Replay(bag, self._scene(bag.metadata, bag.path))
            members, stream = {"": single}, single.parts()
        kinds = {m.names[n]: kind for m in members.values() for n, kind in m.outputs.items()}
        timing = {topic: at for m in members.values() for topic, at in m.timing.items()}
        recorded = {topic: kind for topic, kind in kinds.items() if topic in bag.types}
        comparison = Comparison(recorded, timing, self.tolerance, bag.definitions)
        digests = _Digests(timing)
        for part in stream:
            if isinstance(part, Batch):
                for name, topic in members[""].names.items():
                    outputs = part.rows(name)
                    digests.rows(topic, outputs)
                    part.compare(topic, outputs, comparison)
            else:
                if part.replayed:
                    digests.add(part.topic, part.data)
                if part.topic in recorded:
                    add = comparison.replayed if part.replayed else comparison.recorded
                    add(part.topic, part.data)
        topics = comparison.result()
        problems = [p for m in members.values() if (p := m.problem())]
        problems += [p for p in (bag.damage, why_incomplete(bag.source)) if p]
        if recorded and not agree(topics):
            problems.append("outputs differ")
        differences = [d for topic in topics for d in topic.differences]
        worst = max(differences, key=lambda d: d.relative, default=None)
        return {
            "passed": not problems,
            "problem": "; ".join(problems),
            "samples": sum(m.counts.responses for m in members.values()),
            "compared": sum(t.same + t.different for t in topics),
            "different": sum(t.different for t in topics),
            "worst_field": worst.field if worst else "",
            "worst_relative": worst.relative if worst else 0.0,
            "irregular": "; ".join(t for m in members.values() for t in m.irregularities()),
            "digest": digests.text(),
        }


class _Digests:
    """Digest of the replayed messages of each topic, without the bytes of the computing time."""

    def __init__(self, timing: Mapping[str, slice]) -> None:
        self._timing = timing
        self._topics: dict[str, Any] = {}

    def add(self, topic: str, data: bytes) -> None:
        self.rows(topic, np.frombuffer(data, np.uint8)[np.newaxis])

    def rows(self, topic: str, rows: np.ndarray) -> None:
        """Add messages (n, bytes) uint8."""
        if topic in self._timing:
            rows = rows.copy()
            rows[:, self._timing[topic]] = 0
        self._topics.setdefault(topic, hashlib.sha256()).update(np.ascontiguousarray(rows).data)

    def text(self) -> str:
        parts = [f"{name} {self._topics[name].hexdigest()}" for name in sorted(self._topics)]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


ESTIMATES = (
    "coefficient", "static_coefficient", "preload", "overlap", "radius", "c1", "cr1",
    "coefficient_positive", "coefficient_negative",
)  # fmt: skip


@dataclass(frozen=True)
class IdentifyTask:
    """Estimate the friction of a recording.

    Attributes
    ----------
        known: parameters that are not estimated, with their value or None for that of the scene.
    """

    known: Mapping[str, float | None] = field(default_factory=dict)
    outputs: ClassVar[Mapping[str, str]] = {
        **_COMMON,
        "windows": "int64",
        "noise": "float64",
        "misfit": "float64",
        "terms": "string",
        **{f"{name}{end}": "float64" for name in ESTIMATES for end in ("", ".low", ".high")},
    }

    def __call__(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the record; an estimate that the motion does not determine is null."""
        with local(row[PATH]) as path:
            run = read_run(path)
            try:
                found = identify(run, known=dict(self.known))
            except IndeterminateError as error:
                return {"passed": False, "problem": str(error)}
        record: dict[str, Any] = {
            "passed": found.accepted,
            "problem": "" if found.accepted else "; ".join(found.verdict()),
            "samples": found.samples,
            "windows": found.windows,
            "noise": found.noise,
            "misfit": found.misfit,
            "terms": ", ".join(found.choice.terms),
        }
        for name in ESTIMATES:
            e = found.estimates.get(name)
            if e is not None and e.found and found.accepted:
                record |= {name: e.value, f"{name}.low": e.low, f"{name}.high": e.high}
        return record


@dataclass(frozen=True)
class LawsTask:
    """Check the laws of the recorded steps."""

    outputs: ClassVar[Mapping[str, str]] = {
        **_COMMON,
        "method": "string",
        "skipped": "int64",
        "violated": "string",
        "worst_law": "string",
        "worst_residual": "float64",
    }

    def __call__(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the record: laws that do not hold, and the largest residual of all."""
        with local(row[PATH]) as path:
            several = connector_part.names(Bag(path).metadata)
            method, skipped = "", 0
            if several:
                _, summary = together.check_recording(path, several, _no_progress)
            else:
                recorded, summary = check_recording(path, _no_progress)
                method, skipped = recorded.method, recorded.skipped
        violated = [title(name) for name, law in summary.laws.items() if not law.holds]
        worst = max(summary.laws.items(), key=lambda item: item[1].worst, default=None)
        problem = f"violated: {', '.join(violated)}" if violated else ""
        return {
            "passed": bool(summary.samples) and not violated,
            "problem": problem or ("" if summary.samples else "no sample can be checked"),
            "samples": summary.samples,
            "method": method,
            "skipped": skipped,
            "violated": ", ".join(violated),
            "worst_law": title(worst[0]) if worst else "",
            "worst_residual": worst[1].worst if worst else math.nan,
        }


def _no_progress(done: int, total: int) -> None:
    """Progress is that of the recordings."""


@dataclass(frozen=True)
class InfoTask:
    """What a recording contains, and the summary of its run."""

    outputs: ClassVar[Mapping[str, str]] = {
        **_COMMON,
        "messages": "int64",
        "topics": "int64",
        "duration": "float64",
        "recorded_by": "string",
        "method": "string",
        "connectors": "string",
        "displacement.end": "float64",
        "rotation.end": "float64",
        "stop_time": "float64",
        "offset_violation.max": "float64",
        "angular_violation.max": "float64",
        "normal_force.max": "float64",
        "refused": "int64",
        **{f"flag {name}": "int64" for name in FLAGS if name != "stopped"},
    }

    def __call__(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the record; values of the run are null for several connectors."""
        with local(row[PATH]) as path:
            run = read_run(path)
            record: dict[str, Any] = {
                "messages": sum(run.counts.values()),
                "topics": len(run.types),
                "duration": run.duration,
                "recorded_by": run.version,
                "method": run.metadata.get("method", ""),
                "connectors": ", ".join(run.connectors),
            }
            problems = [run.incomplete] if run.incomplete else []
            problems += [] if record["messages"] else ["no message can be read"]
            has_state = "cylconn_ros/msg/ConnectorState" in run.types.values()
            if not run.connectors and has_state:
                self._add_summary(run, record, problems)
        return {**record, "passed": not problems, "problem": "; ".join(problems)}

    @staticmethod
    def _add_summary(run: Any, record: dict[str, Any], problems: list[str]) -> None:
        """Add the summary of the states."""
        reduction, begin = Reduction(), None
        for block in run.read_blocks(run.state_topic, fields={*FIELDS, *STAMP}):
            if len(block):
                begin = int(block.stamp[0]) if begin is None else begin
                reduction.add(np.asarray((block.stamp - begin) * 1e-9, np.float64), block.columns)
        if begin is None:
            return
        found = reduction.result()
        problems += [found.problem] if found.problem else []
        record |= {
            "samples": found.samples,
            "displacement.end": found.distance,
            "rotation.end": found.turns * 2.0 * math.pi,
            "stop_time": found.stop_time,
            "offset_violation.max": found.worst_offset,
            "angular_violation.max": found.worst_misalignment,
            "normal_force.max": found.greatest.get("normal_force"),
            "refused": found.refused,
            **{f"flag {name}": found.flags.get(name, 0) for name in FLAGS if name != "stopped"},
        }
