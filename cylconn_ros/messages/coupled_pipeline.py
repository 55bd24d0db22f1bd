"""Connectors that share bodies: their samples are put together and answered at once.

Each of them matches its own messages. What it has complete waits here until all have the sample of
that stamp; then the group answers. Samples that stay incomplete are given up when a newer one is
answered, and counted as each connector counts its own.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from cylconn_ros.connector.group import Group
from cylconn_ros.connector.synchronizer import Matched
from cylconn_ros.core import layout
from cylconn_ros.messages.pipeline import ANY_SAMPLE, Answer, Answering

_MOST_WAITING = 64  # samples: more than a queue of 50 messages can hold


class _Waiting:
    """A sample that some have complete."""

    def __init__(self, number: int) -> None:
        self.samples = np.zeros((number, layout.NSAMPLE))
        self.came: set[int] = set()


class Together:
    """Answer the samples of several connectors together.

    Attributes
    ----------
        group: what solves. answers: of the last sample, by connector, until somebody takes them;
        that of the connector whose message completed it is not among them.
    """

    def __init__(self, members: Sequence[Answering]) -> None:
        """Take the members' connectors and histories over; from now on they answer together."""
        self._members = list(members)
        scenes = [member.scene for member in members]
        Group(scenes).step(np.tile(ANY_SAMPLE, (len(members), 1)), 1e-3)  # compiled now
        self.group = Group(scenes, [member.connector for member in members])
        self._outs = np.zeros((len(members), layout.NOUT))
        self._waiting: dict[int, _Waiting] = {}
        self._last: int | None = None
        self.answers: dict[int, Answer] = {}
        for k, member in enumerate(self._members):
            member.solve = functools.partial(self._came, k)

    def forget(self) -> None:
        """Forget what waits and all history."""
        self.group.reset()
        self._waiting.clear()
        self._last = None

    def taken(self) -> dict[int, Answer]:
        """The answers of the others to the last sample, once."""
        answers, self.answers = self.answers, {}
        return answers

    def _came(self, k: int, matched: Matched, begin: float) -> Answer | None:
        """Take a complete sample of member ``k``; its answer where it is the last to have it."""
        stamp = matched.stamp
        if matched.restarted and self._last is not None and stamp <= self._last:
            self.forget()
        if self._last is not None and stamp <= self._last:
            self._members[k].matcher.counts.incomplete += 1
            return None
        slot = self._waiting.setdefault(stamp, _Waiting(len(self._members)))
        slot.samples[k] = self._members[k].matcher.sample
        slot.came.add(k)
        if len(slot.came) < len(self._members):
            if len(self._waiting) > _MOST_WAITING:
                self._give_up(min(self._waiting))
            return None
        del self._waiting[stamp]
        for older in [other for other in self._waiting if other < stamp]:
            self._give_up(older)
        h = 0.0 if self._last is None else (stamp - self._last) * 1e-9
        self._last = stamp
        self.group.step(slot.samples, h, self._outs)
        found = {}
        for j, member in enumerate(self._members):
            member.out[:] = self._outs[j]
            found[j] = member.finish(stamp, h, begin)
        own = found.pop(k)
        self.answers = found
        return own

    def _give_up(self, stamp: int) -> None:
        for k in self._waiting.pop(stamp).came:
            self._members[k].matcher.counts.incomplete += 1
