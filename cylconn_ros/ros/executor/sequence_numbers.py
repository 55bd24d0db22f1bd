"""Count lost messages of a topic by the gaps in the publisher's sequence numbers.

A full queue drops its oldest messages without notice, and the middleware's own message_lost event
cannot be used (ros/qos.py).
"""

from __future__ import annotations

from collections.abc import Callable

_MOST = 8  # publishers of one topic that are distinguished


class SequenceNumbers:
    """Follow the sequence numbers of one topic's messages.

    Attributes
    ----------
        expected: number of the next message if none is lost. If the next message has another
            number, :meth:`out_of_sequence` is to be called.
    """

    def __init__(self, lost: Callable[[int], object]) -> None:
        """``lost`` is called with the number of missing messages."""
        self._lost = lost
        self._others: list[int] = []  # next numbers of other publishers of the topic
        self.expected = -1  # no message yet

    def check(self, number: int | None) -> None:
        """Process the number of the next message."""
        if number == self.expected:
            self.expected += 1
        else:
            self.out_of_sequence(number)

    def out_of_sequence(self, number: int | None) -> None:
        """Process a number that was not expected; None if the middleware has no numbers."""
        if number is None:
            return
        if self.expected >= 0 and number in self._others:  # publishers take turns
            self._others.remove(number)
            self._others.append(self.expected)
        elif 0 <= self.expected < number and not self._others:
            self._lost(number - self.expected)
        elif self.expected >= 0:  # one more publisher, or the same one restarted
            self._others = [*self._others, self.expected][-_MOST:]
        self.expected = number + 1
