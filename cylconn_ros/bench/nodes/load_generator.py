"""Load generator of the node benchmark: sends samples to one node at a time and measures delays.

``python -m cylconn_ros.bench.nodes.load_generator`` reads one JSON task a line from its input
(``name``, a namespace; ``pid`` of the node's process; ``rate``, samples/s, or 0 for a closed loop;
``samples``) and prints one line of JSON with the measurement. It is compiled, as the fastest nodes
are.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
import rclpy

from cylconn_ros.bench.nodes.client import Client, connect
from cylconn_ros.bench.nodes.topics import INPUTS, OUTPUTS
from cylconn_ros.process.child import cpu_time
from cylconn_ros.ros.executor.new_message_event import EventPoller

_LONGEST_WAIT = 5_000_000  # ns; then outputs are taken also without an event
_POLLING = 0.001  # s of polling for outputs in the closed loop; most arrive sooner
_PATIENCE = 2.0  # s for outputs after the last sample was sent


class Load:
    """The client of one node and the poller that waits for the node's outputs."""

    def __init__(self, client: Client) -> None:
        self.send = client.send
        self._take = client.take
        # Every node publishes the state last: waiting for it alone costs the least.
        self._poller = EventPoller[int]()
        self._poller.register(client.event, 0)

    def take(self, timeout: int, polling: float = 0.0) -> list[int]:
        """Stamps of the outputs that arrive within ``timeout`` ns or earlier, one per message.

        ``polling``: time in s during which the thread polls instead of sleeping.
        """
        self._poller.wait(min(timeout, _LONGEST_WAIT) * 1e-9, time.monotonic() + polling)
        return self._take()


def measure(load: Load, pid: int, rate: float, samples: int) -> dict[str, Any]:
    """Send ``samples`` at ``rate`` a second, or each after the outputs of the previous one (0).

    Returns the delays' quantiles (s), the CPU time of process ``pid`` per sample (s), the numbers
    of samples sent and of samples with all outputs, and the rate achieved (1/s).
    """
    sent: dict[int, int] = {}
    missing: dict[int, int] = {}  # outputs not received yet, by stamp
    delays = []
    count = 0
    cpu, begin = cpu_time(pid), time.perf_counter_ns()
    interval = round(1e9 / rate) if rate else 0
    deadline = 0
    while count < samples or missing:
        now = time.perf_counter_ns()
        if count < samples and (now >= begin + count * interval if rate else not missing):
            stamp, sent[stamp] = load.send()
            missing[stamp] = len(OUTPUTS)
            count += 1
            deadline = time.perf_counter_ns() + round(_PATIENCE * 1e9)
            continue
        if now > deadline and (count == samples or not rate):
            if rate or count == samples:
                break
            missing.clear()  # lost; the closed loop continues with the next sample
            continue
        until = begin + count * interval if rate and count < samples else deadline
        for stamp in load.take(max(1000, until - now), 0.0 if rate else _POLLING):
            if stamp in missing:
                missing[stamp] -= 1
                if not missing[stamp]:
                    delays.append((time.perf_counter_ns() - sent[stamp]) * 1e-9)
                    del missing[stamp]
    wall = (time.perf_counter_ns() - begin) * 1e-9
    return {
        "delays": [float(q) for q in np.quantile(delays, (0.5, 0.95, 0.99))] if delays else [],
        "cpu": (cpu_time(pid) - cpu) / samples,
        "received": len(delays),
        "sent": samples,
        "rate": samples / wall,
    }


def main() -> int:
    """Process tasks until the input ends."""
    rclpy.init()
    node = rclpy.create_node("load_generator")
    loads: dict[str, Load] = {}
    for line in sys.stdin:
        task = json.loads(line)
        name = task["name"]
        if name not in loads:
            client = Client(node, f"/{name}", INPUTS, OUTPUTS)
            connect([client], name)
            loads[name] = Load(client)
        found = measure(loads[name], task["pid"], task["rate"], task["samples"])
        print(json.dumps(found), flush=True)
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
