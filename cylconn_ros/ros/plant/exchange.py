"""Messages of the plant: encode samples, decode wrenches, match stamps."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from cylconn_ros.connector.frames import into_world
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.cdr_encoder import InputWriter, StampedWriter
from cylconn_ros.scene.inputs import BODIES, WRENCH, selected
from cylconn_ros.scene.scene import Scene

_STATES = (slice(0, 13), slice(13, 26))  # pose and twist of A, of B


@dataclasses.dataclass
class PlantCounts:
    """Counters of samples and wrenches."""

    retransmitted: int = 0  # samples sent again because no wrench arrived, except the first one
    without_wrench: int = 0  # free-running steps without the wrenches of their sample
    repeated: int = 0  # wrenches received before
    ignored: int = 0  # wrenches with a stamp other than the sample's
    undecodable: int = 0


class Exchange:
    """Encode samples and receive the wrenches for them.

    In lock step a wrench is accepted only with the sample's own stamp. Free running, any newer
    wrench replaces the one in force.

    Attributes
    ----------
    moving
        Indices of the moving bodies: their motion is sent, their wrenches are expected.
    outputs
        Message type of each relative topic that is published; loads only if they are not zero.
    wrenches
        (6,) force and torque on A and on B, N and N m, as received; zero before the first.
    """

    def __init__(self, scene: Scene, counts: PlantCounts, varying: Sequence[int] = ()) -> None:
        """``varying``: bodies whose load changes, sent with every sample."""
        self._counts = counts
        self._lock_step = scene.plant.lock_step
        self.moving = [i for i, body in enumerate(scene.bodies) if body.kind != "fixed"]
        self.wrenches = (np.zeros(6), np.zeros(6))
        self.outputs: dict[str, str] = {}
        motion = [kind for kind in selected(scene.input) if kind.carries_motion]
        self._writers = [
            [(kind, InputWriter(kind, scene.world_frame, body.frame)) for kind in motion]
            for body in scene.bodies
        ]
        self._load_writer = StampedWriter(scene.world_frame)
        loads = [body.load for body in (scene.plant.body_a, scene.plant.body_b)]
        self.loads_vary = bool(varying)
        self._loaded = [i for i in self.moving if any(loads[i]) or i in varying]
        for i in self.moving:
            if i in self._loaded:
                self.outputs[f"{BODIES[i]}/load"] = WRENCH
            for kind, _ in self._writers[i]:
                self.outputs[f"{BODIES[i]}/{kind.topic}"] = kind.type
        self._newest: list[int | None] = [None, None]
        self._received: set[int] = set()

    @property
    def complete(self) -> bool:
        """True if all wrenches of the last sample have arrived."""
        return len(self._received) == len(self.moving)

    @property
    def missing(self) -> list[str]:
        """Relative topics whose wrench for the last sample has not arrived."""
        return [f"{BODIES[i]}/wrench" for i in self.moving if i not in self._received]

    def begin_sample(self) -> None:
        """Expect the wrenches of a new sample."""
        self._received.clear()

    def receive(self, body: int, data: bytes, stamp: int) -> int | None:
        """Decode a wrench on body A (0) or B (1); ``stamp`` (ns): of the last sample.

        Returns the wrench's own stamp (ns), or None if it is not used.
        """
        try:
            wrench_stamp, _, values = cdr_decoder.read_wrench(data)
        except cdr_decoder.CdrError:
            self._counts.undecodable += 1
            return None
        newest = self._newest[body]
        if wrench_stamp == newest:
            self._counts.repeated += 1
        elif wrench_stamp != stamp and (
            self._lock_step or (newest is not None and wrench_stamp < newest)
        ):
            self._counts.ignored += 1
        else:
            self._newest[body] = wrench_stamp
            self.wrenches[body][:] = values
            if wrench_stamp == stamp:
                self._received.add(body)
            return wrench_stamp
        return None

    def loads(self, stamp: int, loads: np.ndarray) -> Iterator[tuple[str, bytes]]:
        """Relative topic and message of each load of (12,) ``loads``, stamp in ns.

        A connector holds the load.
        """
        for i in self._loaded:
            yield f"{BODIES[i]}/load", self._load_writer.write(stamp, loads[6 * i : 6 * i + 6])

    def messages(self, stamp: int, state: np.ndarray) -> Iterator[tuple[str, bytes]]:
        """Relative topic and message of each part of a sample: (26,) ``state``, stamp in ns."""
        for i in self.moving:
            pose, twist = np.split(state[_STATES[i]], [7])
            for kind, writer in self._writers[i]:
                pair = twist
                if kind.has_child_frame:  # the twist is in body axes
                    inverse = [*pose[:3], *-pose[3:6], pose[6]]
                    pair = np.array(into_world(inverse, twist.tolist()))
                yield f"{BODIES[i]}/{kind.topic}", writer.write(stamp, pose, pair)
