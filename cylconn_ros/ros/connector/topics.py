"""The topics of the connector node: what it subscribes to and publishes, as bytes."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from visualization_msgs.msg import MarkerArray

from cylconn_ros.errors import SceneError
from cylconn_ros.messages import pipeline as messages
from cylconn_ros.messages import topic_names
from cylconn_ros.messages.pipeline import OUTPUTS, Answer, Answering
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.ros import qos
from cylconn_ros.ros.connector.diagnostics import Links
from cylconn_ros.ros.connector.markers import RATE, Markers
from cylconn_ros.ros.executor import rcl
from cylconn_ros.ros.executor.executor import Entry, Receive
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

Receiver = Callable[[str, str], Receive]
"""Gives, for an input's name and its topic, what takes the messages."""


def is_seldom(name: str) -> bool:
    """Whether messages of an input complete no sample."""
    return name.endswith(("load", "command"))


class Topics:
    """Publishers and subscriptions of a connector, opened and closed with the node's lifecycle."""

    def __init__(self, node: LifecycleNode, connector: str, links: Links, straight: bool) -> None:
        """``straight``: a loop serves the inputs; otherwise the node's executor does."""
        self._node, self._straight = node, straight
        self._connector, self._links = connector, links
        self.shared: dict[str, str] = {}  # inputs that are of a shared body: relative topics
        self.foreign: set[str] = set()  # those that another connector subscribes to
        self._publishers: list[Any] = []
        self._send: list[Callable[[bytes], object]] = []
        self._listeners: dict[str, Callable[[], int]] = {}
        self._subscriptions: dict[str, Any] = {}
        self._names: dict[str, tuple[str, str, qos.QoSProfile]] = {}
        self._marker_publisher: Any = None
        self._markers: Markers | None = None
        self._drawn = 0.0

    def open_outputs(self, scene: Scene) -> None:
        """Advertise; messages go out only while the node is active."""
        for name, kind in OUTPUTS:
            topic = self.resolved(name)
            profile = qos.samples()
            self._publishers.append(
                self._node.create_lifecycle_publisher(
                    message_class(kind),
                    topic_names.topic(self._connector, name),
                    profile,
                    qos_overriding_options=qos.overriding(),
                    **qos.writing(functools.partial(self._incompatible, topic)),
                )
            )
            self._names[name] = (topic, kind, profile)
            made = self._publishers[-1]
            # Inputs are open while the node is active only, so the state need not be asked again.
            self._send.append(made.handle.publish_raw if self._straight else made.publish)
            counted = made.handle if self._straight else made
            self._listeners[name] = counted.get_subscription_count
        if scene.markers:
            self._markers = Markers(scene)
            self._marker_publisher = self._node.create_lifecycle_publisher(
                MarkerArray, topic_names.topic(self._connector, "~/markers"), 10
            )

    def close_outputs(self) -> None:
        """Take the publishers back."""
        for publisher in (*self._publishers, self._marker_publisher):
            if publisher is not None:
                self._node.destroy_lifecycle_publisher(publisher)
        self._publishers.clear()
        self._send.clear()
        self._listeners.clear()
        self._marker_publisher = self._markers = None

    def resolved(self, name: str) -> str:
        """The whole name of an input or output, as the graph has it."""
        return self._node.resolve_topic_name(self._topic(name))

    def _topic(self, name: str) -> str:
        return self.shared.get(name) or topic_names.topic(self._connector, name)

    def open_inputs(self, answering: Answering, receiver: Receiver) -> list[Entry]:
        """Subscribe to the inputs; what a loop is to serve."""
        entries = []
        for name, wanted in answering.inputs.items():
            if name in self.foreign:
                continue
            topic = self.resolved(name)
            profile = qos.samples()
            receive = receiver(name, topic)
            self._subscriptions[name] = self._node.create_subscription(
                message_class(wanted.type),
                self._topic(name),
                _callback(receive),
                profile,
                raw=True,
                qos_overriding_options=qos.overriding(),
                **qos.reading(functools.partial(self._incompatible, topic)),
            )
            self._names[name] = (topic, wanted.type, profile)
            made = self._subscriptions[name]
            entries.append(Entry(made, receive, self._lost, is_seldom(name)))
        return entries

    def close_inputs(self) -> None:
        """Take the subscriptions back; no loop may serve them any more."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def publish(self, answer: Answer) -> None:
        """Publish an answer, the wrenches first; a failure is counted."""
        try:
            for send, data in zip(self._send, answer[1:], strict=True):
                if data is not None:
                    send(data)
        except Exception as error:
            self._links.unsent += 1
            self._links.unsent_text = str(error)

    def failed(self, count: int) -> None:
        """Count messages that compiled code could not publish."""
        self._links.unsent += count
        self._links.unsent_text = rcl.taken_error()

    @property
    def publishers(self) -> list[Any]:
        """Their handles, in the order of an answer's messages."""
        return [publisher.handle for publisher in self._publishers]

    def wanted(self, name: str) -> bool:
        """Whether anybody listens to an output."""
        return self._listeners[name]() > 0

    def draw(self, stamp: int, answering: Answering) -> None:
        """Publish markers, at most RATE times a second."""
        if self._markers is None or time.monotonic() - self._drawn < 1.0 / RATE:
            return
        self._drawn = time.monotonic()
        try:
            picture = self._markers.draw(stamp, answering.matcher.sample, answering.out)
            self._marker_publisher.publish(picture)
        except Exception as error:
            self._links.unsent += 1
            self._links.unsent_text = f"markers: {error}"

    def outgoing(self, answer: Answer) -> Iterator[tuple[str, bytes]]:
        """Topic and bytes of every message of an answer."""
        for (name, _), data in zip(OUTPUTS, answer[1:], strict=True):
            if data is not None:
                yield self._names[name][0], data

    def by_name(self, answering: Answering) -> dict[str, str]:
        """The whole name of every input and output, by the name that a connector alone has."""
        return {name: self.resolved(name) for name in _kinds(answering)}

    def recorded(self, answering: Answering) -> list[TopicInfo]:
        """Every topic a recording holds, as resolved and with the QoS in force."""
        found = []
        for name, kind in _kinds(answering).items():
            topic = self.resolved(name)
            profile = self._names[name][2] if name in self._names else qos.samples()
            found.append(
                TopicInfo(
                    name=topic,
                    type=kind,
                    reliability=profile.reliability.name.lower(),
                    history=profile.history.name.lower(),
                    depth=profile.depth,
                )
            )
        return found

    def wait_until_taken(self, timeout: Duration) -> None:
        """Wait until subscribers have acknowledged the wrenches, at most ``timeout``."""
        for publisher in self._publishers[:2]:
            publisher.wait_for_all_acked(timeout)

    def _incompatible(self, topic: str, policy: str) -> None:
        self._links.incompatible[topic] = policy
        self._node.get_logger().warning(f"{topic}: a peer's QoS is incompatible ({policy})")

    def _lost(self, count: int) -> None:
        self._links.lost += count

    def look_for_types(self, graph: Mapping[str, Sequence[str]]) -> None:
        """See who publishes other messages on an input; ``graph``: types of topics, by name."""
        self._links.other_types.clear()
        for name in self._subscriptions:
            topic, kind, _ = self._names[name]
            if set(graph.get(topic, ())) <= {kind}:
                continue
            publishers = self._node.get_publishers_info_by_topic(topic)
            others = {info.topic_type for info in publishers} - {kind}
            if others:
                self._links.other_types[topic] = f"{', '.join(sorted(others))}, not {kind}"


def _kinds(answering: Answering) -> dict[str, str]:
    return {name: wanted.type for name, wanted in answering.inputs.items()} | dict(OUTPUTS)


def _callback(receive: Receive) -> Callable[[bytes], None]:
    """The same for an executor; rclpy's fails where a callback asks for what tells of gaps, too."""

    def callback(data: bytes) -> None:
        receive(data)

    return callback


def check_qos_overrides(
    node: LifecycleNode, parameters: Mapping[str, Any], named: Mapping[Topics, Scene]
) -> None:
    """Raise SceneError for a qos_overrides parameter that no topic of the node will look at."""
    given = {name: value for name, value in parameters.items() if name.startswith("qos_overrides.")}
    if not given:
        return
    kinds = [
        (topics.resolved(name), kind)
        for topics, scene in named.items()
        for kind, own in (
            ("publisher", [name for name, _ in OUTPUTS]),
            ("subscription", messages.input_names(scene)),
        )
        for name in own
    ]
    known = [
        f"qos_overrides.{topic}.{kind}.{policy}"
        for topic, kind in dict.fromkeys(kinds)
        for policy in ("history", "depth", "reliability")
    ]
    for name, value in given.items():
        if name not in known:
            raise SceneError(
                f"{name} = {show(value)}: no such parameter; known: {', '.join(known)}"
            )
