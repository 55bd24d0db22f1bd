"""Processes that die or stand still: a plant node and a connector node, watched by a third."""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cylconn_ros.bench.faults.fault import ANGLE, OFFSET, Row, sleeve, violation
from cylconn_ros.bench.faults.peer import Peer, Wrench
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.pipeline import POSE
from cylconn_ros.process.programs import Program, program
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.salvage import salvage

_SOON = 60.0  # s for a process to be there again
_ALIVE = 200  # wrenches heard, after which a loop is said to run
PAUSE = 1.0  # s
_LAST = 0.1  # s before its end that a killed node may lose
_LAST_QUICK = 0.5  # s of the short form, which is not to judge how busy a machine is


class Watch:
    """A peer that only listens: wrenches, and the sleeve's violation out of its poses."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.offset = self.angle = 0.0
        self._state = np.zeros(26)
        peer.subscribe("/body_b/pose", POSE, self._pose)

    def _pose(self, data: bytes) -> None:
        self._state[13:20] = cdr_decoder.read_pose(data).values
        offset, angle = violation(self._state)
        self.offset, self.angle = max(self.offset, offset), max(self.angle, angle)

    def runs(self, more: int = _ALIVE, seconds: float = _SOON) -> float:
        """Wait for some more wrenches; seconds until the first of them, infinite for none."""
        count, begin = self.peer.count, time.monotonic()
        first = self.peer.until(lambda: self.peer.count > count, seconds)
        took = time.monotonic() - begin
        enough = self.peer.until(lambda: self.peer.count >= count + more, seconds)
        return took if first and enough else float("inf")

    def judge(self, row: Row) -> None:
        """Violation, into a row."""
        row.say(
            f"offset ≤ {1e3 * self.offset:.2g} mm, angle ≤ {1e3 * self.angle:.2g} mrad",
            offset=self.offset, angle=self.angle,
        )  # fmt: skip
        row.check(self.offset <= OFFSET, "offset")
        row.check(self.angle <= ANGLE, "angle")


@contextmanager
def _loop(folder: Path, peer: Peer, *rules: str) -> Iterator[tuple[Watch, Program, Program]]:
    """Connector and plant in lock step, and who watches them."""
    watch = Watch(peer)
    with (
        program("connector", peer.scene, folder, *rules) as node,
        program("plant", peer.scene, folder, "plant.timeout:=60.0") as moving,
    ):
        if not watch.runs(seconds=300.0) < float("inf"):
            raise RuntimeError(f"no loop: {node.said[-400:]} {moving.said[-400:]}")
        yield watch, node, moving


def rows(folder: Path, quick: bool) -> Iterator[tuple[Row, Peer]]:
    """Every fault of a process, with the peer that looked on; quick: those of the node alone."""
    of_plant = () if quick else (plant_killed, plant_paused)
    killed = functools.partial(node_killed, quick=quick)
    for fault in (*of_plant, node_paused, killed):
        peer = Peer(sleeve())
        try:
            yield fault(folder, peer), peer
        finally:
            peer.close()


def plant_killed(folder: Path, peer: Peer) -> Row:
    """Kill -9 of the simulator, and another one."""
    row = Row("kill -9 of the plant, started anew", "zero wrench meanwhile, then a new history")
    with _loop(folder, peer) as (watch, _, moving):
        moving.kill()
        zero = peer.until(lambda: not any(_newest(peer).values), 5.0)
        row.check(zero, "no zero wrench after timeout")
        with program("plant", peer.scene, folder):
            took = watch.runs()
        restarts = peer.counts()["restarts"]
        row.say(f"answered again {took:.1f} s after its start, {restarts} restart counted",
                recovery=took, restarts=restarts)  # fmt: skip
        row.check(took < float("inf") and restarts == 1, "not answered again, or not counted")
        watch.judge(row)
    return row


def _newest(peer: Peer) -> Wrench:
    newest = peer.wrenches[peer.moving[-1]]
    assert newest is not None
    return newest


def plant_paused(folder: Path, peer: Peer) -> Row:
    """SIGSTOP and SIGCONT of the simulator."""
    row = Row(
        f"plant stands still for {PAUSE:g} s (SIGSTOP)", "one zero wrench, which answers nothing"
    )
    with _loop(folder, peer) as (watch, _, moving):
        with moving.paused():
            zero = peer.until(lambda: not any(_newest(peer).values), 5.0)
            heard = peer.listen()
            peer.hear(PAUSE)
        row.check(zero, "no zero wrench after timeout")
        row.check(len(heard) <= 1, f"{len(heard)} further wrenches")
        took = watch.runs()
        counts = peer.counts()
        row.say(f"goes on after {1e3 * took:.0f} ms, {counts['timeouts']} timeout counted",
                recovery=took, timeouts=counts["timeouts"])  # fmt: skip
        row.check(took < float("inf") and not counts["restarts"], "does not go on where it was")
        watch.judge(row)
    return row


def node_paused(folder: Path, peer: Peer) -> Row:
    """SIGSTOP and SIGCONT of the node; the plant asks again meanwhile."""
    row = Row(f"node stands still for {PAUSE:g} s (SIGSTOP)", "no sample is lost in lock step")
    with _loop(folder, peer) as (watch, node, moving):
        with node.paused():
            peer.hear(PAUSE)
        took = watch.runs()
        counts = peer.counts()
        again = counts["repeated messages"]
        row.say(f"goes on after {1e3 * took:.0f} ms, {again} repeated messages", recovery=took)
        row.check(took < float("inf"), "does not go on")
        row.check(counts["restarts"] == counts["incomplete samples"] == 0, "samples were lost")
        row.check(moving.process.poll() is None, "the plant gave up")
        watch.judge(row)
    return row


def node_killed(folder: Path, peer: Peer, quick: bool) -> Row:
    """Kill -9 of a node that records, and another one; the plant waits and asks again."""
    row = Row("kill -9 of the node while it records, started anew",
              f"all but the last {_LAST:g} s is salvaged; the plant goes on")  # fmt: skip
    record = ("record.enabled:=true", f"record.directory:={folder / 'killed'}")
    with _loop(folder, peer, *record) as (watch, node, moving):
        heard = peer.listen()
        peer.hear(1.0)
        killed = time.time()
        node.kill()
        peer.hear(0.2)
        heard = list(heard)
        begin = time.monotonic()
        with program("connector", peer.scene, folder):
            watch.runs()
            took = time.monotonic() - begin
            alive = moving.process.poll() is None
    (broken,) = (folder / "killed").iterdir()
    run = read_run(salvage(broken).directory)
    kept = {int(stamp) for stamp in run.table("/body_b/wrench").stamp}
    missing = [wrench for wrench in heard if wrench.stamp not in kept]
    lost = max(0.0, killed - min((wrench.when for wrench in missing), default=killed))
    row.say(
        f"{len(missing)} of {len(kept) + len(missing)} samples lost, of the last"
        f" {1e3 * lost:.0f} ms; the loop runs {took:.1f} s after the new start",
        lost=len(missing), seconds_lost=lost, recovery=took,
    )  # fmt: skip
    row.check(lost <= (_LAST_QUICK if quick else _LAST), f"more than {_LAST:g} s lost")
    row.check(alive and took < _SOON, "the plant did not go on")
    watch.judge(row)
    return row
