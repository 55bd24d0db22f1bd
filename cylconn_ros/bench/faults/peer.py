"""A foreign simulator that can misbehave: it moves two bodies, and sends and hears bytes.

It is light (bytes laid out once, one wait set), so that what is lost is lost by the node. Every
wrench that a node publishes passes through here and is looked at.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from cylconn_ros.core import plant
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.pipeline import BODIES, STATE, WRENCH
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.ros.wait_set import WaitSet
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Messages = list[tuple[str, bytes]]

MEETING = 300.0  # s for a node to appear; the first start ever compiles
_SETTLING = 0.5  # s; it must have seen us, too
_QUEUE = QoSProfile(depth=5000)  # reliable; what is lost is lost by the node


class Wrench(NamedTuple):
    """A wrench that was published."""

    stamp: int  # ns
    values: tuple[float, ...]  # (6,) force, torque
    when: float  # s, wall clock, when it was taken here


class Bodies:
    """The bodies of a scene, moved by any period."""

    def __init__(self, scene: Scene) -> None:
        self._par = pack(scene, plant=True)
        start = [part for k in (0, 1) for part in (scene.initial_pose(k), scene.initial_twist(k))]
        self.start: Array = np.array([x for part in start for x in part])
        self.loads: Array = np.zeros(12)
        self.state: Array = self.start.copy()

    def step(self, wrenches: Sequence[Array], h: float) -> None:
        """Move by ``h`` seconds under (6,) wrenches as published."""
        plant.step(self._par, self.state, wrenches[0], wrenches[1], self.loads, h)

    def energy(self) -> float:
        """Kinetic and gravitational energy, J."""
        return float(plant.energy(self._par, self.state))


class Peer:
    """One simulator's topics, for the scene of a connector in a namespace.

    Attributes
    ----------
        wrenches: newest wrench on A and on B.
        heard: wrenches on body B since :meth:`listen`, if asked.
        not_finite: wrenches with a number that is not finite, of all that ever came.
        count: wrenches that ever came.
    """

    def __init__(self, scene: Scene, space: str = "", state: bool = False) -> None:
        """``state``: subscribe to ``~/state`` too, as a dashboard does."""
        self.scene = scene
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("simulator", context=self.context)
        self.exchange = Exchange(scene, PlantCounts())
        self.moving = self.exchange.moving
        self._space = space
        names = {**self.exchange.outputs}
        names |= {f"{BODIES[k]}/load": WRENCH for k in self.moving}
        self._publishers = {
            name: self.node.create_publisher(message_class(kind), f"{space}/{name}", _QUEUE)
            for name, kind in names.items()
        }
        self._takers: list[tuple[Any, Callable[[bytes], None]]] = []
        for k in self.moving:
            self.subscribe(f"{space}/{BODIES[k]}/wrench", WRENCH, self._taker(k))
        self.states: list[bytes] = []
        if state:
            self.subscribe(f"{space}/connector/state", STATE, self._keep_state)
        self.reports: list[DiagnosticArray] = []
        self._subscribe(DiagnosticArray, "/diagnostics", self._report)
        self._waiting: WaitSet | None = None
        self.wrenches: list[Wrench | None] = [None, None]
        self.heard: list[Wrench] = []
        self._listening = False
        self.not_finite = self.count = 0

    # --- sending ---------------------------------------------------------------------------------

    def publish(self, name: str, data: bytes) -> None:
        """Publish bytes, whatever they are, on a relative topic."""
        self._publishers[name].handle.publish_raw(data)

    def sample(self, stamp: int, state: Array) -> Messages:
        """The messages of a sample: (26,) poses and twists, stamp in ns."""
        return list(self.exchange.messages(stamp, state))

    def send(self, messages: Messages) -> None:
        """Publish all of them."""
        for name, data in messages:
            self.publish(name, data)

    # --- hearing ---------------------------------------------------------------------------------

    def subscribe(self, topic: str, kind: str, take: Callable[[bytes], None]) -> None:
        """Hear a topic as bytes; before the first :meth:`take`."""
        self._subscribe(message_class(kind), topic, take)

    def _subscribe(self, kind: Any, topic: str, take: Callable[[bytes], None]) -> None:
        made = self.node.create_subscription(kind, topic, lambda _: None, _QUEUE, raw=True)
        self._takers.append((made, take))

    def _taker(self, body: int) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            read = cdr_decoder.read_wrench(data)
            wrench = Wrench(read.stamp, read.values, time.time())
            self.count += 1
            self.not_finite += not math.isfinite(sum(read.values))
            self.wrenches[body] = wrench
            if self._listening and body == self.moving[-1]:
                self.heard.append(wrench)

        return take

    def _keep_state(self, data: bytes) -> None:
        self.states.append(data)

    def _report(self, data: bytes) -> None:
        self.reports.append(deserialize_message(data, DiagnosticArray))

    def listen(self) -> list[Wrench]:
        """Keep what comes on body B from now on; the list that it is kept in."""
        self._listening, self.heard = True, []
        return self.heard

    def take(self, timeout: int) -> None:
        """Take what is there, or comes within ``timeout`` ns."""
        if self._waiting is None:
            handles = [made.handle for made, _ in self._takers]
            self._waiting = WaitSet(handles, self.context)
        self._waiting.wait(timeout)
        for made, take in self._takers:
            while (taken := made.handle.take_message(made.msg_type, True)) is not None:
                take(taken[0])

    def hear(self, seconds: float) -> None:
        """Take what comes within a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self.take(round(left * 1e9))

    def until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Take what comes until a condition holds; whether it did within ``seconds``."""
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.take(min(round(left * 1e9), 50_000_000))
        return True

    def meet(self, alive: Callable[[], bool] = lambda: True) -> None:
        """Wait until a node is connected on all topics; RuntimeError where it ends before."""
        publishers = list(self._publishers.values())
        wrenches = [f"{self._space}/{BODIES[k]}/wrench" for k in self.moving]

        def met() -> bool:
            return all(p.get_subscription_count() for p in publishers) and all(
                self.node.count_publishers(name) for name in wrenches
            )

        end = time.monotonic() + MEETING
        while not met():
            if time.monotonic() > end or not alive():
                raise RuntimeError("no connector appeared")
            time.sleep(0.02)
        self.hear(_SETTLING)

    def answered(self, stamp: int) -> bool:
        """Whether every moving body has the wrench of a stamp."""
        newest = [self.wrenches[k] for k in self.moving]
        return all(w is not None and w.stamp == stamp for w in newest)

    def status(self, part: str) -> dict[str, str]:
        """The newest values of a part of diagnostics, with level and message."""
        for array in reversed(self.reports):
            for status in array.status:
                if status.name.endswith(f": {part}"):
                    values = {pair.key: pair.value for pair in status.values}
                    return {**values, "level": str(ord(status.level)), "message": status.message}
        return {}

    def counts(self) -> dict[str, int]:
        """The whole numbers of all parts, as of a report that is not older than this call."""
        known = len(self.reports)
        self.until(lambda: len(self.reports) > known + 1, 10.0)
        parts = [self.status(part) for part in ("solution", "topics", "recording", "samples")]
        found = {name: value for part in parts for name, value in part.items()}
        return {name: int(value) for name, value in found.items() if value.isdigit()}

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
