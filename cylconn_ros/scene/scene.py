"""The scene: two bodies, the cylindrical connector between them, and their plant.

:class:`Scene` checks its parameters as a whole at construction: a Scene object is always valid.
SI units, radians, quaternions x, y, z, w.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.errors import SceneError
from cylconn_ros.scene import multiple, parameter_file, shared_bodies, validation
from cylconn_ros.scene.behaviour import Friction
from cylconn_ros.scene.bodies import Body, Node
from cylconn_ros.scene.fields import SceneFields, schema, value_of
from cylconn_ros.scene.resources import shipped
from cylconn_ros.scene.schema import Parameter, field_names, flatten, groups, show

__all__ = [
    "Body",
    "Friction",
    "Node",
    "Scene",
    "SceneError",
    "load",
    "schema",
    "several",
    "shipped",
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene(SceneFields):
    """All parameters of one connector and of its plant, checked.

    Fields: :class:`~cylconn_ros.scene.fields.SceneFields`. A field holds a group object such as
    :class:`Body` or a value. Raises :class:`~cylconn_ros.errors.SceneError` that names the
    parameter, the value and the rule.

    Example::

        import cylconn_ros as cr

        scene = cr.Scene(
            node_a=cr.Node(orientation=(0, 0, 0, 1)),  # its x axis is the slot
            body_b=cr.Body(mass=2.0, inertia=(0.01, 0, 0, 0.02, 0, 0.02)),
            friction=cr.Friction(coefficient=0.2, radius=0.02, overlap=0.1),
        )
        slippery = scene.replace({"friction.coefficient": 0.05})
    """

    def __post_init__(self) -> None:
        _check_groups(self, "")
        values = {}
        for name, rules in schema().items():
            given = value_of(self, name)
            if rules.required and (given is None or np.size(given) == 0):
                raise SceneError(f"{name}: is required and not given; must be {rules.rule}")
            if name in ("body_a.frame", "body_b.frame"):
                given = given or rules.default  # not named in code
            values[name] = () if given is None else rules.check(given)
        for name in field_names(Scene):
            object.__setattr__(self, name, _take(Scene, name, "", values))
        validation.check(self)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> Scene:
        """Make a scene from nested or dotted names; names not given have their defaults.

        Raises :class:`SceneError` for an unknown name (with the nearest one) or an unusable value.
        ``None`` and an empty list mean "not given".
        """
        flat = flatten(parameters)
        table = schema()
        values: dict[str, Any] = {}
        for name, value in flat.items():
            if name not in table:
                raise SceneError(_unknown(name, value, table))
            if value is not None and not (isinstance(value, list | tuple) and not value):
                values[name] = table[name].check(value)
        for name, rules in table.items():
            if rules.required and name not in values:
                raise SceneError(f"{name}: is required and not given; must be {rules.rule}")
            values.setdefault(name, rules.default)
        return cls(**{name: _take(cls, name, "", values) for name in field_names(cls)})

    def replace(self, changes: Mapping[str, Any]) -> Scene:
        """A new scene with some parameters changed, by dotted or nested names.

        Raises SceneError for an unknown name, an unusable value, or parameters that no longer go
        together.

        Example::

            heavier = scene.replace({"body_b.mass": 3.0, "friction.coefficient": 0.3})
        """
        return Scene.from_parameters({**self.parameters(), **flatten(changes)})

    def keeps_history(self, before: Scene) -> bool:
        """Whether the connector's history stays valid if this scene takes the place of ``before``.

        It does not if a parameter differs that is marked ``restarts`` in the schema.
        """
        old, new = before.parameters(), self.parameters()
        return not any(
            rules.restarts and show(old[name], whole=True) != show(new[name], whole=True)
            for name, rules in schema().items()
        )


def several(parameters: Mapping[str, Any]) -> dict[str, Scene]:
    """The scene of each connector by its name; the name is "" if no connectors are listed.

    Raises :class:`SceneError` whose text begins with the connector's name.
    """
    scenes = {}
    for name, given in multiple.split(parameters, schema()).items():
        try:
            scenes[name] = Scene.from_parameters(given)
        except SceneError as error:
            raise SceneError(f"{name}.{error}" if name else str(error)) from None
    shared_bodies.check(scenes)
    return scenes


def load(
    path: str | Path, node: str = "connector", namespace: str = "/", connector: str = multiple.ONE
) -> Scene:
    """Read the scene from a ROS 2 parameter file, as the node ``node`` in ``namespace`` does.

    Blocks with wildcards (``/**``) come first, then the node's own. ``connector`` chooses one of
    several connectors in the file. Raises :class:`SceneError` for a file that cannot be read or
    used; the text begins with the file's name.

    Example::

        scene = cr.load(cr.shipped("demo"))
    """
    parameters = parameter_file.load_parameters(path, node, namespace)
    try:
        return chosen(several(parameter_file.scene_part(parameters)), connector)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def load_all(path: str | Path) -> dict[str, Scene]:
    """The scenes of all connectors of a file by name; "" if there is one without a name.

    Raises :class:`SceneError` as :func:`load`.
    """
    parameters = parameter_file.load_parameters(path, "connector", "/")
    try:
        return several(parameter_file.scene_part(parameters))
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def chosen(scenes: Mapping[str, Scene], connector: str) -> Scene:
    """The scene of a connector. Raises SceneError if there is none of that name."""
    if connector in scenes:
        return scenes[connector]
    if multiple.ONE in scenes:
        raise SceneError(f"connector {connector}: there is only one, without a name")
    which = f"{connector} is none of them" if connector else "choose one"
    raise SceneError(f"several connectors, {', '.join(scenes)}: {which}")


def _check_groups(holder: object, prefix: str) -> None:
    """Raise SceneError for a group that is not an object of its class."""
    for name, cls, may_be_absent in groups(type(holder)):
        given = getattr(holder, name)
        if may_be_absent and given is None:
            continue
        if not isinstance(given, cls):
            raise SceneError(f"{prefix}{name} = {show(given)}: must be a {cls.__name__}")
        _check_groups(given, f"{prefix}{name}.")


def _take(cls: type, name: str, prefix: str, values: Mapping[str, Any]) -> Any:
    """The value of field ``name`` of ``cls``: a parameter's value, or a group object."""
    for group_name, group_cls, absent in groups(cls):
        if group_name == name:
            below = f"{prefix}{name}."
            names = field_names(group_cls)
            made = {part: _take(group_cls, part, below, values) for part in names}
            return None if absent and not any(made.values()) else group_cls(**made)
    return values[prefix + name]


_SYMBOLS = {
    "mu": "friction.coefficient",
    "mu_s": "friction.static_coefficient",
    "R": "friction.radius",
    "L": "friction.overlap",
    "FCint": "friction.preload",
}
"""Parameters by their symbols in equations."""


def _unknown(name: str, value: object, table: Mapping[str, Parameter]) -> str:
    parts = {known.rsplit(".", level)[0] for known in table for level in (0, 1, 2)}
    leaf = name.rpartition(".")[2]
    same = [known for known in table if known.rpartition(".")[2] == leaf]
    near = [_SYMBOLS[leaf]] if leaf in _SYMBOLS else []
    near = near or difflib.get_close_matches(name, same, n=1, cutoff=0.0)
    near = near or difflib.get_close_matches(name, sorted(parts), n=1)
    below = [known for known in table if known.startswith(name + ".")]
    text = f"{name} = {show(value)}: no such parameter"
    if below:
        return f"{text}; it is a group: give {', '.join(below)}"
    return f"{text}; did you mean {near[0]}?" if near else text
