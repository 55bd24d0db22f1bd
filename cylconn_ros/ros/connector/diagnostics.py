"""What /diagnostics says about the connector, once a second (REP-107)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Iterator, Mapping

from diagnostic_msgs.msg import DiagnosticStatus

from cylconn_ros.connector import enums
from cylconn_ros.connector.enums import named
from cylconn_ros.core import layout
from cylconn_ros.messages.health import Health
from cylconn_ros.messages.pipeline import Answering
from cylconn_ros.ros.connector.diagnostics_encoder import Part, PartWriter
from cylconn_ros.ros.connector.recorder import Recorder

OK, WARN, ERROR = (
    level[0] for level in (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)
)

# Worth a warning: the answer may not be what the user expects.
_WORRYING = (
    layout.UNDERSAMPLED
    | layout.TURN_AMBIGUOUS
    | layout.TWIST_CONTRADICTS
    | layout.MISALIGNED
    | layout.GAINS_LOWERED
    | layout.INTEGRATION
)


@dataclasses.dataclass
class Links:
    """What the middleware tells about the topics."""

    incompatible: dict[str, str] = dataclasses.field(default_factory=dict)  # topic: policy
    other_types: dict[str, str] = dataclasses.field(default_factory=dict)  # topic: types
    lost: int = 0  # messages that were sent and never came
    timeouts: int = 0  # times a zero wrench was sent because samples had stopped
    unsent: int = 0  # answers the middleware did not take
    unsent_text: str = ""
    caught: int = 0  # callbacks that raised
    caught_text: str = ""
    silent: bool = False  # samples have stopped
    state: str = "unconfigured"  # of the lifecycle


Problem = tuple[int, str]
"""A level and a text."""


class Monitor:
    """Turn counts into diagnostics; what happened since the last report decides the level."""

    def __init__(self, node_name: str) -> None:
        self._writers = {
            part: PartWriter(f"{node_name}: {part}", node_name)
            for part in ("samples", "solution", "topics", "recording")
        }
        self._before: dict[str, int] = {}
        self._time = time.monotonic()

    def report(
        self,
        answering: Answering | None,
        recorder: Recorder | None,
        links: Links,
        health: Health | None = None,
    ) -> list[Part]:
        """Report on everything; ``health`` as taken from ``answering``, if not here and now.

        On the recording only where ``recorder`` is given.
        """
        now = time.monotonic()
        elapsed, self._time = max(now - self._time, 1e-9), now
        parts = []
        if answering is not None:
            health = health or answering.health.taken()
            parts.append(self._samples(answering, health, links, elapsed))
            parts.append(self._solution(answering, health))
        parts.append(self._topics(answering, links))
        if recorder is not None:
            parts.append(self._recording(recorder))
        return parts

    def _samples(self, answering: Answering, health: Health, links: Links, elapsed: float) -> Part:
        counts = answering.matcher.counts
        rate = (counts.samples - self._before.get("samples", 0)) / elapsed
        self._before["samples"] = counts.samples
        values = {
            "rate [1/s]": f"{rate:.1f}",
            "samples answered": counts.samples,
            "answered again": counts.answered_again,
            "repeated messages": counts.repeated,
            "incomplete samples": counts.incomplete,
            "late messages": counts.late,
            "non-finite": health.not_finite,
            "bad quaternion": health.bad_quaternion,
            "no period": health.no_period,
            "off period": health.off_period,
            "undecodable": health.undecodable,
            "failed": health.failed,
            "restarts": counts.restarts,
            "foreign frames": counts.foreign_frames,
            "commands followed": health.commands,
            "commands refused": health.refused,
            "timeouts": links.timeouts,
        }
        problems = self._sample_problems(answering, health, links)
        return self._part("samples", problems, f"{rate:.0f} samples/s", values)

    def _sample_problems(
        self, answering: Answering, health: Health, links: Links
    ) -> Iterator[Problem]:
        counts = answering.matcher.counts
        if self._new("failed", health.failed):
            yield ERROR, f"computing failed: {health.failure}"
        if self._new("non-finite", health.not_finite):
            yield ERROR, "input is not finite"
        if self._new("bad quaternion", health.bad_quaternion):
            yield ERROR, "an orientation cannot be normalised"
        if self._new("undecodable", health.undecodable):
            yield ERROR, f"a message cannot be decoded: {health.undecodable_text}"
        if self._new("refused", health.refused):
            yield WARN, f"a command cannot be followed: {health.refusal}"
        if self._new("no period", health.no_period):
            yield WARN, "no time step between samples yet"
        if self._new("off period", health.off_period):
            seen, period = health.seen_period, answering.scene.period
            yield WARN, f"stamps are {seen:g} s apart, but period says {period:g} s"
        if self._new("late", counts.late):
            yield WARN, "messages arrive late"
        if self._new("incomplete", counts.incomplete):
            yield WARN, "samples stay incomplete"
        if self._new("restarts", counts.restarts):
            yield WARN, "stamps went back: a new history"
        if self._new("foreign frames", counts.foreign_frames):
            yield WARN, "a frame_id names no frame of the scene"
        if links.silent:
            yield WARN, "no complete sample for longer than timeout: zero wrench"
        if links.state != "active":
            yield WARN, f"the node is {links.state}"

    def _solution(self, answering: Answering, health: Health) -> Part:
        connector = answering.connector
        regime = enums.REGIMES[health.regime]
        flags, stops = named(enums.FLAGS, health.flags), named(enums.STOPS, health.stops)
        locked = named(enums.LOCKS, health.lock)
        fine = f"{connector.method}, {regime}"
        fine += f", at stop: {stops}" if stops else ""
        fine += f", locked: {locked}" if locked else ""
        values = {
            "method": connector.method,
            "model": connector.model,
            "regime": regime,
            "latency [samples]": connector.late,
            "saturated": health.saturated,
            "worst residual": f"{health.worst_residual:.3g}",
            "worst offset violation [m]": f"{health.worst_offset:.3g}",
            "worst angular violation [rad]": f"{health.worst_angle:.3g}",
            "worst computing time [s]": f"{health.worst_time:.3g}",
            "flags": flags or "none",
            "stops touched": stops or "none",
            "locked": locked or "none",
            **{f"imposed on {name}": what for name, what in answering.imposed.items()},
        }
        return self._part("solution", self._solution_problems(health), fine, values)

    def _solution_problems(self, health: Health) -> Iterator[Problem]:
        worrying = health.flags & _WORRYING
        if worrying:
            yield from ((WARN, name) for k, name in enumerate(enums.FLAGS) if worrying >> k & 1)
        if self._new("saturated", health.saturated):
            yield WARN, "wrenches are scaled down to the limits"

    def _topics(self, answering: Answering | None, links: Links) -> Part:
        values: dict[str, object] = {
            "incompatible QoS": len(links.incompatible),
            "other message types": len(links.other_types),
            "dropped messages": links.lost,
            "answers not published": links.unsent,
            "failed callbacks": links.caught,
        }
        if answering is not None:
            values.update({f"{k} messages": n for k, n in answering.matcher.received.items()})
        return self._part("topics", self._topic_problems(answering, links), "connected", values)

    def _topic_problems(self, answering: Answering | None, links: Links) -> Iterator[Problem]:
        for topic, policy in links.incompatible.items():
            yield WARN, f"incompatible QoS on {topic}: {policy}; its messages do not arrive"
        for topic, types in links.other_types.items():
            yield WARN, f"another message type on {topic}: {types}; its messages do not arrive"
        if self._new("unsent", links.unsent):
            yield ERROR, f"not published: {links.unsent_text}"
        if self._new("caught", links.caught):
            yield ERROR, f"a callback failed: {links.caught_text}"
        if self._new("dropped", links.lost):
            yield WARN, "messages were dropped on the way"
        missing = () if answering is None else answering.matcher.missing
        if missing:
            yield WARN, f"nothing received yet on {', '.join(missing)}"

    def _recording(self, recorder: Recorder) -> Part:
        failure, running = recorder.failure, recorder.running
        problems = [(ERROR, f"recording failed: {failure}")] if failure else []
        values = {
            "recording": "yes" if running else "no",
            "directory": recorder.directory or "",
            "messages recorded": recorder.recorded,
            "messages lost": recorder.lost,
        }
        fine = "recording" if running else "not recording"
        return self._part("recording", problems, fine, values)

    def _new(self, name: str, count: int) -> bool:
        """Whether a count has grown since the last report."""
        before, self._before[name] = self._before.get(name, 0), count
        return count > before

    def _part(
        self, part: str, problems: Iterable[Problem], fine: str, values: Mapping[str, object]
    ) -> Part:
        present = list(problems)
        level = max((level for level, _ in present), default=OK)
        message = "; ".join(text for _, text in present) or fine
        return self._writers[part].write(level, message, values)
