"""Put every fault upon real processes: ``python -m cylconn_ros.bench.faults.run FOLDER [quick]``.

Prints a line of JSON for every fault (bench/faults/fault.py), in an environment of its own.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

from cylconn_ros.bench.faults import processes, shutdown
from cylconn_ros.bench.faults.fault import Row, sleeve
from cylconn_ros.bench.faults.messages import Messages
from cylconn_ros.bench.faults.peer import Peer
from cylconn_ros.bench.faults.stamps import Stamps, late, misaligned
from cylconn_ros.process.programs import program
from cylconn_ros.scene.scene import Scene

_TILT = [0.0, 0.25881904510252074, 0.0, 0.9659258262890683]  # 30 degrees
_FAR = {
    "timeout": 60.0,
    "reference__offsets": "zero",
    "reference__misalignment": "zero",
    "node_b__orientation": [0.0, 0.0, 0.0, 1.0],
    "plant__body_b__pose": [0.2, 0.03, 0.04, *_TILT],
    "plant__body_b__twist": [0.0] * 6,
    "limits__force": 60.0,
    "limits__torque": 3.0,
}


def rows(folder: Path, quick: bool) -> Iterator[Row]:
    """Every fault, one after the other."""
    with _served(folder, sleeve(timeout=60.0)) as peer:
        for row in Messages(peer, quick).all():
            yield counted(row, peer)
        for row in Stamps(peer, quick).all():
            yield counted(row, peer)
    steps = 300 if quick else 2000
    for samples in (2,) if quick else (1, 2, 5):
        for latency in (0, samples) if quick else (0, samples, -1):
            with _served(folder, sleeve(timeout=60.0, latency=latency)) as peer:
                yield counted(late(peer, samples, steps), peer)
    with _served(folder, sleeve(**_FAR)) as peer:
        yield counted(misaligned(peer, 1500), peer)
    for row, peer in itertools.chain(processes.rows(folder, quick), shutdown.rows(folder, quick)):
        yield counted(row, peer)


@contextlib.contextmanager
def _served(folder: Path, scene: Scene) -> Iterator[Peer]:
    """A node of its own, met by a peer."""
    with program("connector", scene, folder) as node:
        peer = Peer(scene)
        try:
            peer.meet(node.alive)
            yield peer
        except Exception as error:
            raise RuntimeError(f"{error}; the node said last: {node.said[-300:]}") from error
        finally:
            peer.close()


def counted(row: Row, peer: Peer) -> Row:
    """The row with what no fault may bring about."""
    row.numbers["not finite"] = peer.not_finite
    row.check(not peer.not_finite, "published what is not finite")
    return row


def main() -> int:
    """Print a line for every fault."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # as a terminal has it: nohup is inherited
    for row in rows(Path(sys.argv[1]), sys.argv[2:] == ["quick"]):
        print(json.dumps(row.data()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
