"""Load generator for many connectors: sends the samples of all of them on schedule.

``python -m cylconn_ros.bench.nodes.many_connectors_load`` reads one JSON task a line from its input
(``names`` of the connectors; ``pid`` of their process; ``moving``, the bodies that move; ``rate``,
samples/s of each connector; ``samples`` of each) and prints one line of JSON with the measurement.
A sample of a connector is pose and twist of its moving bodies; it is complete when the wrenches of
these bodies have arrived. The samples of one period are spread evenly over it, to within the 1 ms
between two checks of the clock.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node

from cylconn_ros.bench.nodes.client import Client, connect
from cylconn_ros.process.child import cpu_time
from cylconn_ros.ros.executor.new_message_event import EventPoller
from cylconn_ros.scene.inputs import POSE, TWIST, WRENCH

_PATIENCE = 2.0  # s for wrenches after the last sample was sent


class Load:
    """One connector's client and its samples without a complete output.

    Attributes
    ----------
        pending: time of sending (ns) and number of missing wrenches, by stamp.
        delays: ns, from the last message of a sample to the last wrench.
    """

    def __init__(self, node: Node, name: str, moving: Sequence[str]) -> None:
        inputs = {
            f"{body}/{topic}": kind
            for body in moving
            for topic, kind in (("pose", POSE), ("twist", TWIST))
        }
        self.client = Client(node, f"/{name}", inputs, {f"{b}/wrench": WRENCH for b in moving})
        self._outputs = len(moving)
        self.pending: dict[int, tuple[int, int]] = {}
        self.delays: list[int] = []

    def reset(self) -> None:
        """Clear the measurement."""
        self.pending.clear()
        self.delays = []

    def send(self) -> None:
        """Send the next sample."""
        stamp, sent = self.client.send()
        self.pending[stamp] = sent, self._outputs

    def take(self) -> None:
        """Take the queued wrenches."""
        pending, stamps = self.pending, self.client.take()
        now = time.perf_counter_ns()
        for stamp in stamps:
            if stamp not in pending:
                continue
            sent, missing = pending[stamp]
            if missing > 1:
                pending[stamp] = sent, missing - 1
            else:
                del pending[stamp]
                self.delays.append(now - sent)


class ManyLoads:
    """The clients of all connectors of one process."""

    def __init__(self, node: Node, names: Sequence[str], moving: Sequence[str]) -> None:
        self._loads = [Load(node, name, moving) for name in names]
        self._poller = EventPoller[int]()
        for number, load in enumerate(self._loads):
            self._poller.register(load.client.event, number)
        connect([load.client for load in self._loads], f"one of {len(names)} connectors")

    def measure(self, pid: int, rate: float, samples: int) -> dict[str, Any]:
        """Send each connector ``samples`` at ``rate`` a second; wait for the wrenches.

        Returns the delays' quantiles (s), the CPU time per sample of process ``pid`` and of this
        one (s), the numbers of samples sent and of samples with all wrenches, the rate of all
        connectors together (1/s), and by how much a sample was sent too late at most (s).
        """
        loads, poller = self._loads, self._poller
        for load in loads:
            load.reset()
        interval = 1e9 / (rate * len(loads))  # ns between samples of any connector
        total, count, late = samples * len(loads), 0, 0.0
        cpu, own = cpu_time(pid), time.process_time()
        begin = time.perf_counter_ns()
        while True:
            now = time.perf_counter_ns()
            behind = now - (begin + count * interval)
            if count < total and behind >= 0.0:
                late = max(late, behind)
                loads[count % len(loads)].send()
                count += 1
                wait = 0.0
            else:
                wait = 0.001
            for number in poller.wait(wait):
                loads[number].take()
            if count == total:
                waiting = [load for load in loads if load.pending]
                for load in waiting:
                    load.take()  # wrenches of the other body may arrive after the event
                if not waiting or now - begin > total * interval + _PATIENCE * 1e9:
                    break
        wall = (time.perf_counter_ns() - begin) * 1e-9
        delays = [delay * 1e-9 for load in loads for delay in load.delays]
        return {
            "delays": [float(q) for q in np.quantile(delays, (0.5, 0.99))] if delays else [],
            "cpu": (cpu_time(pid) - cpu) / total,
            "own_cpu": (time.process_time() - own) / total,
            "received": len(delays),
            "sent": total,
            "rate": total / wall,
            "late": late * 1e-9,
        }


def main() -> int:
    """Process tasks until the input ends."""
    rclpy.init()
    node = rclpy.create_node("load_generator")
    loads: dict[tuple[str, ...], ManyLoads] = {}
    for line in sys.stdin:
        task = json.loads(line)
        names = tuple(task["names"])
        if names not in loads:
            loads[names] = ManyLoads(node, names, task["moving"])
        found = loads[names].measure(task["pid"], task["rate"], task["samples"])
        print(json.dumps(found), flush=True)
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
