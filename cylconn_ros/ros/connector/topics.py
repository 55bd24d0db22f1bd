"""Publishers and subscriptions of the connector node; messages stay serialized."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from visualization_msgs.msg import MarkerArray

from cylconn_ros.connector.load_history import IF_REGULAR, NO
from cylconn_ros.errors import SceneError
from cylconn_ros.messages import pipeline as messages
from cylconn_ros.messages import topic_names
from cylconn_ros.messages.commands.commands import PRELOAD
from cylconn_ros.messages.pipeline import OUTPUTS, MessagePipeline, Response
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.ros import qos
from cylconn_ros.ros.connector.diagnostics import ConnectionStatus
from cylconn_ros.ros.connector.markers import (
    RATE,
    TF_PROFILE,
    TF_TOPIC,
    TF_TYPE,
    Markers,
    Transforms,
)
from cylconn_ros.ros.executor import rcl
from cylconn_ros.ros.executor.executor import InputSubscription, Receive
from cylconn_ros.ros.feed_forward import FeedForward
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.scene.inputs import BODIES, LOAD, STREAM_NUMBER
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

Receiver = Callable[[str, str], Receive]
"""Make the message handler of an input, given its name and its resolved topic."""


def is_triggering(name: str) -> bool:
    """Return True if messages of an input can complete a sample (not loads and commands)."""
    return name in STREAM_NUMBER


class Topics:
    """Publishers and subscriptions of a connector, opened and closed with the node's lifecycle."""

    def __init__(
        self, node: LifecycleNode, connector: str, status: ConnectionStatus, own_thread: bool
    ) -> None:
        """``own_thread``: a SampleExecutor takes the inputs; otherwise the node's executor does."""
        self._node, self._own_thread = node, own_thread
        self._connector, self._status = connector, status
        self.shared: dict[str, str] = {}  # relative topics of inputs about a shared body
        self.remote: set[str] = set()  # inputs that another connector subscribes to
        self._publishers: list[Any] = []
        self._send: list[Callable[[bytes], object]] = []
        self._count_subscribers: dict[str, Callable[[], int]] = {}
        self._subscriptions: dict[str, Any] = {}
        self._names: dict[str, tuple[str, str, qos.QoSProfile]] = {}
        self._marker_publisher: Any = None
        self.transforms: Transforms | None = None  # None: it broadcasts none
        self._transform_publisher: Any = None
        self._markers: Markers | None = None
        self._feed_forward: FeedForward | None = None
        self._drawn = 0.0

    def open_outputs(self, scene: Scene) -> None:
        """Create the publishers; they send only while the node is active."""
        for name, kind in OUTPUTS:
            topic = self.resolved(name)
            profile = qos.samples()
            self._publishers.append(
                self._node.create_lifecycle_publisher(
                    message_class(kind),
                    topic_names.topic(self._connector, name),
                    profile,
                    qos_overriding_options=qos.overriding(),
                    **qos.publisher_events(functools.partial(self._incompatible, topic, False)),
                )
            )
            self._names[name] = (topic, kind, profile)
            made = self._publishers[-1]
            # Inputs are open only while the node is active: no need to check the state again.
            self._send.append(made.handle.publish_raw if self._own_thread else made.publish)
            counted = made.handle if self._own_thread else made
            self._count_subscribers[name] = counted.get_subscription_count
        if scene.markers:
            self._markers = Markers(scene)
            self._marker_publisher = self._node.create_lifecycle_publisher(
                MarkerArray, topic_names.topic(self._connector, "~/markers"), 10
            )
        if scene.feed_forward.enabled:
            self._feed_forward = FeedForward(self._node, self._connector, scene)
        if self.transforms is not None:
            self._transform_publisher = self._node.create_lifecycle_publisher(
                message_class(TF_TYPE), TF_TOPIC, TF_PROFILE
            )

    def close_outputs(self) -> None:
        """Destroy the publishers."""
        for publisher in (*self._publishers, self._marker_publisher, self._transform_publisher):
            if publisher is not None:
                self._node.destroy_lifecycle_publisher(publisher)
        if self._feed_forward is not None:
            self._feed_forward.close()
            self._feed_forward = None
        self._publishers.clear()
        self._send.clear()
        self._count_subscribers.clear()
        self._marker_publisher = self._markers = self._transform_publisher = None

    def resolved(self, name: str) -> str:
        """Resolved topic of an input or output, as in the ROS graph."""
        return self._node.resolve_topic_name(self._topic(name))

    def _topic(self, name: str) -> str:
        return self.shared.get(name) or topic_names.topic(self._connector, name)

    def open_inputs(self, pipeline: MessagePipeline, receiver: Receiver) -> list[InputSubscription]:
        """Subscribe to the inputs, except those that another connector subscribes to."""
        entries = []
        for name, wanted in pipeline.inputs.items():
            if name in self.remote:
                continue
            topic = self.resolved(name)
            profile = self._input_profile(pipeline)
            receive = receiver(name, topic)
            self._subscriptions[name] = self._node.create_subscription(
                message_class(wanted.type),
                self._topic(name),
                _callback(receive),
                profile,
                raw=True,
                qos_overriding_options=qos.overriding(),
                **qos.subscription_events(functools.partial(self._incompatible, topic, True)),
            )
            self._names[name] = (topic, wanted.type, profile)
            made = self._subscriptions[name]
            lost = functools.partial(self._lost, topic)
            entries.append(InputSubscription(made, receive, lost, is_triggering(name)))
        return entries

    @staticmethod
    def _input_profile(pipeline: MessagePipeline) -> qos.QoSProfile:
        return qos.samples(pipeline.scene.qos.reliability, qos.INPUT_DEPTH)

    def close_inputs(self) -> None:
        """Destroy the subscriptions; the SampleExecutor must have returned them."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def publish(self, outputs: Response) -> None:
        """Publish the outputs of a sample, the wrenches first; a failure is counted."""
        try:
            for send, data in zip(self._send, outputs[1:], strict=True):
                if data is not None:
                    send(data)
        except Exception as error:
            self._status.unpublished += 1
            self._status.unpublished_reason = str(error)

    def count_unpublished(self, count: int) -> None:
        """Count messages that compiled code could not publish."""
        self._status.unpublished += count
        self._status.unpublished_reason = rcl.take_error()

    @property
    def publishers(self) -> list[Any]:
        """Handles of the publishers, in the order of the outputs."""
        return [publisher.handle for publisher in self._publishers]

    def has_subscribers(self, name: str) -> bool:
        """Return True if an output has at least one subscription."""
        return self._count_subscribers[name]() > 0

    def expects_load(self, body: int, _stamp: int) -> int:
        """Whether the first sample of a history waits for the load of a body: if it is published.

        See ``SampleMatcher.expects``.
        """
        topic = self.resolved(f"{BODIES[body]}/{LOAD.topic}")
        return IF_REGULAR if self._node.count_publishers(topic) else NO

    def publish_requested(self, stamp: int, pipeline: MessagePipeline) -> None:
        """Publish what the scene requests beside the outputs.

        The feed-forward effort for each call, markers and transforms at most RATE times per second.
        """
        try:
            if self._feed_forward is not None:
                self._feed_forward.publish(stamp, pipeline.out, pipeline.scene)
            if time.monotonic() - self._drawn < 1.0 / RATE:
                return
            self._drawn = time.monotonic()
            sample = pipeline.matcher.sample
            if self._markers is not None:
                self._marker_publisher.publish(self._markers.draw(stamp, sample, pipeline.out))
            if self.transforms is not None:
                self._transform_publisher.publish(self.transforms.message(stamp, sample))
        except Exception as error:
            self._status.unpublished += 1
            self._status.unpublished_reason = f"markers, transforms or feed_forward: {error}"

    def end_feed_forward(self, stamp: int) -> None:
        """Publish a feed-forward effort of zero, with a zero wrench."""
        if self._feed_forward is not None:
            self._feed_forward.publish_zero(stamp)

    def outgoing(self, outputs: Response) -> Iterator[tuple[str, bytes]]:
        """Resolved topic and serialized message of every output of a sample."""
        for (name, _), data in zip(OUTPUTS, outputs[1:], strict=True):
            if data is not None:
                yield self._names[name][0], data

    def resolved_names(self, pipeline: MessagePipeline) -> dict[str, str]:
        """Resolved topic of every input and output, by the name in a single-connector node."""
        return {name: self.resolved(name) for name in _kinds(pipeline)}

    def recorded_topics(self, pipeline: MessagePipeline) -> list[TopicInfo]:
        """Topics of a recording, resolved, with the QoS in force or, before they open, intended."""
        found = []
        for name, kind in _kinds(pipeline).items():
            topic = self.resolved(name)
            intended = self._input_profile(pipeline) if name in pipeline.inputs else qos.samples()
            profile = self._names[name][2] if name in self._names else intended
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

    def wait_for_acknowledgement(self, timeout: Duration) -> None:
        """Wait until subscribers have acknowledged the wrenches, at most ``timeout``."""
        for publisher in self._publishers[:2]:
            publisher.wait_for_all_acked(timeout)

    def _incompatible(self, topic: str, is_input: bool, policy: str) -> None:
        self._status.incompatible[topic] = qos.incompatible(topic, policy, is_input)

    def count_commanders(self) -> None:
        """Note the topics of which one publisher is expected, and that have several."""
        topic = self.resolved(PRELOAD)
        count = self._node.count_publishers(topic) if PRELOAD in self._subscriptions else 0
        self._status.several = {topic: count} if count > 1 else {}

    def withdraw_incompatible(self) -> None:
        """Forget warnings about incompatible QoS whose peers have gone or changed."""
        warnings, profiles = self._status.incompatible, {}
        if warnings:
            profiles = {topic: (name, profile) for name, (topic, _, profile) in self._names.items()}
        for topic in list(warnings):
            name, profile = profiles[topic]
            if name in self._subscriptions:
                peers = self._node.get_publishers_info_by_topic(topic)
                pairs = [(peer.qos_profile, profile) for peer in peers]
            else:
                peers = self._node.get_subscriptions_info_by_topic(topic)
                pairs = [(profile, peer.qos_profile) for peer in peers]
            if all(qos.are_compatible(*pair) for pair in pairs):
                del warnings[topic]

    def _lost(self, topic: str, count: int) -> None:
        self._status.lost[topic] = self._status.lost.get(topic, 0) + count

    def check_types(self, graph: Mapping[str, Sequence[str]]) -> None:
        """Find publishers of another message type; ``graph``: message types by topic."""
        self._status.other_types.clear()
        for name in self._subscriptions:
            topic, kind, _ = self._names[name]
            if set(graph.get(topic, ())) <= {kind}:
                continue
            publishers = self._node.get_publishers_info_by_topic(topic)
            others = {info.topic_type for info in publishers} - {kind}
            if others:
                seen = ", ".join(sorted(others))
                self._status.other_types[topic] = (
                    f"{topic}: a publisher has message type {seen} (expected {kind}); "
                    "its messages are not received"
                )


def _kinds(pipeline: MessagePipeline) -> dict[str, str]:
    return {name: wanted.type for name, wanted in pipeline.inputs.items()} | dict(OUTPUTS)


def _callback(receive: Receive) -> Callable[[bytes], None]:
    """Subscription callback for the node's executor.

    It does not take the message info: rclpy fails if a callback for raw messages does.
    """

    def callback(data: bytes) -> None:
        receive(data)

    return callback


def check_qos_overrides(
    node: LifecycleNode, parameters: Mapping[str, Any], named: Mapping[Topics, Scene]
) -> None:
    """Raise SceneError for a qos_overrides parameter that belongs to no topic of the node."""
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


def assign_frames(topics: Mapping[Topics, Scene]) -> None:
    """Let one connector broadcast each body frame: of connectors that share a body, the first.

    Raises SceneError if a scene wants transforms and tf2_msgs is not installed.
    """
    seen: set[str] = set()
    for one, scene in topics.items():
        if not scene.tf:
            continue
        try:
            message_class(TF_TYPE)
        except ImportError:
            raise SceneError(
                "tf = true: needs the ROS package tf2_msgs, which is not installed (sudo apt "
                "install ros-jazzy-tf2-msgs, or build it with colcon; PyPI has no wheel of it)"
            ) from None
        frames = {k: body.frame for k, body in enumerate(scene.bodies) if body.frame not in seen}
        seen |= set(frames.values())
        one.transforms = Transforms(scene.world_frame, frames)
