"""The output messages of a connector, and the arrays of a pipeline that compiled code works on."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.messages.cdr_encoder import JointStateWriter, StampedWriter, StateWriter
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.messages.prefix_decoder import PrefixDecoder
from cylconn_ros.messages.templates import MessageTemplates
from cylconn_ros.scene.scene import Scene

STATE, JOINTS = 2, 3
"""Numbers of these messages; the wrenches are 0 and 1."""

_JOINTS = (
    layout.LENGTH, layout.ANGLE, layout.VELOCITY, layout.ANGULAR_VELOCITY, layout.FORCE,
    layout.MOMENT,
)  # fmt: skip
VALID_SAMPLE = np.zeros(layout.NSAMPLE)
"""A sample that every connector can process; used to compile before the first real one."""
VALID_SAMPLE[[layout.A_POSE + 6, layout.B_POSE + 6]] = 1.0


class OutputMessages:
    """The output messages of a connector: wrenches on A and B, state, joint state.

    Attributes
    ----------
        templates: the messages of the last sample, in memory for compiled code.
    """

    def __init__(self, scene: Scene, method: str) -> None:
        """``method``: the connector's, a field of the state."""
        world_axes = scene.wrench.axes == "world"
        frames = [scene.world_frame if world_axes else body.frame for body in scene.bodies]
        self._wrenches = [StampedWriter(frame) for frame in frames]
        self._state = StateWriter(scene.body_a.frame, method)
        self._joints = JointStateWriter(scene.body_a.frame, joint_command.names(scene))
        self.templates = MessageTemplates(
            [
                *(writer.write(0, np.zeros(6)) for writer in self._wrenches),
                self._state.write(0, np.zeros(layout.NOUT)),
                self._joints.write(0, *np.zeros((3, len(joint_command.COMPONENTS)))),
            ],
            [
                *(writer.blocks for writer in self._wrenches),
                self._state.blocks,
                self._joints.blocks,
            ],
        )

    @property
    def timing(self) -> slice:
        """The bytes of the computing time in a state message."""
        return self._state.timing

    def zero(self, stamp: int) -> tuple[bytes, bytes]:
        """Zero wrenches on A and B with a stamp in ns."""
        zero = np.zeros(6)
        return self._wrenches[0].write(stamp, zero), self._wrenches[1].write(stamp, zero)

    def rows(
        self, number: int, stamps: NDArray[np.int64], outs: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """(n, bytes): messages of an output for (n,) stamps in ns and (n, NOUT) outputs."""
        if number == STATE:
            return self._state.rows(stamps, outs)
        if number == JOINTS:
            return self._joints.rows(stamps, outs[:, _JOINTS].reshape(len(outs), 3, 2))
        at = (layout.FORCE_A, layout.FORCE_B)[number]
        return self._wrenches[number].rows(stamps, outs[:, at : at + 6])


class PipelineParts(NamedTuple):
    """The parts of a pipeline that compiled code works on (ros/executor/fused.py)."""

    decoder: PrefixDecoder
    connector: tuple[Any, np.ndarray, np.ndarray, float]  # Connector.kernel_arguments()
    out: np.ndarray  # (NOUT,)
    counters: np.ndarray  # (NCOUNTER,)
    templates: MessageTemplates
