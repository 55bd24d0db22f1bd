"""Who asks: sends samples to one contestant after the other and times the answers.

``python -m cylconn_ros.ros.bench.driver`` reads a line of JSON a task from its input (``name``, a
namespace; ``pid`` of its process; ``rate``, samples a second or 0 for a closed loop; ``samples``)
and prints one with what was measured. It is light itself: compiled, as the fastest contestants are.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any, Final

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from cylconn_ros.core.compiled import call, entry
from cylconn_ros.ros.answering import POSE
from cylconn_ros.ros.bells import Bell, Ear
from cylconn_ros.ros.bench.topics import INPUTS, OUTPUTS
from cylconn_ros.ros.cdr_writers import StampedWriter
from cylconn_ros.ros.express import rcl
from cylconn_ros.ros.message_types import message_class

PERIOD = 1_000_000  # ns between stamps, whatever the rate is
_QUEUE = QoSProfile(depth=2000)  # reliable; what is lost is lost by a contestant
_SOON = 5_000_000  # ns
_PATIENCE = 2.0  # s for answers after the last sample was sent
_MEETING = 300.0  # s for a contestant to appear; the first start ever compiles
_SPEED = 1e-4  # m a sample: the sleeve slides steadily
_MOVES = "body_b/pose", "body_b/twist"
_STAMP: Final = 4  # where it begins in a message
_FIRST = 4  # where a message begins behind a multiple of eight: its numbers are aligned then


def cpu_time(pid: int) -> float:
    """Seconds of processor time that a process has used, all its threads."""
    return time.clock_gettime((~pid << 3) | 2)


@entry
def _send(
    stamp: int, addresses: Any, clock: Any, words: Any, places: Any, publishers: Any, outbox: Any
) -> int:
    """Publish messages with a stamp in ns; when the last one went, ns on the steady clock.

    ``words``: their memory. ``places``: of their stamps in it. The rest as in ``rcl``.
    """
    last, went = len(publishers) - 1, 0
    for k in range(last + 1):
        words[places[k]] = stamp // 1_000_000_000
        words[places[k] + 1] = stamp % 1_000_000_000
        if k == last:
            call(addresses[rcl.CLOCK], 1, addresses[rcl.NUMBERS], 0, 0)
            went = clock[0] * 1_000_000_000 + clock[1]
        call(addresses[rcl.PUBLISH], publishers[k], outbox[k], 0, 0)
    return went


@entry
def _take(
    addresses: Any, scratch: Any, subscriptions: Any, boxes: Any, inbox: Any, found: Any
) -> int:
    """Take what has come; how many messages, their stamps in ``found``.

    ``scratch``: what stands at NUMBERS, in words of four bytes.
    """
    count = 0
    for k in range(len(subscriptions)):
        while count < len(found):
            if call(addresses[rcl.TAKE], subscriptions[k], inbox[k], addresses[rcl.INFO], 0) != 0:
                break
            at = boxes[rcl.MESSAGE * k + rcl.BYTES] + _STAMP
            call(addresses[rcl.COPY], addresses[rcl.NUMBERS], at, 8, 0)
            found[count] = scratch[0] * 1_000_000_000 + scratch[1]
            count += 1
    return count


class Contestant:
    """The topics of one node, and the stamps it has been sent."""

    def __init__(self, node: Node, name: str) -> None:
        blanks = []
        for topic, kind in INPUTS.items():
            values = np.zeros(7 if kind == POSE else 6)
            if kind == POSE:
                values[6] = 1.0
            elif topic == _MOVES[1]:
                values[0] = _SPEED / (PERIOD * 1e-9)
            blanks.append(StampedWriter("world", len(values)).write(0, values))
        self._publishers = [
            node.create_publisher(message_class(kind), f"/{name}/{topic}", _QUEUE)
            for topic, kind in INPUTS.items()
        ]
        self._outputs = [
            node.create_subscription(
                message_class(kind), f"/{name}/{topic}", lambda _: None, _QUEUE, raw=True
            )
            for topic, kind in OUTPUTS.items()
        ]
        memory = rcl.Memory()
        rooms = [(_FIRST + len(blank) + 7) // 8 * 8 for blank in blanks]
        begins = np.cumsum([0, *rooms[:-1]]) + _FIRST
        self._numbers = np.zeros(sum(rooms) // 8)
        inner = self._numbers.view(np.uint8)
        for begin, blank in zip(begins, blanks, strict=True):
            inner[begin : begin + len(blank)] = np.frombuffer(blank, np.uint8)
        moving = list(INPUTS).index(_MOVES[0])
        self._x = (begins[moving] + len(blanks[moving])) // 8 - 7
        outbox = rcl.Outbox((inner.ctypes.data + begins).tolist(), [len(blank) for blank in blanks])
        inbox = rcl.Inbox(len(OUTPUTS))
        self._keep = memory, inbox, outbox
        self._send = (
            memory.addresses, memory.numbers, inner.view(np.int32), (begins + _STAMP) // 4,
            np.array([one.handle.pointer for one in self._publishers]), outbox.addresses,
        )  # fmt: skip
        self._found = np.zeros(_QUEUE.depth, np.int64)
        self._take = (
            memory.addresses, memory.numbers.view(np.int32),
            np.array([one.handle.pointer for one in self._outputs]),
            inbox.memory, inbox.addresses, self._found,
        )  # fmt: skip
        # Everybody publishes the state last: waiting for it alone costs the least.
        self._bell = Bell(self._outputs[-1:])
        self._bell.tie([0])
        self._ear = Ear()
        self._ear.listen(self._bell, 0)
        self._sent = 0
        self.take(0)  # compiled now

    def met(self) -> bool:
        """Whether everything is connected."""
        return all(p.get_subscription_count() for p in self._publishers) and all(
            s.get_publisher_count() for s in self._outputs
        )

    def send(self) -> tuple[int, int]:
        """Send the next sample; its stamp, and when the message that completed it went (ns)."""
        self._sent += 1
        self._numbers[self._x] += _SPEED
        stamp = self._sent * PERIOD
        return stamp, _send(stamp, *self._send)

    def take(self, timeout: int) -> list[int]:
        """Stamps of the answers that come within ``timeout`` ns or soon, one for each message."""
        self._ear.wait(min(timeout, _SOON) * 1e-9)
        return self._found[: _take(*self._take)].tolist()


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
        for stamp in contestant.take(max(1000, until - now)):
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
