"""Encode what changes over time in a scene as the messages that command it."""

from __future__ import annotations

from collections.abc import Iterator

from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.messages.cdr_encoder import JointStateWriter, float64_bytes
from cylconn_ros.messages.commands.commands import COMMAND, FLOAT64, JOINT_STATE, PRELOAD
from cylconn_ros.messages.commands.joint_command import COMPONENTS, names
from cylconn_ros.scene import over_time
from cylconn_ros.scene.scene import Scene


class CommandWriter:
    """Messages for the connector of a scene; none for what does not change over time.

    Attributes
    ----------
        topics: message type of each relative topic on which it writes.
    """

    def __init__(self, scene: Scene) -> None:
        factors = dict(zip(COMPONENTS, over_time.commands(scene), strict=True))
        self._components = [name for name, factor in factors.items() if factor.on]
        known = dict(zip(COMPONENTS, names(scene), strict=True))
        self._joints = JointStateWriter("", [known[name] for name in self._components])
        self._over_time = OverTime(scene)
        self.topics: dict[str, str] = {}
        if self._components:
            self.topics[COMMAND] = JOINT_STATE
        if scene.plant.preload_amplitude.on:
            self.topics[PRELOAD] = FLOAT64

    def write(self, stamp: int, k: int) -> Iterator[tuple[str, bytes]]:
        """Relative topic and message of each command for sample k, with its stamp (ns)."""
        if self._components:
            commands = self._over_time.commands(k)
            rows = [commands[name] for name in self._components]
            yield COMMAND, self._joints.write(stamp, *zip(*rows, strict=True))
        preload = self._over_time.preload(k)
        if preload is not None:
            yield PRELOAD, float64_bytes(preload)
