"""The inputs of a recording onto live topics, in their own time, for machines without rosbag2.

``python -m cylconn_ros.ros.player BAG`` publishes the very bytes that were recorded, on the topics
they were recorded from, and nothing of what a connector had published itself. Remap with
``--ros-args -r from:=to``.
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
from cylconn_ros.messages.pipeline import JOINT_STATE, ODOMETRY, POSE, TWIST, WRENCH
from cylconn_ros.process.interrupt import INTERRUPTED
from cylconn_ros.recording.bag import Bag
from cylconn_ros.ros import qos
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.ros.middleware import prefer_quiet_writers

PLAYED = {POSE: ("/pose",), TWIST: ("/twist",), ODOMETRY: (), WRENCH: ("/load",),
          JOINT_STATE: ("/command",)}  # fmt: skip
"""Types that a connector reads, and how the names of their topics end."""


def is_input(topic: str, kind: str) -> bool:
    """Whether a recorded topic carries what a connector reads."""
    return kind in PLAYED and topic.endswith(PLAYED[kind] or ("",))


_LATE = 0.005  # s


class Player:
    """Publish a recording's inputs."""

    def __init__(self, node: Node, bag: Bag) -> None:
        self._node, self._bag = node, bag
        topics = {topic: kind for topic, kind in bag.types.items() if is_input(topic, kind)}
        if not topics:
            raise RecordingError(f"{bag.path}: holds no inputs of a connector")
        self._publishers: dict[str, Any] = {
            topic: node.create_publisher(message_class(kind), topic, qos.samples())
            for topic, kind in topics.items()
        }

    def wait(self, patience: float) -> bool:
        """Wait until somebody listens to poses, twists or odometry; False where nobody does."""
        wanted = [
            publisher
            for topic, publisher in self._publishers.items()
            if not topic.endswith(("/load", "/command"))
        ]
        end = time.monotonic() + patience
        while time.monotonic() < end:
            if all(publisher.get_subscription_count() for publisher in wanted):
                return True
            rclpy.spin_once(self._node, timeout_sec=0.05)
        return False

    def play(self, rate: float) -> int:
        """Publish at ``rate`` times the recorded speed; 0: at once. How many were sent."""
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
                if early < -_LATE:  # what is late is not made up for: a burst overflows queues
                    began -= early
            publisher.publish(data)
            sent += 1
        return sent

    def finish(self) -> None:
        """Wait until what was sent has arrived."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=5.0))


def main(arguments: Sequence[str] | None = None) -> int:
    """Play a recording; 0 if all of it went out to somebody."""
    given = list(sys.argv if arguments is None else ["play", *arguments])
    options = _parser().parse_args(rclpy.utilities.remove_ros_args(given)[1:])
    prefer_quiet_writers()
    rclpy.init(args=given)
    node = rclpy.create_node("player")
    try:
        bag = Bag(options.bag)
        player = Player(node, bag)
        if not player.wait(options.patience):
            print(f"nobody listens to the inputs of {bag.path} (topics: {', '.join(bag.types)})")
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
    parser.add_argument("--rate", type=float, default=1.0, help="of the recorded speed; 0: at once")
    parser.add_argument(
        "--patience", metavar="S", type=float, default=30.0, help="to wait for somebody to listen"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
