"""A recorded run of friction in process, for cylconn report, info and identify."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import cylconn_ros
from cylconn_ros.connector.outputs import StepResult
from cylconn_ros.core import layout
from cylconn_ros.messages.cdr_encoder import JointStateWriter, StampedWriter, StateWriter
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.mujoco import joint_equations as equations
from cylconn_ros.mujoco.joint_of_model import Joint
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

_TYPES = {
    "/connector/state": "cylconn_ros/msg/ConnectorState",
    "/connector/joint_state": "sensor_msgs/msg/JointState",
    "/body_a/pose": "geometry_msgs/msg/PoseStamped",
    "/body_b/pose": "geometry_msgs/msg/PoseStamped",
}


class Recorded(Protocol):
    """What is recorded: friction of a joint, see :class:`~cylconn_ros.mujoco.Friction`."""

    scene: Scene
    joint: Joint

    @property
    def time(self) -> float:
        """Time of the state from which the last step began, s."""

    @property
    def result(self) -> StepResult:
        """Outputs of the last step."""


class Recorder:
    """Writes state, joint state and poses of both bodies, one sample a call; a context manager.

    The run has the topics of the node. It cannot be replayed: the mechanism is not in it.

    Raises RecordingError as RunWriter does.
    """

    def __init__(self, friction: Recorded, directory: str | Path, model: Any, data: Any) -> None:
        self._friction, self._data = friction, data
        self._bodies = [int(friction.joint.index[k]) for k in (equations.BODY_A, equations.BODY_B)]
        names = [model.body(body).name or f"body_{body}" for body in self._bodies]
        scene = _recorded_scene(friction, names)
        metadata = {
            "version": cylconn_ros.__version__,
            "method": "impulse",
            "model": "inside a MuJoCo model: reactions from its mass matrix and Jacobians",
            "parameters": parameter_file.dump(scene),
        }
        self._state = StateWriter(names[0], "impulse")
        self._joint = JointStateWriter(names[0], joint_command.names(scene))
        self._pose = StampedWriter(scene.world_frame, 7)
        topics = [TopicInfo(name, kind) for name, kind in _TYPES.items()]
        self._writer = RunWriter(Path(directory), topics, metadata, scene.record.compression)

    def write(self) -> None:
        """Record the sample of the last apply or step."""
        data, out = self._data, self._friction.result.array
        stamp = round(self._friction.time * 1e9)
        self._put("/connector/state", self._state.write(stamp, out), stamp)
        pairs = [
            (float(out[one]), float(out[two]))
            for one, two in (
                (layout.LENGTH, layout.ANGLE),
                (layout.VELOCITY, layout.ANGULAR_VELOCITY),
                (layout.FORCE, layout.MOMENT),
            )
        ]
        self._put("/connector/joint_state", self._joint.write(stamp, *pairs), stamp)
        for name, body in zip("ab", self._bodies, strict=True):
            w, x, y, z = data.xquat[body]
            pose = np.array([*data.xpos[body], x, y, z, w])
            self._put(f"/body_{name}/pose", self._pose.write(stamp, pose), stamp)

    def _put(self, topic: str, message: bytes, stamp: int) -> None:
        self._writer.write(topic, message, stamp, stamp)

    def close(self) -> None:
        """Write the rest and close the run."""
        self._writer.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _recorded_scene(friction: Recorded, names: list[str]) -> Scene:
    """The scene with the geometry of the joint in the model."""
    g = friction.joint.geometry
    axes = g[equations.AXES :].reshape(3, 3).T
    return friction.scene.replace(
        {
            "body_a.kind": "driven",
            "body_a.frame": names[0],
            "body_b.frame": names[1],
            "node_a.position": tuple(g[equations.NODE_A : equations.NODE_A + 3]),
            "node_a.orientation": _quaternion(axes),
            "node_b.position": tuple(g[equations.NODE_B : equations.NODE_B + 3]),
        }
    )


def _quaternion(m: Array) -> tuple[float, ...]:
    """The quaternion x y z w of a rotation matrix: the eigenvector of its symmetric 4x4 form."""
    k = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)],
        ]
    )
    return tuple(float(value) for value in np.linalg.eigh(k)[1][:, -1])
