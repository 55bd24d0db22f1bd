"""Pipeline of connectors that share bodies: they are solved together, one stamp at a time.

Each connector synchronises its own messages. Its complete sample waits here until all connectors
have the sample of that stamp; then the group solves them together. A sample that not all connectors
have is dropped when a newer one is solved, and counted as an incomplete sample of its connector.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from cylconn_ros.connector.group import Group
from cylconn_ros.connector.synchronized_sample import SynchronizedSample
from cylconn_ros.core import layout
from cylconn_ros.messages.output_messages import VALID_SAMPLE
from cylconn_ros.messages.pipeline import MessagePipeline, Response

_MAX_WAITING = 64  # samples: more than a queue of 50 messages can hold


class _PartialSample:
    """The samples of one stamp, of the connectors that have it complete."""

    def __init__(self, count: int) -> None:
        self.samples = np.zeros((count, layout.NSAMPLE))
        self.complete: set[int] = set()


class CoupledPipeline:
    """Process the samples of several connectors together.

    Attributes
    ----------
        group: solves the connectors. responses: to the last sample, by connector, until
            :meth:`take_responses`; without that of the connector whose message completed it.
    """

    def __init__(self, members: Sequence[MessagePipeline]) -> None:
        """Adopt the connectors and histories of ``members``, which are solved together from now."""
        self._members = list(members)
        scenes = [member.scene for member in members]
        Group(scenes).step(np.tile(VALID_SAMPLE, (len(members), 1)), 1e-3)  # compile now
        self.group = Group(scenes, [member.connector for member in members])
        self._outs = np.zeros((len(members), layout.NOUT))
        self._waiting: dict[int, _PartialSample] = {}
        self._last: int | None = None
        self.responses: dict[int, Response] = {}
        for k, member in enumerate(self._members):
            member.solve_coupled = functools.partial(self._add, k)

    def reset(self) -> None:
        """Forget waiting samples and the history."""
        self.group.reset()
        self._waiting.clear()
        self._last = None

    @property
    def is_partial(self) -> bool:
        """Whether a sample waits for those of other connectors."""
        return bool(self._waiting)

    def take_responses(self) -> dict[int, Response]:
        """Remove and return the responses of the other connectors to the last sample."""
        responses, self.responses = self.responses, {}
        return responses

    def _add(self, k: int, sample: SynchronizedSample, begin: float) -> Response | None:
        """Add a complete sample of member ``k``; its response if all members now have it."""
        stamp = sample.stamp
        if sample.restarted and self._last is not None and stamp <= self._last:
            self.reset()
        if self._last is not None and stamp <= self._last:
            self._members[k].matcher.counts.incomplete += 1
            return None
        partial = self._waiting.setdefault(stamp, _PartialSample(len(self._members)))
        partial.samples[k] = self._members[k].matcher.sample
        partial.complete.add(k)
        if len(partial.complete) < len(self._members):
            if len(self._waiting) > _MAX_WAITING:
                self._drop(min(self._waiting))
            return None
        del self._waiting[stamp]
        for older in [other for other in self._waiting if other < stamp]:
            self._drop(older)
        h = 0.0 if self._last is None else (stamp - self._last) * 1e-9
        self._last = stamp
        self.group.step(partial.samples, h, self._outs)
        responses = {}
        for j, member in enumerate(self._members):
            member.out[:] = self._outs[j]
            responses[j] = member.finish(stamp, h, begin)
        own = responses.pop(k)
        self.responses = responses
        return own

    def _drop(self, stamp: int) -> None:
        for k in self._waiting.pop(stamp).complete:
            self._members[k].matcher.counts.incomplete += 1
