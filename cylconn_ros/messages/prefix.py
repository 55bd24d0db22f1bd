"""Constant prefix of a topic's messages: the bytes between stamp and numbers.

The messages of one publisher differ only in their stamp and numbers. With the prefix of one message
known, the numbers of the next are at fixed offsets and need no decoding.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.frames import frame_name
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.scene.inputs import ABSENT, STREAMS
from cylconn_ros.scene.scene import Scene

MAX_WORDS: Final = 64
"""Greatest length of a prefix, in words of eight bytes."""
FIRST_WORD: Final = 12
"""Offset of a prefix in the message: after encapsulation header and stamp."""

# Columns of a PrefixTable, one row a stream. Offsets are in bytes from the begin of a message.
SIZE: Final = 0  # bytes of a message; -1: no prefix known
WORDS: Final = 1  # words of eight bytes in the prefix
POSE: Final = 2  # offset of the pose, or ABSENT
TWIST: Final = 3  # offset of the twist, or ABSENT
IN_BODY_AXES: Final = 4  # 1: the twist is in body axes
UNKNOWN_FRAMES: Final = 5  # frames of a message that are no frame of the scene
BODY: Final = 6  # 0: A, 1: B
QUANTITIES: Final = 7  # bits of the quantities, as in connector/synchronizer.py
NCOLUMN: Final = 8


class MessagePrefix(NamedTuple):
    """The common properties of all messages with one prefix."""

    size: int  # bytes of a message
    words: NDArray[np.uint64]  # (k,) the prefix
    numbers: int  # offset of the block of numbers
    in_body_axes: bool  # the twist is in body axes
    unknown_frames: int  # frames that are no frame of the scene


class _Frames(NamedTuple):
    """Names of the frames in which a body's quantities may be given."""

    world: str
    body: str
    twist_in_world: bool  # a twist with any other frame is in world axes


class PrefixTable:
    """The known prefix of every stream, as arrays for compiled code.

    Attributes
    ----------
        columns: (NSTREAM NCOLUMN,) int64, a row a stream.
        words: (NSTREAM MAX_WORDS,) uint64, the prefixes.
    """

    def __init__(self, scene: Scene) -> None:
        """Begin without a prefix; ``scene`` states the names of the frames."""
        by_default = scene.twist_axes == "world"
        self._frames = [
            _Frames(frame_name(scene.world_frame), frame_name(body.frame), by_default)
            for body in scene.bodies
        ]
        self.columns = np.full(len(STREAMS) * NCOLUMN, -1, np.int64)
        self.words = np.zeros(len(STREAMS) * MAX_WORDS, np.uint64)
        for number, (body, kind) in enumerate(STREAMS):
            bits = (kind.pose != ABSENT) | (kind.twist != ABSENT) << 1
            self.columns[number * NCOLUMN + BODY] = body
            self.columns[number * NCOLUMN + QUANTITIES] = bits << 2 * body

    def prefix_of(self, stream: int, data: bytes) -> MessagePrefix | None:
        """The prefix of a message; None if its numbers cannot be read at fixed offsets.

        That is so for a message that cannot be decoded, has another byte order or padding at its
        end, or has a prefix of more than MAX_WORDS.
        """
        body, kind = STREAMS[stream]
        world, own, twist_in_world = self._frames[body]
        try:
            message = cdr_decoder.read_input(kind, data)
        except cdr_decoder.CdrError:
            return None
        frame = frame_name(message.frame)
        child = None if message.child_frame is None else frame_name(message.child_frame)
        unknown, turned = 0, False
        if kind.pose != ABSENT:
            unknown += frame not in ("", world)
        if kind.twist != ABSENT and child is not None:
            turned = child != world
            unknown += child not in (world, own, "")
        elif kind.twist != ABSENT:
            known = frame in (world, own)
            turned = frame != world if known else not twist_in_world
            unknown += bool(frame) and not known
        at = len(data) - kind.size
        count = (at - FIRST_WORD) // 8
        if data[:4] != b"\x00\x01\x00\x00" or (at - 4) % 8 or not 0 <= count <= MAX_WORDS:
            return None
        words = np.frombuffer(data, "<u8", count, FIRST_WORD)
        return MessagePrefix(len(data), words, at, turned, unknown)

    def learn(self, stream: int, data: bytes) -> None:
        """Make the prefix of a message the known prefix of its stream."""
        prefix = self.prefix_of(stream, data)
        row = self.columns[stream * NCOLUMN : (stream + 1) * NCOLUMN]
        row[SIZE] = -1
        if prefix is None:
            return
        kind = STREAMS[stream].kind
        begin = stream * MAX_WORDS
        self.words[begin : begin + len(prefix.words)] = prefix.words
        row[WORDS], row[SIZE] = len(prefix.words), prefix.size
        row[POSE] = prefix.numbers + kind.pose if kind.pose != ABSENT else ABSENT
        row[TWIST] = prefix.numbers + kind.twist if kind.twist != ABSENT else ABSENT
        row[IN_BODY_AXES], row[UNKNOWN_FRAMES] = prefix.in_body_axes, prefix.unknown_frames

    def size(self, stream: int) -> int:
        """Bytes of a message with the known prefix of a stream; -1 if no prefix is known."""
        return int(self.columns[stream * NCOLUMN + SIZE])
