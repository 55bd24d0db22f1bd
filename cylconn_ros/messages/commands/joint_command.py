"""Commands on ``~/command`` (JointState): imposed motion or force on slide and spin.

A sensor_msgs/JointState has the meaning that controllers give it: position and velocity are an
imposed motion, effort alone an imposed force, effort with a motion the greatest force that it may
take, in place of the parameter max_force; an empty array or NaN is a quantity not given. A message
sets the components that it names and leaves the others as they are; a component named without any
quantity is free again. Header and stamp are not used: a command acts from the next processed sample
until the next command.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from cylconn_ros.errors import CylconnError, SceneError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.cdr_decoder import JointState
from cylconn_ros.scene.behaviour import Command, Imposed
from cylconn_ros.scene.fields import SceneFields
from cylconn_ros.scene.scene import Scene

COMPONENTS = ("slide", "spin")


class JointCommandError(CylconnError, ValueError):
    """A command is invalid; no part of it takes effect."""


class Imposition(NamedTuple):
    """Imposed motion or force of one component; NaN for a quantity that is not imposed."""

    position: float  # m or rad
    velocity: float  # m/s or rad/s
    force: float  # N or N.m
    max_force: float = math.nan  # N or N.m, of a motion; NaN: that of the parameters

    @classmethod
    def of(cls, imposed: Imposed) -> Imposition:
        """From the parameters of a scene."""
        return cls(imposed.position, imposed.velocity, imposed.force)

    def parameters(self, scene: Imposed) -> Imposed:
        """As parameters of a scene, with the others of ``scene``."""
        most = scene.max_force if math.isnan(self.max_force) else self.max_force
        return dataclasses.replace(scene, **{**self._asdict(), "max_force": most})

    def __str__(self) -> str:
        given = (
            f"{'at most' if name == 'max_force' else name} {x:g}"
            for name, x in self._asdict().items()
            if not math.isnan(x)
        )
        return ", ".join(given) or "free"


def in_scene(command: Command) -> dict[str, Imposition]:
    """Impositions by component, from the parameters of a scene."""
    return {name: Imposition.of(getattr(command, name)) for name in COMPONENTS}


def as_parameters(impositions: dict[str, Imposition], scene: Scene) -> Scene:
    """The scene with the impositions by component in place of its parameters ``command``."""
    given = scene.command
    command = Command(
        **{name: imposed.parameters(getattr(given, name)) for name, imposed in impositions.items()}
    )
    return dataclasses.replace(scene, command=command)


def names(scene: SceneFields) -> tuple[str, str]:
    """Names of slide and spin in messages (``joint_names``)."""
    return scene.joint_names.slide, scene.joint_names.spin


def _anything(*_: object) -> None:
    """Accept every imposition."""


def read_message(
    data: bytes, scene: SceneFields, check: Callable[..., None] = _anything
) -> dict[str, Imposition]:
    """Impositions by component that a serialized message names; ``check`` and errors of read."""
    return read(cdr_decoder.read_joint_state(data), names(scene), check)


def read(
    message: JointState,
    known: Sequence[str] = COMPONENTS,
    check: Callable[..., None] = _anything,
) -> dict[str, Imposition]:
    """Impositions by component that a message names.

    known: names of slide and spin in messages. check: raises SceneError for a component and an
    imposition that the connector cannot carry out.

    Raises JointCommandError, which names component, value and rule, if the message names no
    component, an unknown one or one twice; if an array is neither empty nor as long as the names;
    if a number is infinite; if the effort of a motion, its greatest force, is not above 0.
    """
    names = message.names
    slide, spin = known
    if not names:
        raise JointCommandError(f"name = []: must name {slide}, {spin} or both")
    for name in names:
        if name not in known:
            raise JointCommandError(f"name = {name!r}: must be {slide} or {spin}")
        if names.count(name) > 1:
            raise JointCommandError(f"name = {name!r}: must not be given twice")
    columns = []
    arrays = (message.positions, message.velocities, message.efforts)
    for field, array in zip(("position", "velocity", "effort"), arrays, strict=True):
        if array and len(array) != len(names):
            raise JointCommandError(
                f"{field}: {len(array)} numbers for {len(names)} names; must be as many, or none"
            )
        for name, value in zip(names, array, strict=False):
            if math.isinf(value):
                raise JointCommandError(
                    f"{field} of {name} = {value}: must be finite, or NaN for none"
                )
        columns.append(array or (math.nan,) * len(names))
    impositions = {}
    for name, position, velocity, force in zip(names, *columns, strict=True):
        component = COMPONENTS[known.index(name)]
        if math.isnan(position) and math.isnan(velocity):
            impositions[component] = Imposition(position, velocity, force)
            continue
        if force <= 0.0:
            raise JointCommandError(
                f"effort of {name} = {force:g}: must be > 0 with a motion, whose greatest force it "
                "is, or NaN for that of the parameters"
            )
        impositions[component] = Imposition(position, velocity, math.nan, force)
    try:
        for name, imposition in impositions.items():
            check(name, *imposition)
    except SceneError as error:
        raise JointCommandError(str(error)) from error
    return impositions
