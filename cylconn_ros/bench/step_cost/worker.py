"""A fresh process that answers samples: for start-up times, and for Python without the compiler.

``python -m cylconn_ros.bench.step_cost.worker SCENE SAMPLES`` reads a parameter file and samples (.npy),
answers the first one and says so in a line of JSON. Then for every line with a number n on its
input it answers n more, one call each, and prints the CPU seconds that took, until its input ends.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any


def main() -> int:
    """Run the worker."""
    import numpy as np

    from cylconn_ros.bench.common.timing import timed
    from cylconn_ros.connector.connector import Connector
    from cylconn_ros.core import layout
    from cylconn_ros.core.jit import COMPILED
    from cylconn_ros.scene.scene import load

    scene, samples = load(sys.argv[1]), np.load(sys.argv[2])
    connector, out = Connector(scene), np.empty(layout.NOUT)
    connector.step(samples[0], out=out)
    first = {
        "compiled": COMPILED,
        "method": connector.method,
        "status": int(out[layout.STATUS]),
        "cpu": time.process_time(),
    }
    print(json.dumps(first), flush=True)
    rows = list(samples)

    def repeat(n: int) -> None:
        for k in range(n):
            connector.step(rows[k % len(rows)], out=out)

    block = timed(repeat)
    for line in sys.stdin:
        print(block(int(line)), flush=True)
    return 0


class Worker:
    """The parent's end of a worker; a context manager.

    Attributes
    ----------
        first: what the worker said with its first answer. wall: seconds from start to that line.

    Raises RuntimeError where the worker ends before it answers.
    """

    def __init__(self, scene: Path, samples: Path, environment: Mapping[str, str]) -> None:
        # A user's process does not inherit what this one has prepared for the ROS libraries.
        clean = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cylconn_ros.bench.step_cost.worker", str(scene), str(samples)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**clean, **environment},
        )
        started = time.perf_counter()
        line = self._read()
        self.wall = time.perf_counter() - started
        self.first: dict[str, Any] = json.loads(line)

    def block(self, n: int) -> float:
        """CPU seconds of n answers."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{n}\n")
        self._process.stdin.flush()
        return float(self._read())

    def close(self) -> None:
        """End the process by ending its input."""
        self._process.communicate()

    def _read(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            _, said = self._process.communicate()
            last = said.strip().splitlines()[-1:] or ["nothing was said"]
            raise RuntimeError(f"the worker process ended: {last[0]}")
        return line

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


if __name__ == "__main__":
    sys.exit(main())
