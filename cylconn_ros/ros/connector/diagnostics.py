"""Diagnostics of a connector on /diagnostics, once per second (REP-107)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Iterator, Mapping

from diagnostic_msgs.msg import DiagnosticStatus

from cylconn_ros.connector import enums
from cylconn_ros.connector.enums import named
from cylconn_ros.core import layout
from cylconn_ros.messages.health import Health
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.ros.connector.diagnostics_encoder import EncodedStatus, StatusEncoder
from cylconn_ros.ros.connector.recorder import Recorder
from cylconn_ros.ros.connector.watchdog import missing_topics
from cylconn_ros.scene.inputs import BODIES
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

OK, WARN, ERROR = (
    level[0] for level in (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)
)

_OTHER_INTEGRATION = {"exact": "semi_implicit", "semi_implicit": "exact"}


@dataclasses.dataclass
class ConnectionStatus:
    """State of the topics, of the callbacks and of the lifecycle."""

    incompatible: dict[str, str] = dataclasses.field(default_factory=dict)  # warning by topic
    other_types: dict[str, str] = dataclasses.field(default_factory=dict)  # warning by topic
    lost: int = 0  # messages sent and never received
    timeouts: int = 0  # zero wrenches sent after an input timeout
    unpublished: int = 0  # outputs that the middleware did not accept
    unpublished_reason: str = ""
    failed_callbacks: int = 0  # callbacks that raised
    callback_error: str = ""
    timed_out: bool = False  # no sample within the timeout
    state: str = "unconfigured"  # of the lifecycle


Problem = tuple[int, str]
"""A level and a text."""


def timeout_text(timeout: float) -> str:
    """Warning about an input timeout (s)."""
    return f"input timeout ({timeout:g} s): commanding zero wrench"


class Monitor:
    """Turn counts into diagnostics; events since the last report decide the level."""

    def __init__(self, node_name: str) -> None:
        self._encoders = {
            part: StatusEncoder(f"{node_name}: {part}", node_name)
            for part in ("samples", "solution", "topics", "recording")
        }
        self._before: dict[str, int] = {}
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
            "non-finite": health.not_finite,
            "bad quaternion": health.bad_quaternion,
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
        problems = self._sample_problems(pipeline, health, status)
        return self._encode("samples", problems, f"{rate:.0f} samples/s", values)

    def _sample_problems(
        self, pipeline: MessagePipeline, health: Health, status: ConnectionStatus
    ) -> Iterator[Problem]:
        counts, scene = pipeline.matcher.counts, pipeline.scene
        if self._is_new("failed", health.failed):
            yield ERROR, f"computing a sample failed: {health.failure}; commanding zero wrench"
        if self._is_new("non-finite", health.not_finite):
            yield ERROR, "pose, twist or load is not finite: commanding zero wrench"
        if self._is_new("bad quaternion", health.bad_quaternion):
            yield ERROR, "orientation cannot be normalised (length 0): commanding zero wrench"
        if self._is_new("undecodable", health.undecodable):
            yield ERROR, f"a message cannot be decoded, ignored: {health.undecodable_text}"
        if self._is_new("refused", health.refused):
            yield WARN, f"command refused: {health.refusal}"
        if self._is_new("no period", health.no_period):
            yield WARN, "no time step between samples yet (period = 0.0: taken from the stamps)"
        if self._is_new("off period", health.off_period):
            yield (
                WARN,
                (
                    f"stamps are {health.seen_period:g} s apart, period is {scene.period:g} s; "
                    "set period to the spacing of the stamps, or to 0.0 to take it from them"
                ),
            )
        if self._is_new("late", counts.late):
            yield WARN, "messages older than the last sample arrive late, ignored"
        if self._is_new("incomplete", counts.incomplete):
            yield WARN, _incomplete_text(pipeline)
        if self._is_new("restarts", counts.restarts):
            yield WARN, "stamps went back: restarted with a new reference configuration"
        if self._is_new("unknown frame_ids", counts.unknown_frames):
            yield WARN, _unknown_frame_text(pipeline)
        if status.timed_out:
            yield WARN, timeout_text(scene.timeout)
        if status.state != "active":
            yield WARN, f"the node is {status.state}"

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
            "latency [samples]": connector.latency,
            "saturated": health.saturated,
            "worst residual": f"{health.worst_residual:.3g}",
            "worst offset violation [m]": f"{health.worst_offset:.3g}",
            "worst angular violation [rad]": f"{health.worst_angle:.3g}",
            "worst computing time [s]": f"{health.worst_time:.3g}",
            "flags": flags or "none",
            "stops touched": stops or "none",
            "locked": locked or "none",
            **{f"imposed on {name}": what for name, what in pipeline.imposed.items()},
        }
        problems = self._solution_problems(pipeline.scene, health)
        return self._encode("solution", problems, fine, values)

    def _solution_problems(self, scene: Scene, health: Health) -> Iterator[Problem]:
        for flag, text in _flag_texts(scene, health):
            if health.flags & flag:
                yield WARN, text
        if self._is_new("saturated", health.saturated):
            yield (
                WARN,
                (
                    f"wrenches are scaled down to the limits (limits.force = "
                    f"{show(scene.limits.force)} N, limits.torque = {show(scene.limits.torque)} Nm)"
                ),
            )

    def _topics(self, pipeline: MessagePipeline | None, status: ConnectionStatus) -> EncodedStatus:
        values: dict[str, object] = {
            "incompatible QoS": len(status.incompatible),
            "other message types": len(status.other_types),
            "dropped messages": status.lost,
            "outputs not published": status.unpublished,
            "failed callbacks": status.failed_callbacks,
        }
        if pipeline is not None:
            values.update({f"{k} messages": n for k, n in pipeline.matcher.received.items()})
        return self._encode("topics", self._topic_problems(pipeline, status), "connected", values)

    def _topic_problems(
        self, pipeline: MessagePipeline | None, status: ConnectionStatus
    ) -> Iterator[Problem]:
        for text in (*status.incompatible.values(), *status.other_types.values()):
            yield WARN, text
        if self._is_new("unpublished", status.unpublished):
            yield ERROR, f"outputs were not published: {status.unpublished_reason}"
        if self._is_new("failed callbacks", status.failed_callbacks):
            yield ERROR, f"a callback failed: {status.callback_error}"
        if self._is_new("dropped", status.lost):
            yield WARN, f"input messages were lost ({status.lost} so far): a queue overflowed"
        missing = [] if pipeline is None else missing_topics(pipeline.matcher, pipeline.scene)
        if missing:
            yield WARN, f"no message received yet on {', '.join(missing)}"

    def _recording(self, recorder: Recorder) -> EncodedStatus:
        failure, running = recorder.failure, recorder.running
        problems = [(ERROR, f"recording failed: {failure}")] if failure else []
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
        present = list(problems)
        level = max((level for level, _ in present), default=OK)
        message = "; ".join(text for _, text in present) or fine
        return self._encoders[part].encode(level, message, values)


def _incomplete_text(pipeline: MessagePipeline) -> str:
    missing = missing_topics(pipeline.matcher, pipeline.scene)
    if missing:
        names = ", ".join(missing)
        return f"pose and twist with the same stamp never arrive together (missing: {names})"
    return (
        "samples stay incomplete: pose and twist with the same stamp do not both arrive before "
        "the next sample is complete"
    )


def _unknown_frame_text(pipeline: MessagePipeline) -> str:
    scene, seen = pipeline.scene, pipeline.matcher.unknown_frame
    assert seen is not None
    body = BODIES[seen.body]
    odometry = scene.input == "odometry" and seen.quantity != "load"
    expected = [scene.world_frame]
    if seen.quantity != "pose":
        expected.append(scene.bodies[seen.body].frame)
    field = "child_frame_id" if odometry and seen.quantity == "twist" else "frame_id"
    return (
        f"{body}/{'odom' if odometry else seen.quantity}: unknown {field} {seen.frame!r} "
        f"(expected {' or '.join(repr(frame) for frame in expected)}); "
        f"treated as {seen.axes} axes"
    )


def _flag_texts(scene: Scene, health: Health) -> Iterator[tuple[int, str]]:
    """Flags that call for a warning, with value expected and remedy."""
    bodies = zip(("body_a", "body_b"), scene.bodies, strict=True)
    moving = ", ".join(name for name, body in bodies if body.kind != "fixed")
    yield (
        layout.UNDERSAMPLED,
        "undersampled: rotation per sample is above 0.5 rad; use a shorter period",
    )
    yield (
        layout.TURN_AMBIGUOUS,
        "number of turns is ambiguous: predicted and measured angle differ by more than pi/2; "
        "check the twist, or use a shorter period",
    )
    yield (
        layout.TWIST_CONTRADICTS,
        f"{moving}: twist does not match pose differences; check its axes (frame_id, twist_axes) "
        "and units",
    )
    yield (
        layout.MISALIGNED,
        f"correcting constraint drift: too large for one step (worst: {health.worst_offset:.3g} m, "
        f"{health.worst_angle:.3g} rad)",
    )
    yield (
        layout.GAINS_LOWERED,
        "penalty gains lowered: those in the parameters are unstable at this period",
    )
    yield (
        layout.INTEGRATION,
        f"plant_integration = {scene.plant_integration!r} does not match the motion; measured "
        f"integration is {_OTHER_INTEGRATION[scene.plant_integration]}",
    )
