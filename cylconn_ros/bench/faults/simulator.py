"""External simulator that can misbehave: moves two bodies, publishes and receives raw bytes.

It is light (messages are serialized from templates, one wait set), so that lost messages are lost
by the node. It checks every wrench that a node publishes.
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

from cylconn_ros.bench.stability.loop import initial_state
from cylconn_ros.core import plant
from cylconn_ros.errors import ProcessError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.pipeline import STATE
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.ros.wait_set import WaitSet
from cylconn_ros.scene.inputs import BODIES, WRENCH
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Messages = list[tuple[str, bytes]]
"""Relative topic and bytes of each message."""

_DISCOVERY = 300.0  # s until a node must have appeared; its first start compiles the physics
_MUTUAL_DISCOVERY = 0.5  # s until the node has discovered the simulator, too
_QUEUE = QoSProfile(depth=5000)  # reliable and long: the simulator itself loses no message


class Wrench(NamedTuple):
    """A published wrench."""

    stamp: int  # ns
    values: tuple[float, ...]  # (6,) force, torque
    received: float  # s, wall clock


class Bodies:
    """The bodies of a scene, moved with any period.

    Attributes
    ----------
        state: (26,) poses and twists. start: the initial state. loads: (12,) external loads.
    """

    def __init__(self, scene: Scene) -> None:
        self._par = pack(scene, plant=True)
        self.start: Array = initial_state(scene)
        self.loads: Array = np.zeros(12)
        self.state: Array = self.start.copy()

    def step(self, wrenches: Sequence[Array], h: float) -> None:
        """Move by ``h`` seconds under the (6,) wrenches on A and B, as published."""
        plant.step(self._par, self.state, wrenches[0], wrenches[1], self.loads, h)

    def energy(self) -> float:
        """Kinetic and gravitational energy, J."""
        return float(plant.energy(self._par, self.state))


class Simulator:
    """Topics of one simulator, for the connector of a scene in a namespace.

    Attributes
    ----------
        wrenches: newest wrench on A and on B.
        recorded: wrenches on the last moving body since :meth:`record`.
        not_finite: number of wrenches with a value that is not finite. count: of all wrenches.
        states: messages of ``~/state``. reports: messages of ``/diagnostics``.
    """

    def __init__(self, scene: Scene, namespace: str = "", state: bool = False) -> None:
        """``state``: also subscribe to ``~/state``, as a dashboard does."""
        self.scene = scene
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("simulator", context=self.context)
        self.exchange = Exchange(scene, PlantCounts())
        self.moving = self.exchange.moving
        self._namespace = namespace
        names = {**self.exchange.outputs}
        names |= {f"{BODIES[k]}/load": WRENCH for k in self.moving}
        self._publishers = {
            name: self.node.create_publisher(message_class(kind), f"{namespace}/{name}", _QUEUE)
            for name, kind in names.items()
        }
        self._subscriptions: list[tuple[Any, Callable[[bytes], None]]] = []
        for k in self.moving:
            self.subscribe(f"{namespace}/{BODIES[k]}/wrench", WRENCH, self._wrench_handler(k))
        self.states: list[bytes] = []
        if state:
            self.subscribe(f"{namespace}/connector/state", STATE, self.states.append)
        self.reports: list[DiagnosticArray] = []
        self._subscribe(DiagnosticArray, "/diagnostics", self._take_report)
        self._wait_set: WaitSet | None = None
        self.wrenches: list[Wrench | None] = [None, None]
        self.recorded: list[Wrench] = []
        self._recording = False
        self.not_finite = self.count = 0

    # --- sending ---

    def advertise(self, name: str, kind: str) -> None:
        """Create one more publisher, of messages with the type ``kind`` on a relative topic."""
        self._publishers[name] = self.node.create_publisher(
            message_class(kind), f"{self._namespace}/{name}", _QUEUE
        )

    def publish(self, name: str, data: bytes) -> None:
        """Publish any bytes on a relative topic."""
        self._publishers[name].handle.publish_raw(data)

    def sample(self, stamp: int, state: Array) -> Messages:
        """Serialize a sample: (26,) poses and twists, stamp in ns."""
        return list(self.exchange.messages(stamp, state))

    def send(self, messages: Messages) -> None:
        """Publish messages in order."""
        for name, data in messages:
            self.publish(name, data)

    # --- receiving ---

    def subscribe(self, topic: str, kind: str, handler: Callable[[bytes], None]) -> None:
        """Subscribe to serialized messages; only before the first :meth:`take`."""
        self._subscribe(message_class(kind), topic, handler)

    def _subscribe(self, kind: Any, topic: str, handler: Callable[[bytes], None]) -> None:
        subscription = self.node.create_subscription(kind, topic, lambda _: None, _QUEUE, raw=True)
        self._subscriptions.append((subscription, handler))

    def _wrench_handler(self, body: int) -> Callable[[bytes], None]:
        def handle(data: bytes) -> None:
            message = cdr_decoder.read_wrench(data)
            wrench = Wrench(message.stamp, message.values, time.time())
            self.count += 1
            self.not_finite += not math.isfinite(sum(message.values))
            self.wrenches[body] = wrench
            if self._recording and body == self.moving[-1]:
                self.recorded.append(wrench)

        return handle

    def _take_report(self, data: bytes) -> None:
        self.reports.append(deserialize_message(data, DiagnosticArray))

    def record(self) -> list[Wrench]:
        """Record the wrenches on the last moving body from now on; return the list they go to."""
        self._recording, self.recorded = True, []
        return self.recorded

    def take(self, timeout: int) -> None:
        """Take the queued messages; wait up to ``timeout`` ns for the first."""
        if self._wait_set is None:
            handles = [subscription.handle for subscription, _ in self._subscriptions]
            self._wait_set = WaitSet(handles, self.context)
        self._wait_set.wait(timeout)
        for subscription, handler in self._subscriptions:
            take_message, kind = subscription.handle.take_message, subscription.msg_type
            while (taken := take_message(kind, True)) is not None:
                handler(taken[0])

    def spin_for(self, seconds: float) -> None:
        """Take messages for a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self.take(round(left * 1e9))

    def spin_until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Take messages until a condition holds; False if it does not within ``seconds``."""
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.take(min(round(left * 1e9), 50_000_000))
        return True

    def connect(self, running: Callable[[], bool] = lambda: True) -> None:
        """Wait until a node is connected on all topics.

        Raises ProcessError after 300 s, or when ``running`` returns False.
        """
        publishers = list(self._publishers.values())
        wrenches = [f"{self._namespace}/{BODIES[k]}/wrench" for k in self.moving]

        def connected() -> bool:
            return all(p.get_subscription_count() for p in publishers) and all(
                self.node.count_publishers(name) for name in wrenches
            )

        end = time.monotonic() + _DISCOVERY
        while not connected():
            if time.monotonic() > end or not running():
                raise ProcessError("no connector appeared")
            time.sleep(0.02)
        self.spin_for(_MUTUAL_DISCOVERY)

    def has_response(self, stamp: int) -> bool:
        """Whether the newest wrench of every moving body has this stamp."""
        newest = [self.wrenches[k] for k in self.moving]
        return all(w is not None and w.stamp == stamp for w in newest)

    def status(self, part: str) -> dict[str, str]:
        """The newest diagnostics of a part: values, level and message."""
        for array in reversed(self.reports):
            for status in array.status:
                if status.name.endswith(f": {part}"):
                    values = {pair.key: pair.value for pair in status.values}
                    return {**values, "level": str(ord(status.level)), "message": status.message}
        return {}

    def counts(self) -> dict[str, int]:
        """The integer values of all parts of diagnostics, from a report made after this call."""
        known = len(self.reports)
        self.spin_until(lambda: len(self.reports) > known + 1, 10.0)
        parts = [self.status(part) for part in ("solution", "topics", "recording", "samples")]
        found = {name: value for part in parts for name, value in part.items()}
        return {name: int(value) for name, value in found.items() if value.isdigit()}

    def close(self) -> None:
        """Destroy the node and its context."""
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
