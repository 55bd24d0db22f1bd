"""Watch the inputs of a connector: timeout, incomplete samples, samples that wait for loads."""

from __future__ import annotations

import enum
from typing import Final

from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.scene.inputs import carrier
from cylconn_ros.scene.scene import Scene

SOON, LONGEST = 0.1, 1.0  # s, greatest time between checks: after a timeout, and otherwise
PATIENCE = 2.0  # s with messages but no complete sample before the first warning
_AGAIN = 30.0  # s between further warnings


LOAD_WAIT: Final = 0.005
"""Longest wait in s if messages of a newer sample are received; one period if that is shorter."""
LONGEST_LOAD_WAIT: Final = 0.02
"""Longest wait in s: a simulator in lock step sends no newer sample, and loses nothing by it."""


class WatchdogEvent(enum.Enum):
    """Result of a check."""

    NONE = enum.auto()
    TIMEOUT = enum.auto()  # no sample within the timeout; reported once per last sample
    RESUMED = enum.auto()  # samples arrive again after a timeout


class Watchdog:
    """Timeout of the samples, with as few checks as possible.

    While samples arrive, the next check is due when the timeout of the last one ends. After a
    timeout, checks are frequent enough to see each new sample within its own timeout. Times are of
    the steady clock, because simulated time stops with the samples.

    Attributes
    ----------
        timed_out: no sample within the timeout. due: time of the next check (s).
    """

    def __init__(self) -> None:
        self.timed_out = False
        self.due = 0.0
        self._reported: float | None = None  # time of the sample whose timeout was reported

    def reset(self) -> None:
        """Start a new history: no sample was processed yet."""
        self.timed_out, self.due = False, 0.0

    def check(self, now: float, last: float | None, timeout: float) -> WatchdogEvent:
        """Check at ``now``; ``last`` is the time of the last sample, None without one (s)."""
        self.due = now + min(timeout, SOON)
        if last is None:
            return WatchdogEvent.NONE
        end = last + timeout
        if now < end:
            self.due = min(end, now + LONGEST)
            resumed, self.timed_out = self.timed_out, False
            return WatchdogEvent.RESUMED if resumed else WatchdogEvent.NONE
        self.timed_out = True
        if self._reported == last:
            return WatchdogEvent.NONE
        self._reported = last
        return WatchdogEvent.TIMEOUT


class IncompleteSamples:
    """Find out why messages form no sample, from the start of a history to its first sample."""

    def __init__(self) -> None:
        self._begin: float | None = None  # time of the first messages of this history
        self._before: dict[str, int] = {}  # messages received before them
        self._next = PATIENCE

    def check(self, matcher: SampleMatcher, scene: Scene, now: float) -> str:
        """Return a warning with topic, reason and remedy, or '' (``now``: s, steady clock)."""
        if matcher.last_stamp is not None:
            self._begin, self._before = None, dict(matcher.received)
            return ""
        counts = {n: k - self._before.get(n, 0) for n, k in matcher.received.items()}
        if self._begin is None:
            self._begin = now if any(counts.values()) else None
            self._next = now + PATIENCE
        if self._begin is None or now < self._next:
            return ""
        self._next = now + _AGAIN
        received = ", ".join(f"{_topic(scene, name)} {n}" for name, n in counts.items() if n)
        reason = _reason(matcher, scene)
        return f"no complete sample in {now - self._begin:.0f} s; received: {received}; {reason}"


class LoadWait:
    """Find out when a sample has waited for its load long enough (connector/load_history.py)."""

    def __init__(self) -> None:
        self._stamp: int | None = None  # of the sample that waits
        self._since = 0.0

    def is_over(self, pipeline: MessagePipeline, now: float) -> bool:
        """Check the oldest sample that waits at ``now`` (s, steady clock); True if it may not."""
        stamp = pipeline.decoder.waiting
        if stamp is None or stamp != self._stamp:
            self._stamp, self._since = stamp, now
            return False
        waited, period, matcher = now - self._since, pipeline.scene.period, pipeline.matcher
        enough = min(period, LOAD_WAIT) if period else LOAD_WAIT
        if waited >= enough and matcher.last_stamp is not None and matcher.loads.silent:
            return True  # there is a publisher that sends nothing
        return waited >= LONGEST_LOAD_WAIT or (waited >= enough and pipeline.decoder.is_overtaken)


def missing_topics(matcher: SampleMatcher, scene: Scene) -> list[str]:
    """Relative topics of a sample on which no message has arrived."""
    return list(dict.fromkeys(_topic(scene, name) for name in matcher.missing))


def _reason(matcher: SampleMatcher, scene: Scene) -> str:
    together = "pose and twist with the same stamp never arrive together"
    missing = missing_topics(matcher, scene)
    if missing:
        return f"{together} (missing: {', '.join(missing)})"
    offset = matcher.stamp_offset
    if offset is None:
        return f"{together}: check their header stamps"
    text = f"{together}: their stamps differ by at least {offset * 1e-9:g} s"
    if scene.period and offset * 1e-9 >= 0.5 * scene.period:
        return f"{text}, half a period or more; publish both with the same header stamp"
    return f"{text}; set stamp_tolerance (now {scene.stamp_tolerance:g} s) above that"


def _topic(scene: Scene, stream: str) -> str:
    body, _, quantity = stream.partition("/")
    return f"{body}/{carrier(scene.input, quantity).topic}"
