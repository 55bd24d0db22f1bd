"""What ``~/command`` asks for: imposed motion or force on slide and spin.

A sensor_msgs/JointState is read as controllers write one: position and velocity are an imposed
motion, effort an imposed force, an empty array or NaN is a quantity not given. A component that is
named is set anew by the message, one that is not named stays as it was; so a component named with
nothing given is free again. Header and stamp mean nothing: a command acts from the next sample
that is answered on, and holds until the next command.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cylconn_ros.messages.cdr_decoder import JointState
from cylconn_ros.scene.groups import Command, Imposed

COMPONENTS = ("slide", "spin")


class CommandError(ValueError):
    """A command that cannot be followed; nothing of it is."""


class Imposition(NamedTuple):
    """What is imposed on one component; NaN is what is not."""

    position: float  # m or rad
    velocity: float  # m/s or rad/s
    force: float  # N or N.m

    @classmethod
    def of(cls, imposed: Imposed) -> Imposition:
        """What a scene's parameters impose."""
        return cls(imposed.position, imposed.velocity, imposed.force)

    def parameters(self) -> Imposed:
        """The same as parameters of a scene."""
        return Imposed(**self._asdict())

    def __str__(self) -> str:
        given = (f"{name} {x:g}" for name, x in self._asdict().items() if not math.isnan(x))
        return ", ".join(given) or "free"


def in_scene(command: Command) -> dict[str, Imposition]:
    """What a scene's parameters impose, by component."""
    return {name: Imposition.of(getattr(command, name)) for name in COMPONENTS}


def as_parameters(impositions: dict[str, Imposition]) -> Command:
    """What is imposed, as parameters of a scene."""
    return Command(**{name: imposed.parameters() for name, imposed in impositions.items()})


def read(message: JointState) -> dict[str, Imposition]:
    """What a message imposes, by component it names.

    Raises CommandError, naming component, value and rule, for no or unknown or repeated names, an
    array that is neither empty nor as long as the names, a number that is infinite, and a motion
    with a force.
    """
    names = message.names
    if not names:
        raise CommandError("name = []: must name slide, spin or both")
    for name in names:
        if name not in COMPONENTS:
            raise CommandError(f"name = {name!r}: must be slide or spin")
        if names.count(name) > 1:
            raise CommandError(f"name = {name!r}: must not be given twice")
    columns = []
    arrays = (message.positions, message.velocities, message.efforts)
    for field, array in zip(("position", "velocity", "effort"), arrays, strict=True):
        if array and len(array) != len(names):
            raise CommandError(
                f"{field}: {len(array)} numbers for {len(names)} names; must be as many, or none"
            )
        for name, value in zip(names, array, strict=False):
            if math.isinf(value):
                raise CommandError(f"{field} of {name} = {value}: must be finite, or NaN for none")
        columns.append(array or (math.nan,) * len(names))
    impositions = {}
    for name, position, velocity, force in zip(names, *columns, strict=True):
        if not (math.isnan(force) or (math.isnan(position) and math.isnan(velocity))):
            raise CommandError(f"effort of {name} = {force:g}: must not be given with a motion")
        impositions[name] = Imposition(position, velocity, force)
    return impositions
