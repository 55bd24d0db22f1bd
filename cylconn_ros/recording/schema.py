"""Parser of ``ros2msg`` schemas: the fields of a message and of its nested messages."""

from __future__ import annotations

import re
from dataclasses import dataclass

from cylconn_ros.errors import RecordingError

PRIMITIVES = {
    "bool": "?",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
"""NumPy codes of the fixed-size field types."""

MOST_FIELDS = 10_000  # single fields of a message, those of nested messages included

_FIELD = re.compile(
    r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?"  # type, bound of a string
    r"(?P<array>\[(?:<=)?\d*\])?"  # [], [N] or [<=N]
    r"\s+(?P<name>[A-Za-z]\w*)\s*(?P<constant>=)?"
)


@dataclass(frozen=True)
class Field:
    """One field: element type (primitive, ``string`` or ``package/Name``) and element count."""

    name: str
    type: str
    count: int | None = 1  # None: a sequence, whose length is in the message
    is_array: bool = False


Schema = dict[str, tuple[Field, ...]]  # "package/Name" -> fields


def parse(type_name: str, text: str) -> Schema:
    """Parse a recorded schema: the definition, then referenced ones, each below a ``MSG:`` line.

    Raises RecordingError that names the invalid line or the missing type.
    """
    schema: Schema = {}
    current, package = short_name(type_name)
    fields: list[Field] = []
    for line in text.splitlines():
        if line.startswith("MSG: "):
            schema[current] = tuple(fields)
            current, package = short_name(line[5:].strip())
            fields = []
            continue
        code = line.partition("#")[0].strip()
        if not code or set(code) == {"="}:
            continue
        field = _field(code, package)
        if field is not None:
            fields.append(field)
    schema[current] = tuple(fields)
    for name, members in schema.items():
        for member in members:
            if member.type not in PRIMITIVES and member.type not in {"string", *schema}:
                raise RecordingError(f"schema of {name}: {member.type} is not defined")
    _check_size(schema, short_name(type_name)[0], {}, ())
    return schema


def _check_size(schema: Schema, name: str, known: dict[str, int], outer: tuple[str, ...]) -> int:
    """Number of single fields of a type; ``known``: of the types counted so far.

    Raises RecordingError for a type that contains itself, and for more fields than MOST_FIELDS,
    which few lines of definitions can state.
    """
    if name in outer:
        raise RecordingError(f"schema of {name}: it contains itself")
    if name not in known:
        inner = (*outer, name)
        known[name] = sum(
            _check_size(schema, member.type, known, inner) if member.type in schema else 1
            for member in schema[name]
        )
    if known[name] > MOST_FIELDS:
        raise RecordingError(f"schema of {name}: more than {MOST_FIELDS} fields")
    return known[name]


def short_name(type_name: str) -> tuple[str, str]:
    """Convert ``package/msg/Name`` or ``package/Name`` to (``package/Name``, ``package``)."""
    package, _, name = type_name.replace("/msg/", "/").partition("/")
    return f"{package}/{name}", package


def _field(code: str, package: str) -> Field | None:
    match = _FIELD.match(code)
    if match is None:
        raise RecordingError(f"schema: cannot parse {code!r}")
    if match["constant"]:
        return None
    kind = match["type"]
    if kind not in PRIMITIVES and kind != "string":
        kind = short_name(kind)[0] if "/" in kind else f"{package}/{kind}"
    array = match["array"]
    if array is None:
        return Field(match["name"], kind)
    size = array[1:-1]
    return Field(match["name"], kind, int(size) if size.isdigit() else None, is_array=True)
