"""What /diagnostics says about the connector, once a second (REP-107)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cylconn_ros.core import layout
from cylconn_ros.ros.answering import Answering
from cylconn_ros.ros.health import Health
from cylconn_ros.ros.recording import Recorder

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

_REGIMES = {layout.FRICTIONLESS: "frictionless", layout.STICK: "stick", layout.SLIP: "slip"}
_FLAGS = {
    layout.UNDERSAMPLED: "undersampled",
    layout.TURN_AMBIGUOUS: "turn ambiguous",
    layout.TWIST_CONTRADICTS: "twist contradicts the poses",
    layout.HALF_TURN: "misaligned by half a turn",
    layout.LIMITED: "limited",
    layout.SEVERAL_ROOTS: "several solutions",
    layout.JAMMED: "jammed",
    layout.STOPPED: "stopped",
    layout.MISALIGNED: "pulling in",
    layout.GAINS_LOWERED: "gains lowered",
    layout.INTEGRATION: "plant_integration does not fit",
}
_STOPS = {
    1: "length min",
    2: "length max",
    4: "angle min",
    8: "angle max",
}  # bits, as in the message
_LOCKS = {1: "slide", 2: "spin"}
# Worth a warning: the answer may not be what the user expects.
_WORRYING = (
    layout.UNDERSAMPLED
    | layout.TURN_AMBIGUOUS
    | layout.TWIST_CONTRADICTS
    | layout.MISALIGNED
    | layout.GAINS_LOWERED
    | layout.INTEGRATION
)


def _named(names: Mapping[int, str], bits: int) -> str:
    return ", ".join(text for bit, text in names.items() if bits & bit)


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


class Monitor:
    """Turn counts into diagnostics; what happened since the last report decides the level."""

    def __init__(self, node_name: str) -> None:
        self._name = node_name
        self._before: dict[str, int] = {}
        self._time = time.monotonic()

    def report(
        self,
        stamp: Time,
        answering: Answering | None,
        recorder: Recorder | None,
        links: Links,
        health: Health | None = None,
    ) -> DiagnosticArray:
        """Report on everything; ``health`` as taken from ``answering``, if not here and now.

        On the recording only where ``recorder`` is given.
        """
        now = time.monotonic()
        elapsed, self._time = max(now - self._time, 1e-9), now
        array = DiagnosticArray()
        array.header.stamp = stamp
        if answering is not None:
            health = health or answering.health.taken()
            array.status.append(self._samples(answering, health, links, elapsed))
            array.status.append(self._solution(answering, health))
        array.status.append(self._topics(answering, links))
        if recorder is not None:
            array.status.append(self._recording(recorder))
        return array

    def _samples(
        self, answering: Answering, health: Health, links: Links, elapsed: float
    ) -> DiagnosticStatus:
        counts = answering.matcher.counts
        before = self._before.get("samples", 0)
        rate = (counts.samples - before) / elapsed
        problems = [
            (ERROR, self._new("failed", health.failed), f"computing failed: {health.failure}"),
            (ERROR, self._new("non-finite", health.not_finite), "input is not finite"),
            (
                ERROR,
                self._new("bad quaternion", health.bad_quaternion),
                "an orientation cannot be normalised",
            ),
            (
                ERROR,
                self._new("undecodable", health.undecodable),
                f"a message cannot be decoded: {health.undecodable_text}",
            ),
            (
                WARN,
                self._new("refused", health.refused),
                f"a command cannot be followed: {health.refusal}",
            ),
            (WARN, self._new("no period", health.no_period), "no time step between samples yet"),
            (
                WARN,
                self._new("off period", health.off_period),
                f"stamps are {health.seen_period:g} s apart, "
                f"but period says {answering.scene.period:g} s",
            ),
            (WARN, self._new("late", counts.late), "messages arrive late"),
            (WARN, self._new("incomplete", counts.incomplete), "samples stay incomplete"),
            (WARN, self._new("restarts", counts.restarts), "stamps went back: a new history"),
            (
                WARN,
                self._new("foreign frames", counts.foreign_frames),
                "a frame_id names no frame of the scene",
            ),
            (WARN, links.silent, "no complete sample for longer than timeout: zero wrench"),
            (WARN, links.state != "active", f"the node is {links.state}"),
        ]
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
        self._before["samples"] = counts.samples
        return self._status("samples", problems, f"{rate:.0f} samples/s", values)

    def _solution(self, answering: Answering, health: Health) -> DiagnosticStatus:
        regime = _REGIMES.get(health.regime, str(health.regime))
        flags = _named(_FLAGS, health.flags)
        stops, locked = _named(_STOPS, health.stops), _named(_LOCKS, health.lock)
        fine = f"{answering.connector.method}, {regime}"
        fine += f", at stop: {stops}" if stops else ""
        fine += f", locked: {locked}" if locked else ""
        problems = [
            (WARN, bool(health.flags & bit), _FLAGS[bit]) for bit in _FLAGS if bit & _WORRYING
        ]
        saturated = self._new("saturated", health.saturated)
        problems.append((WARN, saturated, "wrenches are scaled down to the limits"))
        values = {
            "method": answering.connector.method,
            "model": answering.connector.model,
            "regime": regime,
            "latency [samples]": answering.connector.late,
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
        return self._status("solution", problems, fine, values)

    def _topics(self, answering: Answering | None, links: Links) -> DiagnosticStatus:
        missing = () if answering is None else answering.matcher.missing
        problems = [
            (WARN, True, f"incompatible QoS on {topic}: {policy}; its messages do not arrive")
            for topic, policy in links.incompatible.items()
        ]
        problems += [
            (WARN, True, f"another message type on {topic}: {types}; its messages do not arrive")
            for topic, types in links.other_types.items()
        ]
        problems += [
            (ERROR, self._new("unsent", links.unsent), f"not published: {links.unsent_text}"),
            (ERROR, self._new("caught", links.caught), f"a callback failed: {links.caught_text}"),
            (WARN, self._new("dropped", links.lost), "messages were dropped on the way"),
        ]
        if missing:
            problems.append((WARN, True, f"nothing received yet on {', '.join(missing)}"))
        values: dict[str, object] = {
            "incompatible QoS": len(links.incompatible),
            "other message types": len(links.other_types),
            "dropped messages": links.lost,
            "answers not published": links.unsent,
            "failed callbacks": links.caught,
        }
        if answering is not None:
            values.update({f"{k} messages": n for k, n in answering.matcher.received.items()})
        return self._status("topics", problems, "connected", values)

    def _recording(self, recorder: Recorder) -> DiagnosticStatus:
        problems = [(ERROR, bool(recorder.failure), f"recording failed: {recorder.failure}")]
        values = {
            "recording": "yes" if recorder.running else "no",
            "directory": recorder.directory or "",
            "messages recorded": recorder.recorded,
            "messages lost": recorder.lost,
        }
        return self._status(
            "recording", problems, "recording" if recorder.running else "not recording", values
        )

    def _new(self, name: str, count: int) -> bool:
        """Whether a count has grown since the last report."""
        before, self._before[name] = self._before.get(name, 0), count
        return count > before

    def _status(
        self,
        part: str,
        problems: list[tuple[bytes, bool, str]],
        fine: str,
        values: Mapping[str, object],
    ) -> DiagnosticStatus:
        present = [(level, text) for level, is_there, text in problems if is_there]
        return DiagnosticStatus(
            level=max((level for level, _ in present), default=OK),
            name=f"{self._name}: {part}",
            message="; ".join(text for _, text in present) or fine,
            hardware_id=self._name,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
