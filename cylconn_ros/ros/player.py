"""Publish the inputs of a recording at their recorded times, for machines without rosbag2.

``python -m cylconn_ros.ros.player BAG`` publishes the recorded bytes unchanged, on the topics of
the recording, and none of the connector's outputs. Remap with ``--ros-args -r from:=to``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node

from cylconn_ros.errors import RecordingError
from cylconn_ros.messages.commands.commands import FLOAT64, JOINT_STATE
from cylconn_ros.process.interrupt import INTERRUPTED
from cylconn_ros.recording.bag import Bag
from cylconn_ros.ros import qos
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.ros.middleware import use_default_profile
from cylconn_ros.scene.inputs import INPUTS

PLAYED = {
    **{kind.type: () if kind.carries_whole_motion else (f"/{kind.topic}",) for kind in INPUTS},
    JOINT_STATE: ("/command",),
    FLOAT64: ("/preload",),
}
"""Message types that a connector subscribes to, and the endings of their topics."""


def is_input(topic: str, kind: str) -> bool:
    """Return True if a recorded topic is an input of a connector."""
    return kind in PLAYED and topic.endswith(PLAYED[kind] or ("",))


_SETTLED = 0.5  # s without a further subscription
_LATE = 0.005  # s, delay above which the schedule is shifted


class Player:
    """Publish a recording's inputs."""

    def __init__(self, node: Node, bag: Bag) -> None:
        self._node, self._bag = node, bag
        topics = {topic: kind for topic, kind in bag.types.items() if is_input(topic, kind)}
        if not topics:
            raise RecordingError(f"{bag.path}: contains no inputs of a connector")
        self._publishers: dict[str, Any] = {
            topic: node.create_publisher(
                message_class(kind), topic, qos.samples(depth=qos.INPUT_DEPTH)
            )
            for topic, kind in topics.items()
        }

    def wait(self, patience: float) -> bool:
        """Wait up to ``patience`` s for subscriptions to all poses, twists and odometry.

        Wait also until no further subscription has come for a while: beside a connector, a recorder
        may listen, and the first match is that of either. Returns False if one has none.
        """
        wanted = [
            publisher
            for topic, publisher in self._publishers.items()
            if not topic.endswith(("/load", "/command", "/preload"))
        ]
        end = time.monotonic() + patience
        counts, since = [0], 0.0
        while time.monotonic() < end:
            seen = [publisher.get_subscription_count() for publisher in wanted]
            if seen != counts:
                counts, since = seen, time.monotonic()
            if all(counts) and time.monotonic() - since > _SETTLED:
                return True
            rclpy.spin_once(self._node, timeout_sec=0.05)
        return all(counts)

    def play(self, rate: float) -> int:
        """Publish at ``rate`` times the recorded speed; 0: without waiting.

        Returns the number of messages.
        """
        sent, began, first = 0, time.monotonic(), None
        for topic, log_time, data in self._bag.messages():
            publisher = self._publishers.get(topic)
            if publisher is None:
                continue
            first = log_time if first is None else first
            if rate > 0.0:
                due = began + (log_time - first) * 1e-9 / rate
                early = due - time.monotonic()
                time.sleep(max(early, 0.0))
                if (
                    early < -_LATE
                ):  # shift the schedule: a burst of late messages would overflow queues
                    began -= early
            publisher.publish(data)
            sent += 1
        return sent

    def finish(self) -> None:
        """Wait until the messages are acknowledged."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=5.0))


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a recording; return 0 if all messages were published to a subscriber."""
    given = list(sys.argv if arguments is None else ["play", *arguments])
    options = _parser().parse_args(rclpy.utilities.remove_ros_args(given)[1:])
    use_default_profile()
    rclpy.init(args=given)
    node = rclpy.create_node("player")
    try:
        bag = Bag(options.bag)
        player = Player(node, bag)
        if not player.wait(options.patience):
            print(f"no subscriptions to the inputs of {bag.path} (topics: {', '.join(bag.types)})")
            return 1
        count = player.play(options.rate)
        player.finish()
        print(f"played {count} messages of {bag.path}")
        if bag.damage:
            print(f"DAMAGED: {bag.damage}")
        return 1 if bag.damage else 0
    except RecordingError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="play", description=__doc__)
    parser.add_argument("bag", metavar="BAG", type=Path, help="recorded directory or file")
    parser.add_argument(
        "--rate", type=float, default=1.0, help="multiple of the recorded speed; 0: without waiting"
    )
    parser.add_argument(
        "--patience", metavar="S", type=float, default=30.0, help="time to wait for subscriptions"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
