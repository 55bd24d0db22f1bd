"""What the messages of a topic have in common: all but their stamps and numbers.

Whoever knows it need not decode them: a message of the same form is numbers at known places.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector import synchronizer
from cylconn_ros.core.jit import device_function
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.scene.scene import Scene

BODIES: Final = ("body_a", "body_b")
STREAMS: Final = 6  # poses and twists of both bodies as in matching.STREAMS, then both odometries
ODOMETRIES: Final = 4  # the first of these
STREAM_OF = {
    name: k for k, name in enumerate((*synchronizer.STREAMS, *(f"{body}/odom" for body in BODIES)))
}
"""Streams by the relative name of their topic."""

MOST_WORDS: Final = 64  # of eight bytes, between stamp and numbers
_POSE, _TWIST, _ODOMETRY = range(3)
_KINDS = (_POSE, _TWIST, _POSE, _TWIST, _ODOMETRY, _ODOMETRY)


@device_function
def body_of(stream: int) -> int:
    """Whether a stream is of body A (0) or B (1)."""
    return stream >> 1 if stream < ODOMETRIES else stream - ODOMETRIES


class Form(NamedTuple):
    """What the messages of a stream have in common.

    numbers: (4,) where the numbers begin, bytes of a message, where an odometry's twist begins,
    words between stamp and numbers. words: those (64,). turned: whether the twist is in body axes.
    foreign: frames of a message that name no frame of the scene.
    """

    numbers: NDArray[np.int64]
    words: NDArray[np.uint64]
    turned: bool
    foreign: int


class Frames(NamedTuple):
    """Names by which a message's axes are known."""

    world: str
    body: str
    twist_in_world: bool  # where a twist's frame says neither


class Forms:
    """Tell the forms of messages that are meant for a scene."""

    def __init__(self, scene: Scene) -> None:
        by_default = scene.twist_axes == "world"
        self._frames = [Frames(scene.world_frame, body.frame, by_default) for body in scene.bodies]

    def of(self, stream: int, data: bytes) -> Form | None:
        """The form of a message, or None where others like it have to go the ordinary way."""
        return _form(_KINDS[stream], data, self._frames[body_of(stream)])


def _form(kind: int, data: bytes, frames: Frames) -> Form | None:
    try:
        if kind == _ODOMETRY:
            _, frame, child, _, _ = cdr_decoder.read_odometry(data)
            turned, foreign = child != frames.world, int(frame not in ("", frames.world))
            foreign += child not in (frames.world, frames.body, "")
            size = 8 * (7 + 36 + 6 + 36)
        elif kind == _POSE:
            frame = cdr_decoder.read_pose(data).frame
            turned, foreign, size = False, int(frame not in ("", frames.world)), 8 * 7
        else:
            frame = cdr_decoder.read_twist(data).frame
            known = frame in (frames.world, frames.body)
            turned = frame == frames.body if known else not frames.twist_in_world
            turned = turned and frame != frames.world
            foreign, size = int(bool(frame) and not known), 8 * 6
    except cdr_decoder.CdrError:
        return None
    at = len(data) - size
    count = (at - 12) // 8
    if data[:4] != b"\x00\x01\x00\x00" or (at - 4) % 8 or not 0 <= count <= MOST_WORDS:
        return None
    words = np.zeros(MOST_WORDS, np.uint64)
    words[:count] = np.frombuffer(data, "<u8", count, 12)
    numbers = np.array([at, len(data), at + 8 * (7 + 36), count], np.int64)
    return Form(numbers, words, turned, foreign)
