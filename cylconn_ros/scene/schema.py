"""Parameter schema: type, unit, default, bounds, choices, description and scope, stated once.

A dataclass field made with :func:`parameter` carries all properties of one parameter;
:func:`group` nests another such dataclass. :func:`describe` turns the tree into a flat table of
:class:`Parameter`. The YAML check, the ROS parameter declaration, the documentation, the rules for
several connectors and the rule for a restart of the history are derived from that table.
"""

from __future__ import annotations

import array
import dataclasses
import math
import typing
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cylconn_ros.errors import SceneError

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

_KINDS = {
    bool: "bool", int: "int", float: "float", str: "str",
    tuple[float, ...]: "vector", tuple[str, ...]: "words",
}  # fmt: skip
_REQUIRED = object()
_SEQUENCES = (Sequence, array.array, np.ndarray)


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter: dotted name, accepted values, and where a change of it takes effect."""

    name: str
    kind: str  # bool, int, float, str, vector (of floats) or words (of ``choices``, each once)
    default: Any  # None if the parameter is required
    doc: str
    unit: str = ""
    required: bool = False
    optional: bool = False  # NaN, or an empty vector, means: not set
    infinite: bool = False  # infinity is accepted
    ge: float | None = None
    gt: float | None = None
    le: float | None = None
    lt: float | None = None
    choices: tuple[str, ...] = ()
    size: int | None = None
    pose: bool = False  # a vector whose last four numbers are a quaternion x y z w
    read_only: bool = False
    example: Any = None
    node: bool = False  # one value for the node: not allowed in the block of one connector
    restarts: bool = False  # a change starts a new history (new reference configuration)
    shared: str = ""  # must agree between: "body", connectors with that body; "coupled", connectors
    # that are solved together because they share a body

    @property
    def rule(self) -> str:
        """The accepted values as text."""
        if self.kind == "bool":
            return "true or false"
        if self.kind == "str":
            return "one of " + ", ".join(self.choices) if self.choices else "a non-empty string"
        if self.kind == "words":
            return "one or more of " + ", ".join(self.choices) + ", each once"
        unit = f" {self.unit}" if self.unit and self.unit != "1" else ""
        signs = ((">=", self.ge), (">", self.gt), ("<=", self.le), ("<", self.lt))
        bounds = " and ".join(
            f"{sign} {bound:g}{unit}" for sign, bound in signs if bound is not None
        )
        if self.kind == "vector":
            words = "numbers" if self.size is None else f"{self.size} numbers"
            if self.pose:
                words += (
                    ", the last four a quaternion x, y, z, w" if self.size == 7 else " x, y, z, w"
                )
            words += f", each {bounds}" if bounds else ""
        else:
            words = "an integer" if self.kind == "int" else "a number"
            words += f" {bounds}" if bounds else ""
        if not self.infinite:
            words += "" if self.kind == "int" else ", finite"
        if self.optional:
            words += ", or [] for not set" if self.kind == "vector" else ", or .nan for not set"
        return words

    def refuse(self, value: object, why: str = "") -> SceneError:
        """Return the error for ``value``, ready to raise."""
        text = f"{self.name} = {show(value)}: must be {self.rule}"
        return SceneError(f"{text} ({why})" if why else text)

    def check(self, value: object) -> Value:
        """Return ``value`` in this parameter's own type, or raise :class:`SceneError`."""
        if self.kind == "bool":
            if not isinstance(value, bool):
                raise self.refuse(value)
            return value
        if self.kind == "str":
            if (
                not isinstance(value, str)
                or not value
                or (self.choices and value not in self.choices)
            ):
                raise self.refuse(value)
            return value
        if self.kind == "vector":
            return self._check_vector(value)
        if self.kind == "words":
            return self._check_words(value)
        if self.kind == "int":
            whole = _whole(value)
            if whole is None or not self._within(whole):
                raise self.refuse(value)
            return whole
        number = _number(value)
        if number is None:
            raise self.refuse(value)
        if math.isnan(number) and self.optional:
            return number
        if not self._within(number):
            raise self.refuse(value)
        return number

    def _check_words(self, value: object) -> tuple[str, ...]:
        if not isinstance(value, _SEQUENCES) or isinstance(value, str):
            raise self.refuse(value)
        words = tuple(typing.cast("Sequence[object]", value))
        if not words or len(set(words)) < len(words) or not set(words) <= set(self.choices):
            raise self.refuse(value)
        return typing.cast("tuple[str, ...]", words)

    def _check_vector(self, value: object) -> tuple[float, ...]:
        if value is None or not isinstance(value, _SEQUENCES) or isinstance(value, str):
            raise self.refuse(value)
        numbers = [_number(item) for item in typing.cast("Sequence[object]", value)]
        if any(number is None for number in numbers):
            raise self.refuse(value)
        vector = tuple(typing.cast("list[float]", numbers))
        if not vector and (self.optional or self.size is None):
            return ()
        if self.size is not None and len(vector) != self.size:
            raise self.refuse(value, f"{len(vector)} given")
        for number in vector:
            if not self._within(number):
                raise self.refuse(value)
        return self._normalised(vector) if self.pose else vector

    def _within(self, number: float) -> bool:
        if not (math.isfinite(number) or (self.infinite and math.isinf(number))):
            return False
        return (
            (self.ge is None or number >= self.ge)
            and (self.gt is None or number > self.gt)
            and (self.le is None or number <= self.le)
            and (self.lt is None or number < self.lt)
        )

    def _normalised(self, vector: tuple[float, ...]) -> tuple[float, ...]:
        quaternion = vector[-4:]
        length = math.hypot(*quaternion)
        if not 1e-9 < length < 1e9:
            raise self.refuse(vector, f"an orientation of length {length:g} has no direction")
        if abs(length - 1.0) < 1e-14:  # keep every bit, so that a saved scene loads bit for bit
            return vector
        return vector[:-4] + tuple(component / length for component in quaternion)


def parameter(default: Any = _REQUIRED, *, doc: str, **rules: Any) -> Any:
    """Make a dataclass field that is one parameter.

    ``rules`` are attributes of :class:`Parameter`. A parameter without ``default`` is required.
    """
    required = default is _REQUIRED
    if isinstance(default, float) and math.isnan(default):
        rules.setdefault("optional", True)
    if isinstance(default, float) and math.isinf(default):
        rules.setdefault("infinite", True)
    metadata = {"parameter": {"doc": doc, "required": required, **rules}}
    if required:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def group(
    cls: type, *, absent: bool = False, change: Mapping[str, Mapping[str, Any]] | None = None
) -> Any:
    """Make a dataclass field holding the parameters of ``cls`` one level down.

    Args:
        absent: the group may be ``None``, and is ``None`` if none of its parameters is given.
        change: per parameter, the rules (including ``default``) that differ in this group.
    """
    metadata = {"group": cls, "absent": absent, "change": dict(change or {})}
    if absent:
        return dataclasses.field(default=None, metadata=metadata)
    defaults = {
        name: rules["default"] for name, rules in (change or {}).items() if "default" in rules
    }
    required = [
        f.name for f in dataclasses.fields(cls) if _has_no_default(f) and f.name not in defaults
    ]
    if required:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default_factory=lambda: cls(**defaults), metadata=metadata)


def describe(
    cls: type, prefix: str = "", change: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, Parameter]:
    """List every parameter of ``cls`` and the groups below it by dotted name, in order."""
    table: dict[str, Parameter] = {}
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):
        name = prefix + field.name
        if "group" in field.metadata:
            table.update(describe(field.metadata["group"], name + ".", field.metadata["change"]))
            continue
        different = (change or {}).get(field.name, {})
        rules = {**field.metadata["parameter"], **different}
        if "default" in different:
            rules["required"] = False
        elif rules["required"]:
            rules["default"] = None
        else:
            rules["default"] = field.default
        table[name] = Parameter(name=name, kind=_KINDS[hints[field.name]], **rules)
    return table


_GROUPS: dict[type, tuple[tuple[str, type, bool], ...]] = {}
_NAMES: dict[type, tuple[str, ...]] = {}  # both are asked for at every scene that is made


def groups(cls: type) -> tuple[tuple[str, type, bool], ...]:
    """Name, class and ``absent`` flag of each group directly in ``cls``."""
    if cls not in _GROUPS:
        _GROUPS[cls] = tuple(
            (field.name, field.metadata["group"], field.metadata["absent"])
            for field in dataclasses.fields(cls)
            if "group" in field.metadata
        )
    return _GROUPS[cls]


def field_names(cls: type) -> tuple[str, ...]:
    """Names of the parameters and groups directly in ``cls``, in order."""
    if cls not in _NAMES:
        _NAMES[cls] = tuple(field.name for field in dataclasses.fields(cls))
    return _NAMES[cls]


def flatten(mapping: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one mapping with dotted names. A name given twice raises SceneError."""
    flat: dict[str, Any] = {}
    for key, value in mapping.items():
        name = prefix + str(key)
        found = flatten(value, name + ".") if isinstance(value, Mapping) else {name: value}
        for twice in found.keys() & flat.keys():
            raise SceneError(
                f"{twice} = {show(found[twice])}: is given twice, also as {show(flat[twice])}"
            )
        flat.update(found)
    return flat


_LONGEST = 500  # characters of a text, and numbers of a sequence, in a message


def show(value: object, whole: bool = False) -> str:
    """The value as a user writes it in YAML; a very long one is cut unless ``whole``."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, str):
        if len(value) > _LONGEST and not whole:
            return f"{value[:_LONGEST]!r}… ({len(value)} characters)"
        return repr(value)
    if isinstance(value, _SEQUENCES):
        items = typing.cast("Sequence[object]", value)
        if len(items) > _LONGEST and not whole:
            return (
                f"[{', '.join(show(item) for item in items[:_LONGEST])}, … ({len(items)} values)]"
            )
        return "[" + ", ".join(show(item, whole) for item in items) + "]"
    return repr(float(value)) if isinstance(value, float) else str(value)


def _number(value: object) -> float | None:
    """A float from any real number except bool, or None."""
    if isinstance(value, bool) or not hasattr(value, "__float__") or isinstance(value, str):
        return None
    try:
        return float(typing.cast(float, value))
    except (TypeError, ValueError, OverflowError):
        return None


def _whole(value: object) -> int | None:
    number = _number(value)
    if number is None or not math.isfinite(number) or number != math.floor(number):
        return None
    return int(number)


def _has_no_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
