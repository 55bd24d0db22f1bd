"""Who asks many connectors at once: sends their samples in time and waits for their wrenches.

``python -m cylconn_ros.bench.nodes.many_clients`` reads a line of JSON a task from its input (``names`` of
connectors; ``pid`` of the process that serves them; ``moving``, the bodies that move; ``rate``,
samples a second of each connector; ``samples`` of each) and prints one with what was measured. A
connector is sent pose and twist of its moving bodies, and has answered when their wrenches have
come. Of a period's samples each has its own time; the look at the clock is every millisecond.
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
from rclpy.qos import QoSProfile

from cylconn_ros.bench.nodes.client import Exchange, Motion
from cylconn_ros.bench.nodes.driver import cpu_time
from cylconn_ros.messages.pipeline import POSE, TWIST, WRENCH
from cylconn_ros.ros.executor import new_message_event
from cylconn_ros.ros.message_types import message_class

_QUEUE = QoSProfile(depth=2000)  # reliable; what is lost is lost by who serves
_PATIENCE = 2.0  # s for answers after the last sample was sent
_MEETING = 300.0  # s for the connectors to appear; the first start ever compiles


class Asked:
    """The topics of one connector, and the samples that are out."""

    def __init__(self, node: Node, name: str, moving: Sequence[str]) -> None:
        motions = [
            Motion(
                node.create_publisher(message_class(kind), f"/{name}/{body}/{topic}", _QUEUE),
                kind == POSE,
                body == moving[-1],
            )
            for body in moving
            for topic, kind in (("pose", POSE), ("twist", TWIST))
        ]
        self._publishers = [motion.publisher for motion in motions]
        self._answers = [
            node.create_subscription(
                message_class(WRENCH), f"/{name}/{body}/wrench", lambda _: None, _QUEUE, raw=True
            )
            for body in moving
        ]
        self._exchange = Exchange(motions, self._answers, _QUEUE.depth)
        self.bell = new_message_event.Bell(self._answers[-1:])  # the last wrench comes last
        self.bell.tie([0])
        self.sent: dict[int, tuple[int, int]] = {}  # when, and answers still out, by stamp
        self.delays: list[int] = []

    def met(self) -> bool:
        """Whether everything is connected."""
        return all(p.get_subscription_count() for p in self._publishers) and all(
            s.get_publisher_count() for s in self._answers
        )

    def begin(self) -> None:
        """Forget what was measured."""
        self.sent.clear()
        self.delays = []

    def send(self) -> None:
        """Send the next sample."""
        stamp, went = self._exchange.send()
        self.sent[stamp] = went, len(self._answers)

    def take(self) -> None:
        """Take the answers that have come."""
        sent, stamps = self.sent, self._exchange.take()
        now = time.perf_counter_ns()
        for stamp in stamps:
            if stamp not in sent:
                continue
            when, left = sent[stamp]
            if left > 1:
                sent[stamp] = when, left - 1
            else:
                del sent[stamp]
                self.delays.append(now - when)


class Crowd:
    """Connectors of one process."""

    def __init__(self, node: Node, names: Sequence[str], moving: Sequence[str]) -> None:
        self._all = [Asked(node, name, moving) for name in names]
        self._ear = new_message_event.Ear()
        for number, one in enumerate(self._all):
            self._ear.listen(one.bell, number)
        end = time.monotonic() + _MEETING
        while not all(one.met() for one in self._all):
            if time.monotonic() > end:
                raise RuntimeError(f"not all of {len(names)} appeared within {_MEETING:g} s")
            time.sleep(0.05)
        time.sleep(1.0)  # they must have seen us, too

    def ask(self, pid: int, rate: float, samples: int) -> dict[str, Any]:
        """Send each connector ``samples`` at ``rate`` a second, and wait for the answers."""
        everybody, ear = self._all, self._ear
        for one in everybody:
            one.begin()
        gap = 1e9 / (rate * len(everybody))  # ns between samples, of whomever
        total, count, late = samples * len(everybody), 0, 0.0
        cpu, own = cpu_time(pid), time.process_time()
        begin = time.perf_counter_ns()
        while True:
            now = time.perf_counter_ns()
            behind = now - (begin + count * gap)
            if count < total and behind >= 0.0:
                late = max(late, behind)
                everybody[count % len(everybody)].send()
                count += 1
                wait = 0.0
            else:
                wait = 0.001
            for number in ear.wait(wait):
                everybody[number].take()
            if count == total:
                out = [one for one in everybody if one.sent]
                for one in out:
                    one.take()  # a wrench may have come after the one that rings
                if not out or now - begin > total * gap + _PATIENCE * 1e9:
                    break
        wall = (time.perf_counter_ns() - begin) * 1e-9
        delays = [delay * 1e-9 for one in everybody for delay in one.delays]
        return {
            "delays": [float(q) for q in np.quantile(delays, (0.5, 0.99))] if delays else [],
            "cpu": (cpu_time(pid) - cpu) / total,
            "own_cpu": (time.process_time() - own) / total,
            "answered": len(delays),
            "sent": total,
            "rate": total / wall,
            "late": late * 1e-9,
        }


def main() -> int:
    """Do tasks until the input ends."""
    rclpy.init()
    node = rclpy.create_node("crowd")
    crowds: dict[tuple[str, ...], Crowd] = {}
    for line in sys.stdin:
        task = json.loads(line)
        names = tuple(task["names"])
        if names not in crowds:
            crowds[names] = Crowd(node, names, task["moving"])
        print(json.dumps(crowds[names].ask(task["pid"], task["rate"], task["samples"])), flush=True)
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
