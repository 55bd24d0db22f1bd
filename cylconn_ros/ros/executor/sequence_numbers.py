"""Messages that were sent and never taken: seen by the gaps in their publisher's numbers.

A full queue forgets its oldest messages without a word, and what a middleware tells of messages
that it has lost itself is not to be relied on (ros/qos.py).
"""

from __future__ import annotations

from collections.abc import Callable

_MOST = 8  # publishers of one topic that are told apart


class Gaps:
    """Watch the numbers of one topic's messages.

    Attributes
    ----------
        expected: the number that the next message has where nothing is missing; where it has
            another one, :meth:`apart` is to be called.
    """

    def __init__(self, report: Callable[[int], object]) -> None:
        """``report`` is told how many are missing."""
        self._report = report
        self._others: list[int] = []  # what other publishers of the topic send next
        self.expected = -1  # nothing has come

    def look(self, number: int | None) -> None:
        """Take the next number."""
        if number == self.expected:
            self.expected += 1
        else:
            self.apart(number)

    def apart(self, number: int | None) -> None:
        """Take a number that was not expected; None from a middleware without numbers."""
        if number is None:
            return
        if self.expected >= 0 and number in self._others:  # publishers take turns
            self._others.remove(number)
            self._others.append(self.expected)
        elif 0 <= self.expected < number and not self._others:
            self._report(number - self.expected)
        elif self.expected >= 0:  # one more publisher, or the same started anew
            self._others = [*self._others, self.expected][-_MOST:]
        self.expected = number + 1
