"""Messages that arrive while the physics is being compiled: kept, counted, processed afterwards."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable

from cylconn_ros.ros.qos import INPUT_DEPTH

Receive = Callable[[bytes], object]


class HeldMessages:
    """The latest messages of each input, as many as its queue holds, in order of arrival.

    Attributes
    ----------
        active: whether messages are to be held.
        received: messages held or dropped so far, by input.
    """

    def __init__(self) -> None:
        self.active = False
        self.received: Counter[Hashable] = Counter()
        self._arrivals = 0
        self._queues: dict[Hashable, deque[tuple[int, Receive, bytes]]] = {}

    def add(self, source: Hashable, receive: Receive, data: bytes) -> None:
        """Hold a message of an input, and the function that is to process it."""
        self.received[source] += 1
        self._arrivals += 1
        queue = self._queues.setdefault(source, deque(maxlen=INPUT_DEPTH))
        queue.append((self._arrivals, receive, data))

    def samples(self, sources: Iterable[Hashable]) -> int:
        """Samples that have arrived: messages of the input among ``sources`` that has fewest."""
        return min((self.received[source] for source in sources), default=0)

    @property
    def dropped(self) -> int:
        """Messages that are no longer held, because newer ones have arrived."""
        return sum(self.received.values()) - sum(map(len, self._queues.values()))

    def clear(self) -> None:
        """Drop all messages and begin to count again."""
        self.received.clear()
        self._queues.clear()

    def release(self) -> list[tuple[Receive, bytes]]:
        """Return the messages in order of arrival, and hold none from now on."""
        held = sorted(
            (one for queue in self._queues.values() for one in queue), key=lambda one: one[0]
        )
        self.active = False
        self.clear()
        return [(receive, data) for _, receive, data in held]
