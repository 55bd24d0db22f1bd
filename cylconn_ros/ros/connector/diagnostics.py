"""Diagnostics of a connector on /diagnostics, once per second (REP-107)."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterable, Iterator, Mapping

from cylconn_ros.connector import enums
from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.enums import named
from cylconn_ros.messages.health import Health
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.ros.connector.diagnostics_encoder import EncodedStatus, StatusEncoder
from cylconn_ros.ros.connector.problems import (
    ERROR,
    OK,
    TIMEOUT,
    WARN,
    Problem,
    latency_problem,
    sample_problems,
    solution_problems,
    timeout_text,
)
from cylconn_ros.ros.connector.recorder import Recorder
from cylconn_ros.ros.connector.watchdog import missing_topics

_FORGOTTEN = 60.0  # s without a problem after which it is logged again


@dataclasses.dataclass
class ConnectionStatus:
    """State of the topics, of the callbacks and of the lifecycle."""

    incompatible: dict[str, str] = dataclasses.field(default_factory=dict)  # warning by topic
    other_types: dict[str, str] = dataclasses.field(default_factory=dict)  # warning by topic
    several: dict[str, int] = dataclasses.field(default_factory=dict)  # publishers, by topic
    lost: dict[str, int] = dataclasses.field(default_factory=dict)  # never received, by topic
    timeouts: int = 0  # zero wrenches sent after an input timeout
    unpublished: int = 0  # outputs that the middleware did not accept
    unpublished_reason: str = ""
    failed_callbacks: int = 0  # callbacks that raised
    callback_error: str = ""
    timed_out: bool = False  # no sample within the timeout
    state: str = "unconfigured"  # of the lifecycle
    compiling: str = ""  # progress of a compilation; '' if nothing is being compiled
    not_processed: int = 0  # samples that wait for it
    new_parameters: bool = False  # whether accepted parameters wait for it


class Monitor:
    """Turn counts into diagnostics; events since the last report decide the level."""

    def __init__(self, node_name: str) -> None:
        self._encoders = {
            part: StatusEncoder(f"{node_name}: {part}", node_name)
            for part in ("samples", "solution", "topics", "recording")
        }
        self._name = node_name
        self._before: dict[str, int] = {}
        self._logged: dict[str, float] = {}  # when a problem was last present (s), by part and key
        self._unlogged: list[tuple[int, str]] = []
        self._latency: float | None = None  # samples, at the last report, None: unknown
        self._time = time.monotonic()

    def report(
        self,
        pipeline: MessagePipeline | None,
        recorder: Recorder | None,
        status: ConnectionStatus,
        health: Health | None = None,
    ) -> list[EncodedStatus]:
        """Report on samples, solution, topics and, if ``recorder`` is given, on the recording.

        ``health``: a copy taken from ``pipeline``; without it, the copy is taken here.
        """
        now = time.monotonic()
        elapsed, self._time = max(now - self._time, 1e-9), now
        parts = []
        if pipeline is not None:
            health = health or pipeline.health.report()
            parts.append(self._samples(pipeline, health, status, elapsed))
            parts.append(self._solution(pipeline, health))
        parts.append(self._topics(pipeline, status))
        if recorder is not None:
            parts.append(self._recording(recorder))
        return parts

    def take_log(self) -> list[tuple[int, str]]:
        """Levels and texts for the log: the problems and hints that are new since the last call.

        A problem is new once: when it was not present in the last _FORGOTTEN s.
        """
        texts, self._unlogged = self._unlogged, []
        return texts

    def forget(self) -> None:
        """Let every problem be new again."""
        self._logged.clear()

    def _samples(
        self, pipeline: MessagePipeline, health: Health, status: ConnectionStatus, elapsed: float
    ) -> EncodedStatus:
        counts = pipeline.matcher.counts
        rate = (counts.samples - self._before.get("samples", 0)) / elapsed
        self._before["samples"] = counts.samples
        values = {
            "rate [1/s]": f"{rate:.1f}",
            "samples processed": counts.samples,
            "duplicate samples": counts.duplicate_samples,
            "repeated messages": counts.duplicate_messages,
            "incomplete samples": counts.incomplete,
            "late messages": counts.late,
            "loads later than their sample": counts.late_loads,
            "loads not used": counts.unused_loads,
            "loads ahead of the samples": counts.early_loads,
            "non-finite": health.not_finite,
            "too large": health.too_large,
            "overflowed": health.overflowed,
            "bad quaternion": health.bad_quaternion,
            "quaternion norm off": sum(health.off_norm),
            "no period": health.no_period,
            "off period": health.off_period,
            "undecodable": health.undecodable,
            "failed": health.failed,
            "restarts": counts.restarts,
            "unknown frame_ids": counts.unknown_frames,
            "commands followed": health.commands,
            "commands refused": health.refused,
            "timeouts": status.timeouts,
        }
        if status.compiling:
            values["compiling"] = status.compiling
            values["samples not yet processed"] = status.not_processed
        problems = self._sample_problems(pipeline, health, status)
        return self._encode("samples", problems, f"{rate:.0f} samples/s", values)

    def _sample_problems(
        self, pipeline: MessagePipeline, health: Health, status: ConnectionStatus
    ) -> Iterator[Problem]:
        if status.compiling:
            if status.new_parameters:
                text = "new parameters are in force when their method is compiled"
            else:
                text = "the physics is being compiled: samples are kept and not yet processed"
            yield Problem(WARN, "compiling", text)
        yield from sample_problems(pipeline, health, self._is_new)
        if status.timed_out:
            yield Problem(WARN, TIMEOUT, timeout_text(pipeline.scene.timeout))
        if status.state != "active":
            yield Problem(WARN, f"state {status.state}", f"the node is {status.state}")

    def _solution(self, pipeline: MessagePipeline, health: Health) -> EncodedStatus:
        connector = pipeline.connector
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
            **_latency_values(connector),
            "saturated": health.saturated,
            "worst residual": f"{health.worst_residual:.3g}",
            "worst offset violation [m]": f"{health.worst_offset:.3g}",
            "worst angular violation [rad]": f"{health.worst_angle:.3g}",
            "worst computing time [s]": f"{health.worst_time:.3g}",
            "flags": flags or "none",
            "stops touched": stops or "none",
            "locked": locked or "none",
            **{f"imposed on {name}": what for name, what in pipeline.commands.imposed.items()},
            "preload [N]": f"{pipeline.commands.preload:g}",
        }
        latency_before, self._latency = self._latency, connector.measured_latency
        uneven = self._is_new("off period of the solution", health.off_period)
        problems = [
            *solution_problems(connector, health, self._is_new, uneven),
            *latency_problem(connector, latency_before),
        ]
        return self._encode("solution", problems, fine, values)

    def _topics(self, pipeline: MessagePipeline | None, status: ConnectionStatus) -> EncodedStatus:
        values: dict[str, object] = {
            "incompatible QoS": len(status.incompatible),
            "other message types": len(status.other_types),
            "dropped messages": sum(status.lost.values()),
            "outputs not published": status.unpublished,
            "failed callbacks": status.failed_callbacks,
        }
        if pipeline is not None:
            values.update({f"{k} messages": n for k, n in pipeline.matcher.received.items()})
        return self._encode("topics", self._topic_problems(pipeline, status), "connected", values)

    def _topic_problems(
        self, pipeline: MessagePipeline | None, status: ConnectionStatus
    ) -> Iterator[Problem]:
        for topic, text in (*status.incompatible.items(), *status.other_types.items()):
            yield Problem(WARN, f"connection {topic}", text)
        for topic, publishers in status.several.items():
            text = (
                f"{topic} has {publishers} publishers, expected one: the last message counts; end "
                "all but one"
            )
            yield Problem(WARN, f"publishers {topic}", text)
        if self._is_new("unpublished", status.unpublished):
            text = f"outputs were not published: {status.unpublished_reason}"
            yield Problem(ERROR, "unpublished", text)
        if self._is_new("failed callbacks", status.failed_callbacks):
            text = f"a callback failed: {status.callback_error}"
            yield Problem(ERROR, text, text)
        for topic, lost in status.lost.items():
            if self._is_new(f"dropped {topic}", lost):
                text = (
                    f"{topic}: messages were dropped ({lost} so far, expected none; the sequence "
                    "numbers have gaps): publish reliable and slower, or let more messages wait "
                    f"with qos_overrides.{topic}.subscription.depth and publisher.depth"
                )
                yield Problem(WARN, f"dropped {topic}", text)
        missing = (
            []
            if pipeline is None or status.compiling
            else missing_topics(pipeline.matcher, pipeline.scene)
        )
        if missing:
            text = f"no message received yet on {', '.join(missing)}"
            yield Problem(WARN, text, text)

    def _recording(self, recorder: Recorder) -> EncodedStatus:
        failure, running = recorder.failure, recorder.running
        text = f"recording failed: {failure}"
        problems = [Problem(ERROR, text, text)] if failure else []
        values = {
            "recording": "yes" if running else "no",
            "directory": recorder.directory or "",
            "messages recorded": recorder.recorded,
            "messages lost": recorder.lost,
        }
        fine = "recording" if running else "not recording"
        return self._encode("recording", problems, fine, values)

    def _is_new(self, name: str, count: int) -> bool:
        """Return True if a count has grown since the last report."""
        before, self._before[name] = self._before.get(name, 0), count
        return count > before

    def _encode(
        self, part: str, problems: Iterable[Problem], fine: str, values: Mapping[str, object]
    ) -> EncodedStatus:
        present, now = list(problems), time.monotonic()
        for problem in present:
            key = f"{part}: {problem.key}"
            if now - self._logged.get(key, -math.inf) > _FORGOTTEN and problem.key != TIMEOUT:
                self._unlogged.append((problem.level, f"{self._name}: {part}: {problem.text}"))
            self._logged[key] = now
        level = max((problem.level for problem in present), default=OK)
        least = WARN if level != OK else OK
        texts = [problem.text for problem in present if problem.level >= least]
        message = "; ".join(texts if level != OK else [fine, *texts])
        return self._encoders[part].encode(level, message, values)


def _latency_values(connector: Connector) -> dict[str, str]:
    """The declared and the measured latency, for diagnostics."""
    measured, declared = connector.measured_latency, connector.scene.latency
    unknown = measured is None
    return {
        "latency [samples]": f"{declared:d}" if declared >= 0 else "measured",
        "measured latency [samples]": "unknown" if unknown else f"{measured:.2f}",
        "spread of the latency [samples]": (
            "unknown" if unknown else f"{connector.latency_spread:.2f}"
        ),
    }
