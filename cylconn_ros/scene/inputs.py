"""Input types: the message types that carry the pose, twist or load of a body, in one table.

Everything that depends on an input type reads :data:`INPUTS`: the choices of the parameter
``input``, subscriptions, decoders, replay, the readers of recordings and the player. A new type is
one row here and, for its message package, one dependency in ``package.xml``.

All these messages have the same structure: header, a child frame (some types), then a block of
float64 numbers up to the end of the message. The offsets of the quantities in that block are
constant.
"""

from __future__ import annotations

from typing import Final, NamedTuple

POSE: Final = "geometry_msgs/msg/PoseStamped"
TWIST: Final = "geometry_msgs/msg/TwistStamped"
WRENCH: Final = "geometry_msgs/msg/WrenchStamped"
ODOMETRY: Final = "nav_msgs/msg/Odometry"

BODIES: Final = ("body_a", "body_b")
ABSENT: Final = -1
"""Offset of a quantity that a message type does not carry."""


class InputType(NamedTuple):
    """A message type that carries quantities of one body.

    The offsets count in bytes from the begin of the block of numbers. The fields name the columns
    of a recording: position and orientation, linear and angular velocity, force and torque.
    """

    topic: str  # name of the topic below the body's name
    type: str  # package/msg/Name
    mode: str  # value of the parameter `input` that selects it; "": read with every value
    size: int  # bytes of the block of numbers
    pose: int = ABSENT  # offset of the pose: position, quaternion x y z w
    twist: int = ABSENT  # offset of the twist: linear, angular velocity
    load: int = ABSENT  # offset of the external load: force, torque
    has_child_frame: bool = False  # the child frame states the axes of the twist
    pose_fields: tuple[str, str] = ("", "")
    pair_fields: tuple[str, str] = ("", "")  # of the twist or load

    @property
    def carries_motion(self) -> bool:
        """Whether the type carries a pose or a twist."""
        return self.load == ABSENT

    @property
    def carries_whole_motion(self) -> bool:
        """Whether one message carries both pose and twist."""
        return self.pose != ABSENT and self.twist != ABSENT


_COVARIANCE = 36 * 8

INPUTS: Final = (
    InputType(
        "pose", POSE, "pose_twist", 56, pose=0, pose_fields=("pose.position", "pose.orientation")
    ),
    InputType(
        "twist", TWIST, "pose_twist", 48, twist=0, pair_fields=("twist.linear", "twist.angular")
    ),
    InputType(
        "odom", ODOMETRY, "odometry", 56 + _COVARIANCE + 48 + _COVARIANCE,
        pose=0, twist=56 + _COVARIANCE, has_child_frame=True,
        pose_fields=("pose.pose.position", "pose.pose.orientation"),
        pair_fields=("twist.twist.linear", "twist.twist.angular"),
    ),
    InputType("load", WRENCH, "", 48, load=0, pair_fields=("wrench.force", "wrench.torque")),
)  # fmt: skip
"""All input types; of one mode, those with a pose first."""

LOAD: Final = next(kind for kind in INPUTS if not kind.carries_motion)
"""The input type of external loads."""

MODES: Final = tuple(dict.fromkeys(kind.mode for kind in INPUTS if kind.mode))
"""Values of the parameter ``input``."""


class Stream(NamedTuple):
    """The messages of one input type about one body."""

    body: int  # 0: A, 1: B
    kind: InputType

    @property
    def name(self) -> str:
        """Relative name of the topic."""
        return f"{BODIES[self.body]}/{self.kind.topic}"


STREAMS: Final = tuple(
    Stream(body, kind) for kind in INPUTS if kind.carries_motion for body in range(len(BODIES))
)
"""The streams of motion: every pose or twist of a sample arrives on one of them."""

STREAM_NUMBER: Final = {stream.name: number for number, stream in enumerate(STREAMS)}
"""Numbers of the streams by relative name of the topic."""


def selected(mode: str) -> tuple[InputType, ...]:
    """Input types that are read with a value of the parameter ``input``: motion, then loads."""
    return tuple(kind for kind in INPUTS if kind.mode in (mode, ""))


def carrier(mode: str, quantity: str) -> InputType:
    """The input type that carries ``pose`` or ``twist`` with a value of the parameter ``input``."""
    return next(k for k in selected(mode) if k.carries_motion and getattr(k, quantity) != ABSENT)
