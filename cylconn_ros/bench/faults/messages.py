"""Message faults: malformed, foreign and unusable messages sent to one node, which continues."""

from __future__ import annotations

import math
import random
import struct
import time
from collections.abc import Iterator

import numpy as np
import rclpy

from cylconn_ros.bench.faults.fault import ClosedLoop, FaultCase
from cylconn_ros.bench.faults.simulator import Messages, Simulator
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.scene.inputs import ODOMETRY

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # CDR encapsulation header
_FIRST_STAMP = 1_000_000_000_000_000  # ns: no closed loop reaches it
_FLOOD_RATE = 10_000.0  # samples/s
_NOT_FINITE = (math.nan, math.inf, -math.inf)


class MessageFaults:
    """Message faults in sequence, sent to the node connected to a simulator."""

    def __init__(self, simulator: Simulator, quick: bool) -> None:
        self.simulator, self.quick = simulator, quick
        self.loop = ClosedLoop(simulator)
        self._random = random.Random(5)
        self._stamp = _FIRST_STAMP

    def cases(self) -> Iterator[FaultCase]:
        """Run every fault."""
        self.loop.run(20)
        yield self.garbage()
        yield self.truncated()
        yield self.oversized()
        yield self.wrong_type()
        yield self.unknown_frames()
        yield self.not_finite()
        yield self.flood()

    def _send(self, case: FaultCase, messages: Messages, counter: str) -> None:
        """Send messages that must all be counted and must not cause an output."""
        before, wrenches = self.simulator.counts(), self.simulator.count
        for name, data in messages:
            self.simulator.publish(name, data)
            self.simulator.take(0)
            time.sleep(1e-4)
        after = self.simulator.counts()
        counted = after[counter] - before[counter]
        dropped = after["dropped messages"] - before["dropped messages"]
        text = f", {dropped} as dropped" if dropped else ""
        case.observe(
            f"{counted} of {len(messages)} counted{text}", sent=len(messages), counted=counted
        )
        case.check(counted + dropped == len(messages), "not all are counted")
        case.check(self.simulator.count == wrenches, "a wrench was published")
        self._check_recovery(case)

    def _check_recovery(self, case: FaultCase) -> None:
        took = self.loop.recovery_time()
        case.observe(f"next output after {1e3 * took:.1f} ms", recovery=took)
        self.loop.run(20)
        case.check(math.isfinite(took) and not self.loop.unanswered, "does not recover")

    def garbage(self) -> FaultCase:
        """Random bytes."""
        case = FaultCase("garbage bytes on every input", "each is counted, no output")
        topics = ["body_b/pose", "body_b/twist", "body_b/load"]
        messages = []
        for k in range(100 if self.quick else 2000):
            header = _LITTLE_ENDIAN if k % 2 else b""
            data = header + self._random.randbytes(self._random.randrange(1, 400))
            messages.append((topics[k % 3], data))
        self._send(case, messages, "undecodable")
        return case

    def _valid(self) -> Messages:
        """The messages of a valid sample."""
        self._stamp += 1_000_000
        return self.simulator.sample(self._stamp, self.loop.bodies.state)

    def truncated(self) -> FaultCase:
        """Messages truncated at every length."""
        case = FaultCase("CDR truncated at every length", "each is counted, no output")
        parts = [(name, data[:k]) for name, data in self._valid() for k in range(1, len(data) - 3)]
        self._send(case, parts[::8] if self.quick else parts, "undecodable")
        return case

    def oversized(self) -> FaultCase:
        """Messages with extra bytes, and with a string length beyond the message."""
        case = FaultCase("CDR with extra bytes or a wrong length", "each is counted, no output")
        messages = []
        for name, data in self._valid():
            messages += [(name, data + bytes(more)) for more in (4, 64, 60_000, 1_000_000)]
            for length in (1 << 31, (1 << 32) - 1, 1_000_000, len(data)):
                messages.append((name, data[:12] + struct.pack("<I", length) + data[16:]))
        self._send(case, messages, "undecodable")
        return case

    def wrong_type(self) -> FaultCase:
        """A publisher of another message type on an input topic."""
        case = FaultCase("other type on body_b/pose", "diagnostics warn, the node continues")
        kind, context = message_class(ODOMETRY), rclpy.Context()
        rclpy.init(context=context)  # a context cannot have two types of one topic
        publisher = rclpy.create_node("other", context=context).create_publisher(
            kind, "body_b/pose", 10
        )
        warned = self.simulator.spin_until(
            lambda: "type" in self.simulator.status("topics").get("message", ""), 10.0
        )
        for _ in range(20):
            publisher.publish(kind())
        case.observe(f"diagnostics: “{self.simulator.status('topics').get('message', '')}”")
        case.check(warned, "no warning")
        self._check_recovery(case)
        rclpy.shutdown(context=context)
        return case

    def unknown_frames(self) -> FaultCase:
        """Unknown frame_ids, then the usual ones again."""
        case = FaultCase("unknown frame_id", "counted; treated as world axes; same wrench")
        loop = self.loop
        before = self.simulator.counts()
        pose, twist = StampedWriter("nobody", 7), StampedWriter("nowhere")
        count, unanswered = 20, 0
        for _ in range(count):
            parts = np.split(loop.bodies.state[13:], [7])
            self.simulator.publish("body_b/pose", pose.write(loop.stamp, parts[0]))
            self.simulator.publish("body_b/twist", twist.write(loop.stamp, parts[1]))
            unanswered += not loop.wait(loop.stamp)
            loop.move()
        found = self.simulator.counts()["unknown frame_ids"] - before["unknown frame_ids"]
        case.observe(
            f"{found} of {2 * count} messages counted, {count - unanswered} of {count} processed"
        )
        case.check(found == 2 * count and not unanswered, "not counted or not processed")
        self._check_recovery(case)
        loop.check(case)
        return case

    def not_finite(self) -> FaultCase:
        """NaN and infinity in every field; zero and denormal quaternions."""
        case = FaultCase("NaN, ±infinity in every field, zero and denormal quaternion",
                         "zero wrench for each, counted")  # fmt: skip
        loop, before = self.loop, self.simulator.counts()
        states = []
        for field in range(13, 26):
            for value in _NOT_FINITE:
                states.append(loop.bodies.state.copy())
                states[-1][field] = value
        for value in (0.0, 5e-324):
            states.append(loop.bodies.state.copy())
            states[-1][16:20] = value
        zero = 0
        for state in states:
            self.simulator.send(self.simulator.sample(loop.stamp, state))
            zero += loop.wait(loop.stamp) and not loop.wrench.any()
            loop.stamp += loop.period
        after = self.simulator.counts()
        names = ("non-finite", "bad quaternion")
        counted = sum(after[name] - before[name] for name in names)
        case.observe(f"{zero} zero wrenches and {counted} counted of {len(states)}",
                     counted=counted)  # fmt: skip
        case.check(zero == counted == len(states), "not zero, or not counted")
        self._check_recovery(case)
        return case

    def flood(self) -> FaultCase:
        """Ten times the rate of the scene, without waiting for outputs."""
        case = FaultCase("flood: ten times the rate", "each sample is processed or counted as lost")
        loop, before = self.loop, self.simulator.counts()
        received = self.simulator.count
        seconds = 0.2 if self.quick else 2.0
        begin, sent = time.monotonic(), 0
        while (elapsed := time.monotonic() - begin) < seconds:
            while sent < elapsed * _FLOOD_RATE:
                loop.stamp += loop.period
                loop.send()
                sent += 1
            self.simulator.take(0)
        self.simulator.spin_for(0.5)
        loop.stamp += loop.period
        took = loop.recovery_time()  # its sample also flushes an incomplete one
        sent += 1
        after = self.simulator.counts()
        processed = after["samples processed"] - before["samples processed"]
        received = self.simulator.count - received
        dropped = after["dropped messages"] - before["dropped messages"]
        incomplete = after["incomplete samples"] - before["incomplete samples"]
        case.observe(
            f"{sent} sent in {seconds:g} s ({sent / elapsed:.0f}/s), {processed} processed, "
            f"{received} wrenches received; diagnostics: {dropped} messages dropped, {incomplete} "
            "samples incomplete",
            sent=sent, processed=processed, lost=sent - processed, dropped=dropped,
        )  # fmt: skip
        case.check(received <= processed, "more wrenches than samples processed")
        case.check(dropped + incomplete == 2 * (sent - processed), "lost messages not counted")
        case.observe(f"next output after {1e3 * took:.1f} ms", recovery=took)
        case.check(math.isfinite(took), "does not recover")
        return case
