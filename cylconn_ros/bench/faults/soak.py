"""Soak test: millions of samples in lock step with a recording node, whose memory is observed.

``python -m cylconn_ros.bench.faults.soak FOLDER SAMPLES`` prints lines of JSON with its progress
(samples done, seconds, resident memory of the node in MB) and a last line with all results. An
alternating load acts on the sleeve of the scene, so that it sticks, slips and bends. The simulator
restarts every :data:`HISTORY` samples, or after a quarter of all samples if these are fewer.
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

from cylconn_ros.bench.faults.fault import node, sleeve
from cylconn_ros.bench.faults.simulator import Bodies, Simulator
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.process.child import Child

HISTORY = 100_000  # samples
_LOAD_INTERVAL = 20  # samples
_REPORTS = 200
_TIMEOUT = 5.0  # s for an output

SCENE = sleeve(elasticity__k1=60.0, elasticity__kr1=0.05, plant__body_b__twist=[0.0] * 6)


def load(seconds: float) -> list[float]:
    """(6,) force and torque on the sleeve: sines whose frequencies have no common period."""
    s = math.sin
    amplitude = s(0.45 * seconds)  # from far above the friction limit to below it
    force, torque = 8.0 * amplitude * s(2.1 * seconds), 0.12 * amplitude * s(3.4 * seconds)
    return [force, 4.0 * s(7.3 * seconds), 3.0 * s(5.7 * seconds), torque, 0.1 * s(seconds), 0.0]


def drive(simulator: Simulator, connector: Child, samples: int) -> dict[str, Any]:
    """Exchange samples; return the numbers of losses and the connector's memory over time (MB)."""
    bodies, writer = Bodies(simulator.scene), StampedWriter(simulator.scene.world_frame)
    period = round(simulator.scene.period * 1e9)
    body = simulator.moving[-1]
    memory: list[tuple[int, float]] = []
    unanswered, begin, stamp = 0, time.monotonic(), 0
    zero = np.zeros(6)
    every = max(1, samples // _REPORTS)
    history = max(1, min(HISTORY, samples // 4))
    for k in range(samples):
        at = k % history
        if at == 0:
            bodies.state[:], stamp = bodies.start, 0
        if at % _LOAD_INTERVAL == 0:
            bodies.loads[6:] = load(at * simulator.scene.period)
        # with each sample: one that is sent with few of them may arrive after its sample's wrench
        simulator.publish("body_b/load", writer.write(stamp, bodies.loads[6:]))
        simulator.send(simulator.sample(stamp, bodies.state))
        has_response = functools.partial(simulator.has_response, stamp)
        unanswered += not simulator.spin_until(has_response, _TIMEOUT)
        wrench = simulator.wrenches[body]
        assert wrench is not None
        bodies.step((zero, np.array(wrench.values)), simulator.scene.period)
        stamp += period
        if (k + 1) % every == 0:
            memory.append((k + 1, connector.resident_memory))
            simulator.reports.clear()
            done = {"done": k + 1, "seconds": time.monotonic() - begin, "mb": memory[-1][1]}
            print(json.dumps(done), flush=True)
    return {
        "samples": samples,
        "unanswered": unanswered,
        "wrenches": simulator.count,
        "not_finite": simulator.not_finite,
        "seconds": time.monotonic() - begin,
        "memory": memory,
        "finite": bool(np.isfinite(bodies.state).all()),
    }


def main() -> int:
    """Run the soak test and print its results."""
    folder, samples = Path(sys.argv[1]), int(sys.argv[2])
    record = ("record.enabled:=true", f"record.directory:={folder / 'runs'}", "timeout:=5.0")
    with node("connector", SCENE, folder, *record) as connector:
        simulator = Simulator(SCENE)
        simulator.connect(lambda: connector.running)
        found = drive(simulator, connector, samples)
        found["counted"] = simulator.counts()
        connector.signal(signal.SIGINT)
        code = connector.wait(30.0)
        found["code"] = -1 if code is None else code
        simulator.close()
    found["run"] = str(next((folder / "runs").iterdir()))
    print(json.dumps(found), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
