"""Who asks many connectors at once: sends their samples in time and waits for their wrenches.

``python -m cylconn_ros.ros.bench.crowd`` reads a line of JSON a task from its input (``names`` of
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

from cylconn_ros.ros import bells, cdr
from cylconn_ros.ros.answering import POSE, TWIST, WRENCH
from cylconn_ros.ros.bench.driver import PERIOD, cpu_time
from cylconn_ros.ros.cdr_writers import StampedWriter
from cylconn_ros.ros.message_types import message_class

_QUEUE = QoSProfile(depth=2000)  # reliable; what is lost is lost by who serves
_PATIENCE = 2.0  # s for answers after the last sample was sent
_MEETING = 300.0  # s for the connectors to appear; the first start ever compiles
_SPEED = 1e-4  # m a sample: the sleeves slide steadily


class Asked:
    """The topics of one connector, and the samples that are out."""

    def __init__(self, node: Node, name: str, moving: Sequence[str]) -> None:
        self._senders = []
        self._publishers = []
        for body in moving:
            for topic, kind, numbers in (("pose", POSE, 7), ("twist", TWIST, 6)):
                publisher = node.create_publisher(
                    message_class(kind), f"/{name}/{body}/{topic}", _QUEUE
                )
                writer, values = StampedWriter("world", numbers), np.zeros(numbers)
                values[6 if kind == POSE else 0] = 1.0 if kind == POSE else 0.0
                self._senders.append((publisher.handle.publish_raw, writer, values))
                self._publishers.append(publisher)
        self._place, self._speed = self._senders[-2][2], self._senders[-1][2]
        self._speed[0] = _SPEED / (PERIOD * 1e-9)
        self._answers = [
            node.create_subscription(
                message_class(WRENCH), f"/{name}/{body}/wrench", lambda _: None, _QUEUE, raw=True
            )
            for body in moving
        ]
        self.bell = bells.Bell(self._answers)
        self.bell.tie(range(len(self._answers)))
        self._takes = [(s.handle.take_message, s.msg_type) for s in self._answers]
        self._stamp = 0
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
        self._stamp += PERIOD
        self._place[0] += _SPEED
        messages = [(publish, w.write(self._stamp, values)) for publish, w, values in self._senders]
        self.sent[self._stamp] = time.perf_counter_ns(), len(self._answers)
        for publish, data in messages:
            publish(data)

    def take(self) -> None:
        """Take the answers that have come."""
        sent = self.sent
        for take, kind in self._takes:
            while (taken := take(kind, True)) is not None:
                stamp = cdr.read_stamp(taken[0])
                if stamp not in sent:
                    continue
                when, left = sent[stamp]
                if left > 1:
                    sent[stamp] = when, left - 1
                else:
                    del sent[stamp]
                    self.delays.append(time.perf_counter_ns() - when)


class Crowd:
    """Connectors of one process."""

    def __init__(self, node: Node, names: Sequence[str], moving: Sequence[str]) -> None:
        self._all = [Asked(node, name, moving) for name in names]
        self._ear = bells.Ear()
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
                out = any(one.sent for one in everybody)
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
