"""Millions of samples in lock step with a real node that records them, its memory watched.

``python -m cylconn_ros.bench.faults.soak FOLDER SAMPLES`` prints a line of JSON now and then (samples
done, seconds, MB of memory that the node holds) and a last one with everything. The sleeve of the
scene is pulled and turned to and fro without end, so that it sticks and slips and bends; every
:data:`HISTORY` samples, or quarter of them all, the simulator starts anew.
"""

from __future__ import annotations

import functools
import json
import math
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.bench.faults.fault import sleeve
from cylconn_ros.bench.faults.peer import Bodies, Peer
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.process.programs import Program, program

HISTORY = 100_000  # samples
_LOAD_EVERY = 20  # samples
_REPORTS = 200
_PATIENCE = 5.0  # s for an answer

SCENE = sleeve(elasticity__k1=60.0, elasticity__kr1=0.05, plant__body_b__twist=[0.0] * 6)


def load(seconds: float) -> list[float]:
    """(6,) force and torque on the sleeve: frequencies without a common period."""
    s = math.sin
    swell = s(0.45 * seconds)  # between strong enough for everything and too weak for friction
    pull, turn = 8.0 * swell * s(2.1 * seconds), 0.12 * swell * s(3.4 * seconds)
    return [pull, 4.0 * s(7.3 * seconds), 3.0 * s(5.7 * seconds), turn, 0.1 * s(seconds), 0.0]


def drive(peer: Peer, node: Program, samples: int) -> dict[str, Any]:
    """Exchange samples; how many had no answer, and the node's memory over time."""
    bodies, writer = Bodies(peer.scene), StampedWriter(peer.scene.world_frame)
    period = round(peer.scene.period * 1e9)
    body = peer.moving[-1]
    memory: list[tuple[int, float]] = []
    unanswered, begin, stamp = 0, time.monotonic(), 0
    nothing = np.zeros(6)
    every = max(1, samples // _REPORTS)
    history = max(1, min(HISTORY, samples // 4))
    for k in range(samples):
        at = k % history
        if at == 0:
            bodies.state[:], stamp = bodies.start, 0
        if at % _LOAD_EVERY == 0:
            bodies.loads[6:] = load(at * peer.scene.period)
            peer.publish("body_b/load", writer.write(stamp, bodies.loads[6:]))
        peer.send(peer.sample(stamp, bodies.state))
        unanswered += not peer.until(functools.partial(peer.answered, stamp), _PATIENCE)
        wrench = peer.wrenches[body]
        assert wrench is not None
        bodies.step((nothing, np.array(wrench.values)), peer.scene.period)
        stamp += period
        if (k + 1) % every == 0:
            memory.append((k + 1, node.resident()))
            peer.reports.clear()
            done = {"done": k + 1, "seconds": time.monotonic() - begin, "mb": memory[-1][1]}
            print(json.dumps(done), flush=True)
    return {
        "samples": samples,
        "unanswered": unanswered,
        "wrenches": peer.count,
        "not_finite": peer.not_finite,
        "seconds": time.monotonic() - begin,
        "memory": memory,
        "finite": bool(np.isfinite(bodies.state).all()),
    }


def main() -> int:
    """Do it and print what came out."""
    folder, samples = Path(sys.argv[1]), int(sys.argv[2])
    rules = ("record.enabled:=true", f"record.directory:={folder / 'runs'}", "timeout:=5.0")
    with program("connector", SCENE, folder, *rules) as node:
        peer = Peer(SCENE)
        peer.meet(node.alive)
        found = drive(peer, node, samples)
        found["counted"] = peer.counts()
        node.signal(signal.SIGINT)
        code = node.wait()
        found["code"] = -1 if code is None else code
        peer.close()
    found["run"] = str(next((folder / "runs").iterdir()))
    print(json.dumps(found), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
