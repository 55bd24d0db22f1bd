"""Who asks: sends samples to one contestant after the other and times the answers.

``python -m cylconn_ros.bench.nodes.driver`` reads a line of JSON a task from its input (``name``, a
namespace; ``pid`` of its process; ``rate``, samples a second or 0 for a closed loop; ``samples``)
and prints one with what was measured. It is light itself: compiled, as the fastest contestants are.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from cylconn_ros.bench.nodes.client import Exchange, Motion
from cylconn_ros.bench.nodes.topics import INPUTS, OUTPUTS
from cylconn_ros.messages.pipeline import POSE
from cylconn_ros.ros.executor.new_message_event import Bell, Ear
from cylconn_ros.ros.message_types import message_class

_QUEUE = QoSProfile(depth=2000)  # reliable; what is lost is lost by a contestant
_SOON = 5_000_000  # ns
_AWAKE = 0.001  # s of looking for an answer in the closed loop; most of everybody's come sooner
_PATIENCE = 2.0  # s for answers after the last sample was sent
_MEETING = 300.0  # s for a contestant to appear; the first start ever compiles


def cpu_time(pid: int) -> float:
    """Seconds of processor time that a process has used, all its threads."""
    return time.clock_gettime((~pid << 3) | 2)


class Contestant:
    """The topics of one node, and the stamps it has been sent."""

    def __init__(self, node: Node, name: str) -> None:
        motions = [
            Motion(
                node.create_publisher(message_class(kind), f"/{name}/{topic}", _QUEUE),
                kind == POSE,
                topic.startswith("body_b"),
            )
            for topic, kind in INPUTS.items()
        ]
        self._publishers = [motion.publisher for motion in motions]
        self._outputs = [
            node.create_subscription(
                message_class(kind), f"/{name}/{topic}", lambda _: None, _QUEUE, raw=True
            )
            for topic, kind in OUTPUTS.items()
        ]
        self._exchange = Exchange(motions, self._outputs, _QUEUE.depth)
        self.send = self._exchange.send
        # Everybody publishes the state last: waiting for it alone costs the least.
        self._bell = Bell(self._outputs[-1:])
        self._bell.tie([0])
        self._ear = Ear()
        self._ear.listen(self._bell, 0)

    def met(self) -> bool:
        """Whether everything is connected."""
        return all(p.get_subscription_count() for p in self._publishers) and all(
            s.get_publisher_count() for s in self._outputs
        )

    def take(self, timeout: int, awake: float = 0.0) -> list[int]:
        """Stamps of the answers that come within ``timeout`` ns or soon, one for each message.

        ``awake``: s of that time, until which it does not sleep.
        """
        self._ear.wait(min(timeout, _SOON) * 1e-9, time.monotonic() + awake)
        return self._exchange.take()


def measure(contestant: Contestant, pid: int, rate: float, samples: int) -> dict[str, Any]:
    """Send ``samples``; at ``rate`` a second, or each when the one before is answered (0)."""
    sent: dict[int, int] = {}
    left: dict[int, int] = {}  # answers that are still out, by stamp
    delays = []
    count = 0
    cpu, begin = cpu_time(pid), time.perf_counter_ns()
    gap = round(1e9 / rate) if rate else 0
    deadline = 0
    while count < samples or left:
        now = time.perf_counter_ns()
        if count < samples and (now >= begin + count * gap if rate else not left):
            stamp, sent[stamp] = contestant.send()
            left[stamp] = len(OUTPUTS)
            count += 1
            deadline = time.perf_counter_ns() + round(_PATIENCE * 1e9)
            continue
        if now > deadline and (count == samples or not rate):
            if rate or count == samples:
                break
            left.clear()  # lost; a closed loop goes on with the next
            continue
        until = begin + count * gap if rate and count < samples else deadline
        for stamp in contestant.take(max(1000, until - now), 0.0 if rate else _AWAKE):
            if stamp in left:
                left[stamp] -= 1
                if not left[stamp]:
                    delays.append((time.perf_counter_ns() - sent[stamp]) * 1e-9)
                    del left[stamp]
    wall = (time.perf_counter_ns() - begin) * 1e-9
    return {
        "delays": [float(q) for q in np.quantile(delays, (0.5, 0.95, 0.99))] if delays else [],
        "cpu": (cpu_time(pid) - cpu) / samples,
        "answered": len(delays),
        "sent": samples,
        "rate": samples / wall,
    }


def main() -> int:
    """Do tasks until the input ends."""
    rclpy.init()
    node = rclpy.create_node("driver")
    contestants: dict[str, Contestant] = {}
    for line in sys.stdin:
        task = json.loads(line)
        name = task["name"]
        if name not in contestants:
            contestants[name] = Contestant(node, name)
            end = time.monotonic() + _MEETING
            while not contestants[name].met():
                if time.monotonic() > end:
                    raise RuntimeError(f"{name} did not appear within {_MEETING:g} s")
                time.sleep(0.05)
            time.sleep(0.5)  # it must have seen us, too
        found = measure(contestants[name], task["pid"], task["rate"], task["samples"])
        print(json.dumps(found), flush=True)
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
