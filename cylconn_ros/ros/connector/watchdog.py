"""When samples have stopped, and when to look next whether they have."""

from __future__ import annotations

import enum

SOON, LONGEST = 0.1, 1.0  # s between looks, without samples and with them


class News(enum.Enum):
    """What a look has found."""

    NONE = enum.auto()
    STOPPED = enum.auto()  # no sample within the timeout; told once for a last sample
    BACK = enum.auto()


class Silence:
    """Tell when the timeout after a sample is over, with as few looks as that takes.

    While samples come, nothing can be over before the last one's timeout is. After that, looks are
    so close that each new sample is seen within its own timeout. Times are of the steady clock, as
    simulated time stops with the samples.

    Attributes
    ----------
        silent: samples have stopped. due: when to look again (s).
    """

    def __init__(self) -> None:
        self.silent = False
        self.due = 0.0
        self._told: float | None = None  # when the last sample was answered that was the last

    def forget(self) -> None:
        """Begin anew: no sample has been answered yet."""
        self.silent, self.due = False, 0.0

    def look(self, now: float, answered: float | None, timeout: float) -> News:
        """Look at ``now``; the last sample was ``answered`` then, or none (s)."""
        self.due = now + min(timeout, SOON)
        if answered is None:
            return News.NONE
        end = answered + timeout
        if now < end:
            self.due = min(end, now + LONGEST)
            back, self.silent = self.silent, False
            return News.BACK if back else News.NONE
        self.silent = True
        if self._told == answered:
            return News.NONE
        self._told = answered
        return News.STOPPED
