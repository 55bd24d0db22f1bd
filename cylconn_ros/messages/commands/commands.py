"""What topics command a connector: motion or force of slide and spin, and the preload.

A command acts from the next processed sample on, until the next command or the end of the node's
active state. One that cannot be carried out is refused and counted, and changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cylconn_ros.connector.connector import Connector
from cylconn_ros.errors import CylconnError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.messages.commands.joint_command import Imposition
from cylconn_ros.messages.health import Health
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

JOINT_STATE, FLOAT64 = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
COMMAND, PRELOAD = "~/command", "~/preload"


class RefusedCommandError(CylconnError, ValueError):
    """A command cannot be carried out."""


class Commands:
    """The commands in force of a connector.

    Attributes
    ----------
    imposed
        Motion or force imposed on slide and spin, by the scene or by the last command.
    preload
        FCint in force, N: of the scene or of the last message.
    health
        The counters of commands followed and refused.
    """

    def __init__(self, scene: Scene, connector: Connector, health: Health) -> None:
        self.scene, self.connector, self.health = scene, connector, health
        self.imposed = joint_command.in_scene(scene.command)
        self.preload = scene.friction.preload
        self.inputs: Mapping[str, tuple[str, Callable[[bytes], None]]] = {
            COMMAND: (JOINT_STATE, self._joints),
            PRELOAD: (FLOAT64, self._preload),
        }
        """Type and handler of each topic."""

    def keep(self, previous: Commands) -> dict[str, Imposition]:
        """Keep what ``previous`` commands where the parameters of it are unchanged.

        Returns the impositions kept; raises ValueError if the method cannot carry them out.
        """
        kept = {
            name: imposed
            for name, imposed in previous.imposed.items()
            if _same(previous.scene, self.scene, f"command.{name}.")
        }
        self._impose(kept)
        if _same(previous.scene, self.scene, "friction.preload") and self.scene.friction.on:
            self._press(previous.preload)
        return kept

    def impose_scene(self, kept: Mapping[str, Imposition]) -> None:
        """Impose what the scene states for the components that are not in ``kept``."""
        self._impose({name: new for name, new in self.imposed.items() if name not in kept})

    def release(self) -> None:
        """End all commands: impose only what the scene's parameters state."""
        self._impose(joint_command.in_scene(self.scene.command))
        self._press(self.scene.friction.preload)

    @property
    def scene_in_force(self) -> Scene:
        """The scene, with the commands in force in place of its parameters."""
        scene = joint_command.as_parameters(self.imposed, self.scene)
        return scene.replace({"friction.preload": self.preload})

    def _joints(self, data: bytes) -> None:
        check = self.connector.check_imposed
        self._follow(lambda: self._impose(joint_command.read_message(data, self.scene, check)))

    def _preload(self, data: bytes) -> None:
        preload = cdr_decoder.read_float64(data)
        self._follow(lambda: self._press(preload))

    def _follow(self, carry_out: Callable[[], None]) -> None:
        try:
            if self.scene.access.frozen:
                raise RefusedCommandError("access.frozen = true: commands are not followed")
            carry_out()
            self.health.commands += 1
        except cdr_decoder.CdrError:
            raise
        except ValueError as error:
            self.health.refused += 1
            self.health.refusal = str(error)

    def _impose(self, imposed: Mapping[str, Imposition]) -> None:
        for name, imposition in imposed.items():
            self.connector.impose(name, *imposition)
            self.imposed[name] = imposition

    def _press(self, preload: float) -> None:
        if preload != self.preload:
            self.connector.set_preload(preload)
            self.preload = preload


def _same(before: Scene, after: Scene, beginning: str) -> bool:
    """Whether the parameters whose names begin with ``beginning`` have not changed."""
    old, new = before.parameters(), after.parameters()
    return all(show(old[name]) == show(new[name]) for name in old if name.startswith(beginning))
