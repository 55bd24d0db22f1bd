"""Checks for arbitrary bytes, used by hypothesis (test_fuzz.py) and a fuzzer (scripts/fuzz.py)."""

from __future__ import annotations

import contextlib
import functools
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.errors import SceneError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.cdr_encoder import JointStateWriter, OdometryWriter, StampedWriter
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.messages.pipeline import COMMAND, MessagePipeline
from cylconn_ros.scene.parameter_file import dump, load_parameters, scene_part
from cylconn_ros.scene.scene import Scene, several

MS = 1_000_000
SCENE = {
    "node_a.orientation": [0, 0, 0, 1],
    "body_b.mass": 1.0,
    "body_b.inertia": [0.002, 1e-4, 0.0, 0.003, 0.0, 0.004],
    "body_b.com": [0.01, 0.02, 0.0],
    "friction.coefficient": 0.2,
    "friction.radius": 0.02,
}


def messages(stamp: int) -> dict[str, bytes]:
    """A valid message of every input."""
    pose, six = np.array([0.2, 0, 0, 0, 0, 0, 1.0]), np.arange(6.0) * 0.1
    return {
        "body_b/pose": StampedWriter("world", 7).write(stamp, pose),
        "body_b/twist": StampedWriter("world").write(stamp, six),
        "body_b/load": StampedWriter("body_b").write(stamp, six),
        "body_b/odom": OdometryWriter("world", "body_b").write(stamp, pose, six),
        COMMAND: JointStateWriter("", joint_command.COMPONENTS).write(
            stamp, (0.1, 0), (0, 0), (0, 0)
        ),
    }


READERS: dict[str, Callable[[bytes], Any]] = {
    "body_b/pose": cdr_decoder.read_pose,
    "body_b/twist": cdr_decoder.read_twist,
    "body_b/load": cdr_decoder.read_wrench,
    "body_b/odom": cdr_decoder.read_odometry,
    COMMAND: cdr_decoder.read_joint_state,
}


def damaged(data: bytes, changes: bytes) -> bytes:
    """A message with ``changes``, three bytes each: kind of change, offset, value."""
    found = bytearray(data)
    for kind, offset, value in zip(changes[::3], changes[1::3], changes[2::3], strict=False):
        at = offset % max(len(found), 1)
        if kind % 5 == 0:
            found[at : at + 1] = bytes([value])
        elif kind % 5 == 1:
            del found[at:]
        elif kind % 5 == 2:
            found += bytes(value)
        elif kind % 5 == 3:
            found[at : at + 4] = struct.pack("<I", (value << 24) | value)
        else:
            number = (math.nan, math.inf, -math.inf, 1e308, 5e-324, -1e-300, 0.0)[value % 7]
            found[at : at + 8] = struct.pack("<d", number)
    return bytes(found)


def check_decoders(data: bytes) -> None:
    """Any bytes are decoded or raise CdrError; a decoded pose can be encoded and decoded again."""
    for read in (*READERS.values(), cdr_decoder.read_stamp):
        with contextlib.suppress(cdr_decoder.CdrError):
            read(data)
    if not data:
        return
    kinds = list(READERS)
    kind = kinds[data[0] % len(kinds)]
    near = damaged(messages(7 * MS)[kind], data[1:])
    try:
        found = READERS[kind](near)
    except cdr_decoder.CdrError:
        return
    if kind == "body_b/pose" and near[:4] == b"\x00\x01\x00\x00":  # little endian
        again = StampedWriter(found.frame, 7).write(found.stamp, np.array(found.values))
        if "�" not in found.frame and "\0" not in found.frame:
            assert repr(cdr_decoder.read_pose(again)) == repr(found)


@functools.cache
def _scene() -> Scene:
    return Scene.from_parameters(SCENE)


class PipelineUnderTest:
    """A message pipeline that gets arbitrary messages after a valid sample."""

    def __init__(self) -> None:
        self.pipeline = MessagePipeline(_scene())

    def process(self, data: bytes) -> None:
        """Process messages that ``data`` defines: nothing raises, and every wrench is finite."""
        pipeline, stamp = self.pipeline, 1
        pipeline.reset()
        names = [name for name in messages(0) if name in pipeline.inputs]
        for name in names:
            self._receive(name, messages(0)[name])
        while data:
            head, changes, data = data[0], data[1 : 1 + 3 * (data[0] >> 5)], data[1 + 21 :]
            name = names[head % len(names)]
            stamp += head >> 4 & 1
            self._receive(name, damaged(messages(stamp * MS)[name], changes))
        assert not pipeline.health.failed, pipeline.health.failure

    def _receive(self, name: str, data: bytes) -> None:
        response = self.pipeline.inputs[name].receive(data)
        if response is not None:
            for wrench in (response.wrench_a, response.wrench_b):
                values = cdr_decoder.read_wrench(wrench).values
                assert all(map(math.isfinite, values)), values


def check_parameter_file(text: str, folder: Path) -> None:
    """Any file raises SceneError, or gives scenes that can be written and read again."""
    file = folder / "parameters.yaml"
    file.write_text(text, encoding="utf-8", errors="surrogateescape")
    try:
        scenes = several(scene_part(load_parameters(file, "connector")))
    except SceneError:
        return
    for scene in scenes.values():
        file.write_text(dump(scene), encoding="utf-8")
        assert dump(Scene.from_parameters(load_parameters(file, "connector"))) == dump(scene)


def targets(folder: Path) -> dict[str, Callable[[bytes], None]]:
    """Checks by name; without compiled code, which the fuzzer cannot instrument."""
    return {
        "cdr": check_decoders,
        "scene": lambda data: check_parameter_file(data.decode("utf-8", "surrogateescape"), folder),
    }
