"""Why no sample becomes complete though messages arrive: said, not left to be guessed."""

from __future__ import annotations

from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.scene.scene import Scene

PATIENCE = 2.0  # s with messages and without a complete sample before the first word
_AGAIN = 30.0  # s between further ones


class Waiting:
    """Watch for messages that make no sample, from the start of a history to its first sample."""

    def __init__(self) -> None:
        self._begin: float | None = None  # when the first messages of this history were seen
        self._before: dict[str, int] = {}  # messages received until then
        self._next = PATIENCE

    def look(self, matcher: SampleMatcher, scene: Scene, now: float) -> str:
        """What there is to say at ``now`` (s, steady clock); mostly nothing."""
        if matcher.last_stamp is not None:
            self._begin, self._before = None, dict(matcher.received)
            return ""
        news = {n: k - self._before.get(n, 0) for n, k in matcher.received.items()}
        if self._begin is None:
            self._begin = now if any(news.values()) else None
            self._next = now + PATIENCE
        if self._begin is None or now < self._next:
            return ""
        self._next = now + _AGAIN
        came = ", ".join(f"{_topic(scene, name)} {count}" for name, count in news.items() if count)
        why = _why(matcher, scene)
        return f"no complete sample in {now - self._begin:.0f} s; messages: {came}; {why}"


def _why(matcher: SampleMatcher, scene: Scene) -> str:
    missing = dict.fromkeys(_topic(scene, name) for name in matcher.missing)
    if missing:
        return f"nothing on {', '.join(missing)}"
    apart = matcher.apart
    if apart is None:
        return "what belongs to one sample never waits together: are its stamps alike?"
    text = f"their stamps are at least {apart * 1e-9:g} s apart"
    if scene.period and apart * 1e-9 >= 0.5 * scene.period:
        return f"{text}, half a period or more: pose and twist of a sample must carry one stamp"
    return f"{text}: set stamp_tolerance, now {scene.stamp_tolerance:g} s, to more than that"


def _topic(scene: Scene, stream: str) -> str:
    return stream.partition("/")[0] + "/odom" if scene.input == "odometry" else stream
