"""Samples that come again, in another order, not at all, at other times, or from elsewhere."""

from __future__ import annotations

import functools
import random
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np

from cylconn_ros.bench.faults.fault import Exchange, Row
from cylconn_ros.bench.faults.peer import Array, Messages, Peer

_PAUSE = 50  # samples that a paused simulator repeats
_BACK = 0.3  # s
_AWAY = (0.1, 0.02, -0.01)  # m
_PULLED_IN = 400  # samples, for what was teleported: 22 mm at 0.1 m/s, and some


class Stamps:
    """Closed loops over faulty ways, each a history of its own, with the node ``peer`` has met."""

    def __init__(self, peer: Peer, quick: bool) -> None:
        self.peer = peer
        self.steps = 150 if quick else 1500
        self.exchange = Exchange(peer)
        self._chance = random.Random(9)
        self._held: Messages = []  # to be sent after the next

    def all(self) -> Iterator[Row]:
        """Every fault."""
        yield self.repeated()
        yield self._lossy("10 % of the samples lost", self._lose)
        yield self._lossy("10 % come after the next one", self._swap)
        yield self.jitter()
        yield self.paused()
        yield self.back()
        yield self.anew()
        yield self.teleported()

    def _row(self, fault: str, expected: str = "constraint and energy kept") -> Row:
        self.exchange.anew()
        self.exchange.sent = self.exchange.unanswered = 0
        return Row(fault, expected)

    def repeated(self) -> Row:
        """Every sample three times."""
        row = self._row("every sample three times", "the same answer again, nothing advances")
        ours, before = self.exchange, self.peer.counts()
        other = 0
        for _ in range(self.steps):
            ours.ask()
            first, come = ours.wrench, self.peer.count + 1
            for _ in range(2):
                ours.ask(wait=False)
            self.peer.until(functools.partial(self._came, come), 5.0)
            other += not np.array_equal(first, ours.wrench)
            ours.move()
        after = self.peer.counts()
        again = after["answered again"] - before["answered again"]
        row.say(f"{again} answered again, {other} of them otherwise", again=again)
        row.check(again >= self.steps and not other, "not the same again")
        ours.judge(row)
        return row

    def _came(self, count: int) -> bool:
        return self.peer.count >= count

    def _lossy(self, fault: str, way: Callable[[int], None]) -> Row:
        row = self._row(fault)
        for k in range(self.steps):
            way(k)
            self.exchange.move()
        row.say(f"{self.exchange.sent} of {self.steps} sent", sent=self.exchange.sent)
        self.exchange.judge(row)
        return row

    def _lose(self, step: int) -> None:
        if not step or self._chance.random() >= 0.1:
            self.exchange.ask()

    def _swap(self, step: int) -> None:
        """Hold a sample back until the next one has gone."""
        ours = self.exchange
        if step and not self._held and self._chance.random() < 0.1:
            self._held = self.peer.sample(ours.stamp, ours.bodies.state)
            return
        ours.ask()
        self.peer.send(self._held)
        self._held = []

    def jitter(self) -> Row:
        """Periods of 0.7 to 1.3 times what the node is told."""
        row = self._row("30 % jitter of the period")
        for _ in range(self.steps):
            self.exchange.ask()
            self.exchange.move(stretch=1.0 + 0.3 * self._chance.uniform(-1.0, 1.0))
        row.say(f"{self.peer.counts()['off period']} samples off the period counted")
        self.exchange.judge(row)
        return row

    def paused(self) -> Row:
        """The simulator repeats a sample many times, then goes on."""
        row = self._row(f"clock paused: a sample {_PAUSE} times")
        ours = self.exchange
        ours.run(self.steps // 2)
        for _ in range(_PAUSE):
            ours.ask()
        ours.run(self.steps // 2)
        ours.judge(row)
        return row

    def back(self) -> Row:
        """Stamps jump back while the bodies go on."""
        row = self._row(f"clock back by {_BACK:g} s", "a new history; constraint kept")
        ours, before = self.exchange, self.peer.counts()["restarts"]
        ours.run(max(self.steps // 2, round(1.2 * _BACK / ours.period * 1e9)))
        ours.stamp -= round(_BACK * 1e9)
        row.say(f"next sample answered in {1e3 * ours.recovered():.1f} ms")
        ours.run(self.steps // 2)
        found = self.peer.counts()["restarts"] - before
        row.say(f"{found} restart counted", restarts=found)
        row.check(found >= 1, "not counted")
        ours.judge(row)
        return row

    def anew(self) -> Row:
        """The simulator begins again where it began."""
        row = self._row("simulator begins anew", "a new history; constraint kept")
        ours, before = self.exchange, self.peer.counts()["restarts"]
        ours.run(self.steps // 2)
        ours.anew()
        ours.run(self.steps // 2)
        found = self.peer.counts()["restarts"] - before
        row.say(f"{found} restarts counted", restarts=found)
        row.check(found >= 1, "not counted")
        ours.judge(row)
        return row

    def teleported(self) -> Row:
        """B is put elsewhere; it is pulled in at no more than reference.pull_in_speed."""
        speed = self.peer.scene.reference.pull_in_speed
        row = self._row("body teleported by (100, 20, −10) mm", f"pulled in at ≤ {speed:g} m/s")
        ours = self.exchange
        ours.run(self.steps // 2)
        ours.bodies.state[13:16] += _AWAY
        ours.settle()
        ours.run(_PULLED_IN)
        row.say(f"offset changes by ≤ {ours.speed:.3f} m/s", pull_in_speed=ours.speed)
        row.check(ours.speed <= 1.01 * speed, "pulled in too fast")
        ours.settle()
        ours.run(self.steps // 2)
        ours.judge(row)
        return row


def late(peer: Peer, samples: int, steps: int) -> Row:
    """Wrenches that act so many samples after theirs; the node is told, or not, by its scene."""
    told = peer.scene.latency
    how = {0: "not told", -1: "measured"}.get(told, "told")
    expected = "constraint kept" if told else "diverges, and nothing that is not finite goes out"
    row = Row(f"wrenches {samples} samples late, {how}", expected)
    ours = Exchange(peer)
    way: deque[Array] = deque([np.zeros(6)] * samples)
    settled = steps // 4
    for k in range(steps):
        if k == settled and told:
            ours.settle()
        ours.ask()
        way.append(ours.wrench.copy())
        ours.move(way.popleft())
        if not np.isfinite(ours.bodies.state).all() or ours.offset > 1e3:
            row.say(f"apart by more than 1 km after {k} samples")
            break
    if told:
        ours.judge(row)
    else:
        row.say(f"offset {ours.offset:.2g} m", offset=ours.offset)
    return row


def misaligned(peer: Peer, steps: int) -> Row:
    """A body that is far off at the start: bounded rates, and not one impulse."""
    reference, limits = peer.scene.reference, peer.scene.limits
    row = Row(
        "30° and 50 mm off at the start",
        f"pulled in at ≤ {reference.pull_in_speed:g} m/s, wrench within its limits",
    )
    ours = Exchange(peer)
    ours.run(steps)
    row.say(
        f"offset changes by ≤ {ours.speed:.3f} m/s; force ≤ {ours.force:.4g} N of {limits.force:g},"
        f" torque ≤ {ours.torque:.4g} N·m of {limits.torque:g}",
        force=ours.force, torque=ours.torque, speed=ours.speed,
    )  # fmt: skip
    row.check(ours.force <= limits.force * (1 + 1e-12), "beyond limits.force")
    row.check(ours.torque <= limits.torque * (1 + 1e-12), "beyond limits.torque")
    row.check(ours.speed <= 1.01 * reference.pull_in_speed, "pulled in too fast")
    ours.settle()
    ours.run(steps // 4)
    ours.judge(row)
    return row
