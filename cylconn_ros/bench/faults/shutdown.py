"""Every way of ending: the last wrench that is heard is zero, and the recording is whole."""

from __future__ import annotations

import math
import resource
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from lifecycle_msgs.srv import ChangeState

from cylconn_ros.bench.faults.fault import Exchange, Row, sleeve
from cylconn_ros.bench.faults.peer import Peer
from cylconn_ros.process.programs import Program, program
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.salvage import salvage

_STREAM = 0.3  # s of samples before the end
_GAP = 0.001  # s between them
_DEACTIVATE, _SHUTDOWN = 4, 7  # lifecycle_msgs/Transition
_FULL = 1_000_000  # bytes that a full disk still takes: several of a recording's pieces of 0.1 s

End = Callable[[Program, Peer], None]


def rows(folder: Path, quick: bool) -> Iterator[tuple[Row, Peer]]:
    """Every ending, with the peer that looked on."""
    ends: dict[str, End] = {
        "SIGINT": lambda node, _: node.signal(signal.SIGINT),
        "SIGTERM": lambda node, _: node.signal(signal.SIGTERM),
        "SIGHUP": lambda node, _: node.signal(signal.SIGHUP),
        "lifecycle deactivate": lambda _, peer: change(peer, _DEACTIVATE),
        "lifecycle shutdown": lambda _, peer: change(peer, _SHUTDOWN),
    }
    if quick:
        ends = {name: ends[name] for name in ("SIGHUP", "lifecycle deactivate")}
    for name, end in ends.items():
        peer = Peer(sleeve())
        try:
            yield ended(folder, peer, name, end), peer
        finally:
            peer.close()
    for fault in (full,) if quick else (silent, full):
        peer = Peer(sleeve())
        try:
            yield fault(folder, peer), peer
        finally:
            peer.close()


def change(peer: Peer, transition: int) -> None:
    """Ask the node for a transition, without waiting for the answer."""
    client = peer.node.create_client(ChangeState, "/connector/change_state")
    if not client.wait_for_service(10.0):
        raise RuntimeError("no lifecycle service")
    request = ChangeState.Request()
    request.transition.id = transition
    client.call_async(request)


def _stream(exchange: Exchange, seconds: float) -> None:
    """Send samples without waiting, moving on under the newest wrench."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        exchange.ask(wait=False)
        exchange.peer.take(round(_GAP * 1e9))
        exchange.move()


def ended(folder: Path, peer: Peer, name: str, end: End) -> Row:
    """End a node while samples stream in."""
    row = Row(f"{name} under load", "a last zero wrench, newer than all; a whole recording")
    place = folder / name.replace(" ", "_")
    with program(
        "connector", peer.scene, folder, "record.enabled:=true", f"record.directory:={place}"
    ) as node:
        peer.meet(node.alive)
        heard = peer.listen()
        exchange = Exchange(peer)
        _stream(exchange, _STREAM)
        end(node, peer)
        _stream(exchange, _STREAM)
        peer.hear(1.0)
        (run,) = place.iterdir()
        row.check(peer.until((run / "metadata.yaml").exists, 10.0), "the recording is not closed")
        ends = "deactivate" not in name
        if ends:
            code = node.wait()
            row.check(code == 0, f"exit code {code}")
        newest = max(wrench.stamp for wrench in heard)
        last = heard[-1]
        zero = not any(last.values)
        row.say(f"{len(heard)} wrenches heard, the last is {'zero' if zero else last.values}",
                heard=len(heard))  # fmt: skip
        row.check(zero, "the last wrench heard is not zero")
        row.check(last.stamp == newest, "the last wrench is not the newest")
        whole = read_run(run)
        recorded = whole.table("/body_b/wrench")
        row.say(f"recording {'whole' if whole.incomplete is None else 'broken'}, "
                f"{len(recorded)} wrenches", recorded=len(recorded))  # fmt: skip
        row.check(whole.incomplete is None, "the recording is not whole")
        row.check(int(recorded.stamp[-1]) == last.stamp, "the last wrench is not recorded")
        row.check(len(recorded) == len(heard), "recorded and heard are not as many")
        row.check("Traceback" not in node.said, "a traceback was printed")
    return row


def silent(folder: Path, peer: Peer) -> Row:
    """Samples stop."""
    timeout = peer.scene.timeout
    row = Row("samples stop", f"zero wrench {timeout:g} s later, and one only")
    with program("connector", peer.scene, folder) as node:
        peer.meet(node.alive)
        exchange = Exchange(peer)
        exchange.run(50)
        heard, begin = peer.listen(), time.monotonic()
        came = peer.until(lambda: heard, 5.0)
        took = time.monotonic() - begin
        peer.hear(5.0 * timeout)
        row.say(f"after {1e3 * took:.0f} ms", after=took)
        row.check(came and not any(heard[0].values), "no zero wrench")
        row.check(len(heard) == 1, f"{len(heard)} wrenches")
        row.check(took >= 0.9 * timeout, "too early")
        took = exchange.recovered()
        row.say(f"next sample answered in {1e3 * took:.1f} ms", recovery=took)
        row.check(math.isfinite(took) and exchange.wrench.any(), "does not go on")
    return row


def full(folder: Path, peer: Peer) -> Row:
    """The disk takes no more; a limit of the file's size stands in for it."""
    row = Row("disk full while recording", "told in diagnostics, losses counted; serves on")
    place = folder / "full"
    with program(
        "connector", peer.scene, folder, "record.enabled:=true", f"record.directory:={place}",
        "record.compression:=none",
    ) as node:  # fmt: skip
        peer.meet(node.alive)
        resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, (_FULL, _FULL))
        exchange = Exchange(peer)
        exchange.run(1500)
        told = peer.until(lambda: peer.status("recording").get("level") == "2", 10.0)
        row.say(f"diagnostics: “{peer.status('recording').get('message', '').partition(': ')[0]}”")
        row.check(told, "not told")
        lost = peer.counts()["messages lost"]
        row.say(f"{lost} messages counted as lost", lost=lost)
        row.check(lost > 0, "losses not counted")
        exchange.run(50)
        row.check(not exchange.unanswered, "does not serve on")
    (run,) = place.iterdir()
    saved = read_run(salvage(run).directory)
    row.say(f"{saved.counts['/body_b/wrench']} samples salvaged")
    row.check(saved.counts["/body_b/wrench"] > 10, "nothing salvaged")
    return row
