"""Inject every fault into real processes.

``python -m cylconn_ros.bench.faults.run FOLDER [quick]`` prints one line of JSON per fault case
(bench/faults/fault.py). Its environment needs a ROS domain of its own.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

from cylconn_ros.bench.faults import lock_step, processes, shutdown
from cylconn_ros.bench.faults.fault import FaultCase, node, sleeve
from cylconn_ros.bench.faults.messages import MessageFaults
from cylconn_ros.bench.faults.simulator import Simulator
from cylconn_ros.bench.faults.stamps import StampFaults, late_wrenches, misaligned
from cylconn_ros.errors import ProcessError
from cylconn_ros.scene.scene import Scene

_TILT = [0.0, 0.25881904510252074, 0.0, 0.9659258262890683]  # 30 degrees
_MISALIGNED = {
    "timeout": 60.0,
    "reference__offsets": "zero",
    "reference__misalignment": "zero",
    "node_b__orientation": [0.0, 0.0, 0.0, 1.0],
    "plant__body_b__pose": [0.2, 0.03, 0.04, *_TILT],
    "plant__body_b__twist": [0.0] * 6,
    "limits__force": 60.0,
    "limits__torque": 3.0,
}


def cases(folder: Path, quick: bool) -> Iterator[FaultCase]:
    """Run every fault in sequence."""
    with _connected(folder, sleeve(timeout=60.0)) as simulator:
        for case in MessageFaults(simulator, quick).cases():
            yield with_invariants(case, simulator)
        for case in StampFaults(simulator, quick).cases():
            yield with_invariants(case, simulator)
    steps = 300 if quick else 2000
    for samples in (2,) if quick else (1, 2, 5):
        for latency in (0, samples) if quick else (0, samples, -1):
            with _connected(folder, sleeve(timeout=60.0, latency=latency)) as simulator:
                yield with_invariants(late_wrenches(simulator, samples, steps), simulator)
    with _connected(folder, sleeve(**_MISALIGNED)) as simulator:
        yield with_invariants(misaligned(simulator, 1500), simulator)
    for scene, lag in processes.free_running_cells(quick):
        with _connected(folder, scene) as simulator:
            yield with_invariants(processes.free_run(simulator, lag), simulator)
    samples = lock_step.QUICK if quick else lock_step.SAMPLES
    of_processes = (
        lock_step.cases(folder, samples),
        processes.cases(folder, quick),
        shutdown.cases(folder, quick),
    )
    for case, simulator in itertools.chain(*of_processes):
        yield with_invariants(case, simulator)


@contextlib.contextmanager
def _connected(folder: Path, scene: Scene) -> Iterator[Simulator]:
    """A connector node of its own and the simulator connected to it."""
    with node("connector", scene, folder) as child:
        simulator = Simulator(scene)
        try:
            simulator.connect(lambda: child.running)
            yield simulator
        except Exception as error:
            raise ProcessError(f"{error}; {child.last_words()}") from error
        finally:
            simulator.close()


def with_invariants(case: FaultCase, simulator: Simulator) -> FaultCase:
    """The case with the criterion of every fault: all published wrenches are finite."""
    case.numbers["not finite"] = simulator.not_finite
    case.check(not simulator.not_finite, "published a wrench that is not finite")
    return case


def main() -> int:
    """Print a line of JSON per fault."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup would be inherited by the nodes
    for case in cases(Path(sys.argv[1]), sys.argv[2:] == ["quick"]):
        print(json.dumps(case.data()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
