"""Messages that are not what they should be, put upon one node that has to go on."""

from __future__ import annotations

import math
import random
import struct
import time
from collections.abc import Iterator

import numpy as np
import rclpy

from cylconn_ros.bench.faults.fault import Exchange, Row
from cylconn_ros.bench.faults.peer import Peer
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.messages.pipeline import ODOMETRY
from cylconn_ros.ros.message_types import message_class

_LITTLE = b"\x00\x01\x00\x00"
_FIRST = 1_000_000_000_000_000  # ns: stamps that no closed loop reaches
_FLOOD = 10_000.0  # samples/s
_BAD = (math.nan, math.inf, -math.inf)


class Messages:
    """Faults of messages, one after the other, to the node that ``peer`` has met."""

    def __init__(self, peer: Peer, quick: bool) -> None:
        self.peer, self.quick = peer, quick
        self.exchange = Exchange(peer)
        self._chance = random.Random(5)
        self._stamp = _FIRST

    def all(self) -> Iterator[Row]:
        """Every fault."""
        self.exchange.run(20)
        yield self.garbage()
        yield self.truncated()
        yield self.oversized()
        yield self.wrong_type()
        yield self.foreign_frames()
        yield self.not_finite()
        yield self.flood()

    def _sent(self, row: Row, messages: list[tuple[str, bytes]], counted: str) -> None:
        """Send messages of which none may be answered, and all must be counted."""
        before, wrenches = self.peer.counts(), self.peer.count
        for name, data in messages:
            self.peer.publish(name, data)
            self.peer.take(0)
            time.sleep(1e-4)
        after = self.peer.counts()
        found = after[counted] - before[counted]
        dropped = after["dropped messages"] - before["dropped messages"]
        text = f", {dropped} as dropped" if dropped else ""
        row.say(f"{found} of {len(messages)} counted{text}", sent=len(messages), counted=found)
        row.check(found + dropped == len(messages), "not all are counted")
        row.check(self.peer.count == wrenches, "answered")
        self._goes_on(row)

    def _goes_on(self, row: Row) -> None:
        took = self.exchange.recovered()
        row.say(f"next sample answered in {1e3 * took:.1f} ms", recovery=took)
        self.exchange.run(20)
        row.check(math.isfinite(took) and not self.exchange.unanswered, "does not go on")

    def garbage(self) -> Row:
        """Random bytes."""
        row = Row("garbage bytes on every input", "each is counted, none answered")
        topics = ["body_b/pose", "body_b/twist", "body_b/load"]
        messages = []
        for k in range(100 if self.quick else 2000):
            head = _LITTLE if k % 2 else b""
            data = head + self._chance.randbytes(self._chance.randrange(1, 400))
            messages.append((topics[k % 3], data))
        self._sent(row, messages, "undecodable")
        return row

    def _good(self) -> list[tuple[str, bytes]]:
        self._stamp += 1_000_000
        return self.peer.sample(self._stamp, self.exchange.bodies.state)

    def truncated(self) -> Row:
        """Messages cut off at every length."""
        row = Row("CDR cut off, at every length", "each is counted, none answered")
        pieces = [(name, data[:k]) for name, data in self._good() for k in range(1, len(data) - 3)]
        self._sent(row, pieces[::8] if self.quick else pieces, "undecodable")
        return row

    def oversized(self) -> Row:
        """More bytes than the message has; a string longer than the message."""
        row = Row("CDR too long, and longer than it says", "each is counted, none answered")
        messages = []
        for name, data in self._good():
            messages += [(name, data + bytes(more)) for more in (4, 64, 60_000, 1_000_000)]
            for length in (1 << 31, (1 << 32) - 1, 1_000_000, len(data)):
                messages.append((name, data[:12] + struct.pack("<I", length) + data[16:]))
        self._sent(row, messages, "undecodable")
        return row

    def wrong_type(self) -> Row:
        """A publisher of another type on an input."""
        row = Row("another type on body_b/pose", "told in diagnostics, the node goes on")
        kind, other = message_class(ODOMETRY), rclpy.Context()
        rclpy.init(context=other)  # nobody can have two types of one topic
        publisher = rclpy.create_node("other", context=other).create_publisher(
            kind, "body_b/pose", 10
        )
        told = self.peer.until(
            lambda: "type" in self.peer.status("topics").get("message", ""), 10.0
        )
        for _ in range(20):
            publisher.publish(kind())
        row.say(f"diagnostics: “{self.peer.status('topics').get('message', '')}”")
        row.check(told, "not told")
        self._goes_on(row)
        rclpy.shutdown(context=other)
        return row

    def foreign_frames(self) -> Row:
        """Frames that nobody knows, then the usual ones again."""
        row = Row(
            "frame_id of no frame", "counted; read as in the world; the wrench is not another"
        )
        ours = self.exchange
        before = self.peer.counts()
        pose, twist = StampedWriter("nobody", 7), StampedWriter("nowhere")
        count, wrong = 20, 0
        for _ in range(count):
            pieces = np.split(ours.bodies.state[13:], [7])
            self.peer.publish("body_b/pose", pose.write(ours.stamp, pieces[0]))
            self.peer.publish("body_b/twist", twist.write(ours.stamp, pieces[1]))
            wrong += not ours.wait(ours.stamp)
            ours.move()
        found = self.peer.counts()["foreign frames"] - before["foreign frames"]
        row.say(f"{found} of {2 * count} messages counted, {count - wrong} of {count} answered")
        row.check(found == 2 * count and not wrong, "not counted or not answered")
        self._goes_on(row)
        ours.judge(row)
        return row

    def not_finite(self) -> Row:
        """Every field NaN and infinite, quaternions without direction."""
        row = Row("NaN, ±infinity in every field, zero and denormal quaternion",
                  "zero wrench for each, counted")  # fmt: skip
        ours, before = self.exchange, self.peer.counts()
        states = []
        for field in range(13, 26):
            for value in _BAD:
                states.append(ours.bodies.state.copy())
                states[-1][field] = value
        for value in (0.0, 5e-324):
            states.append(ours.bodies.state.copy())
            states[-1][16:20] = value
        zero = 0
        for state in states:
            self.peer.send(self.peer.sample(ours.stamp, state))
            zero += ours.wait(ours.stamp) and not ours.wrench.any()
            ours.stamp += ours.period
        after = self.peer.counts()
        names = ("non-finite", "bad quaternion")
        counted = sum(after[name] - before[name] for name in names)
        row.say(f"{zero} zero wrenches and {counted} counted of {len(states)}", counted=counted)
        row.check(zero == counted == len(states), "not zero, or not counted")
        self._goes_on(row)
        return row

    def flood(self) -> Row:
        """Ten times the rate of the scene, nobody waiting."""
        row = Row("flood: ten times the rate", "each sample is answered or counted as lost")
        ours, before = self.exchange, self.peer.counts()
        answered = self.peer.count
        seconds = 0.2 if self.quick else 2.0
        begin, sent = time.monotonic(), 0
        while (gone := time.monotonic() - begin) < seconds:
            while sent < gone * _FLOOD:
                ours.stamp += ours.period
                ours.ask(wait=False)
                sent += 1
            self.peer.take(0)
        self.peer.hear(0.5)
        ours.stamp += ours.period
        took = ours.recovered()  # what still waited for its other half is given up with it
        sent += 1
        after = self.peer.counts()
        found = after["samples answered"] - before["samples answered"]
        came = self.peer.count - answered
        dropped = after["dropped messages"] - before["dropped messages"]
        half = after["incomplete samples"] - before["incomplete samples"]
        row.say(
            f"{sent} sent in {seconds:g} s ({sent / gone:.0f}/s), {found} answered, {came} wrenches"
            f" heard; diagnostics: {dropped} messages dropped, {half} samples incomplete",
            sent=sent, answered=found, lost=sent - found, dropped=dropped,
        )  # fmt: skip
        row.check(came <= found, "more wrenches than answers")
        row.check(dropped + half == 2 * (sent - found), "messages lost that nobody counted")
        row.say(f"next sample answered in {1e3 * took:.1f} ms", recovery=took)
        row.check(math.isfinite(took), "does not go on")
        return row
