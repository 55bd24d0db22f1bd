"""The plant's side of the exchange with a connector: samples to bytes, wrenches from bytes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from cylconn_ros.connector.frames import into_world
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.cdr_encoder import OdometryWriter, StampedWriter
from cylconn_ros.messages.pipeline import BODIES, ODOMETRY, POSE, TWIST, WRENCH
from cylconn_ros.scene.scene import Scene

_STATES = (slice(0, 13), slice(13, 26))  # pose and twist of A, of B


@dataclasses.dataclass
class PlantCounts:
    """What became of samples and wrenches."""

    sent_again: int = 0  # samples sent again because no answer came
    unanswered: int = 0  # steps of a free run taken without the wrenches of their sample
    repeated: int = 0  # wrenches that had already come
    ignored: int = 0  # wrenches with another stamp than the sample's
    undecodable: int = 0


class Exchange:
    """Send samples and take the wrenches that answer them.

    In lock step a wrench counts only with the sample's own stamp. Free running, any newer wrench
    replaces the one in force.

    Attributes
    ----------
    moving
        Indices of the bodies that move: their motion is sent, their wrenches are waited for.
    outputs
        Type of each relative topic that is sent, loads only where there are any.
    wrenches
        (6,) force and torque on A and on B, as received; zero until the first.
    """

    def __init__(self, scene: Scene, counts: PlantCounts) -> None:
        self._counts = counts
        self._lock_step = scene.plant.lock_step
        self.moving = [i for i, body in enumerate(scene.bodies) if body.kind != "fixed"]
        self.wrenches = (np.zeros(6), np.zeros(6))
        self.outputs: dict[str, str] = {}
        self._odometry = scene.input == "odometry"
        self._odometry_writers = [OdometryWriter(scene.world_frame, b.frame) for b in scene.bodies]
        self._pose_writer = StampedWriter(scene.world_frame, 7)
        self._pair_writer = StampedWriter(scene.world_frame)
        loads = [np.array(body.load) for body in (scene.plant.body_a, scene.plant.body_b)]
        self._loads = {i: loads[i] for i in self.moving if loads[i].any()}
        for i in self.moving:
            if i in self._loads:
                self.outputs[f"{BODIES[i]}/load"] = WRENCH
            if self._odometry:
                self.outputs[f"{BODIES[i]}/odom"] = ODOMETRY
            else:
                self.outputs[f"{BODIES[i]}/pose"] = POSE
                self.outputs[f"{BODIES[i]}/twist"] = TWIST
        self._newest: list[int | None] = [None, None]
        self._answered: set[int] = set()

    @property
    def complete(self) -> bool:
        """Whether the wrenches of the sample last sent are all there."""
        return len(self._answered) == len(self.moving)

    @property
    def silent(self) -> list[str]:
        """Relative topics whose wrench for the sample last sent has not come."""
        return [f"{BODIES[i]}/wrench" for i in self.moving if i not in self._answered]

    def expect(self) -> None:
        """Begin to wait for the wrenches of a new sample."""
        self._answered.clear()

    def take(self, body: int, data: bytes, stamp: int) -> None:
        """Take a wrench on body A (0) or B (1) while the sample at ``stamp`` (ns) is out."""
        try:
            came, _, values = cdr_decoder.read_wrench(data)
        except cdr_decoder.CdrError:
            self._counts.undecodable += 1
            return
        newest = self._newest[body]
        if came == newest:
            self._counts.repeated += 1
        elif came != stamp and (self._lock_step or (newest is not None and came < newest)):
            self._counts.ignored += 1
        else:
            self._newest[body] = came
            self.wrenches[body][:] = values
            if came == stamp:
                self._answered.add(body)

    def loads(self, stamp: int) -> Iterator[tuple[str, bytes]]:
        """Relative topic and bytes of each load, stamp in ns; a connector holds it from then on."""
        for i, load in self._loads.items():
            yield f"{BODIES[i]}/load", self._pair_writer.write(stamp, load)

    def messages(self, stamp: int, state: np.ndarray) -> Iterator[tuple[str, bytes]]:
        """Relative topic and bytes of each message of a sample: (26,) ``state``, stamp in ns."""
        for i in self.moving:
            pose, twist = np.split(state[_STATES[i]], [7])
            if self._odometry:
                back = [*pose[:3], *-pose[3:6], pose[6]]
                turned = np.array(into_world(back, twist.tolist()))
                yield f"{BODIES[i]}/odom", self._odometry_writers[i].write(stamp, pose, turned)
            else:
                yield f"{BODIES[i]}/pose", self._pose_writer.write(stamp, pose)
                yield f"{BODIES[i]}/twist", self._pair_writer.write(stamp, twist)
