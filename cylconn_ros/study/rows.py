"""Rows of a study: a table of parameter values, one simulation a row.

A column is a parameter by its dotted name, or a component of a vector, ``body_b.com[1]``; in front
may stand the name of a connector (study/variants.py). Axes are columns that vary together; rows are
all combinations of the axes, the last axis fastest.
"""

from __future__ import annotations

import csv
import difflib
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import SceneError, StudyError
from cylconn_ros.scene.parameter_file import parse
from cylconn_ros.scene.scene import Scene, schema
from cylconn_ros.scene.schema import Parameter, show

Column = NDArray[Any]
Axis = Mapping[str, Column]
"""Columns (n,) that vary together, by name."""

MOST_ROWS = 100_000_000
_COMPONENT = re.compile(r"(.+)\[(\d+)\]$")


@dataclass(frozen=True)
class Rows:
    """A table of N rows.

    Attributes
    ----------
        columns: (N,) values by name; object arrays for texts.
        count: N.
    """

    columns: Mapping[str, Column]
    count: int

    def __len__(self) -> int:
        """Number of rows."""
        return self.count

    def part(self, first: int, stop: int) -> Rows:
        """Rows ``first`` to ``stop`` - 1."""
        stop = min(stop, self.count)
        columns = {name: values[first:stop] for name, values in self.columns.items()}
        return Rows(columns, stop - first)

    def row(self, number: int) -> dict[str, Any]:
        """The values of a row by column name, as Python objects."""
        return {name: _plain(values[number]) for name, values in self.columns.items()}

    def digest(self) -> str:
        """SHA-256 of names and values: equal tables have equal digests."""
        found = hashlib.sha256()
        for name, values in self.columns.items():
            found.update(f"{name} {values.dtype.str} ".encode())
            if values.dtype == object:
                found.update("\0".join(map(str, values)).encode())
            else:
                found.update(np.ascontiguousarray(values).tobytes())
        return found.hexdigest()


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def combine(axes: Sequence[Axis]) -> Rows:
    """All combinations of the axes, the last fastest.

    Raises StudyError for a column that is given twice, or for too many rows.
    """
    lengths = [len(next(iter(axis.values()))) for axis in axes]
    count = 1
    for length in lengths:
        count *= length
    if count > MOST_ROWS:
        raise StudyError(f"{count} rows: must be at most {MOST_ROWS}")
    columns: dict[str, Column] = {}
    repeat = count
    for axis, length in zip(axes, lengths, strict=True):
        repeat = repeat // length if length else 0
        which = (np.arange(count) // max(repeat, 1)) % max(length, 1)
        for name, values in axis.items():
            other = next((one for one in columns if _overlap(name, one)), None)
            if other is not None:
                also = "" if other == name else f", also as {other}"
                raise StudyError(f"{name}: is varied twice{also}")
            columns[name] = values[which]
    return Rows(columns, count)


def _overlap(one: str, other: str) -> bool:
    """Whether two columns change the same number; no connector and no component mean all."""
    pairs = list(zip(place_of(one), place_of(other), strict=True))
    same_parameter = pairs[1][0] == pairs[1][1]
    return same_parameter and all(x == y or x in ("", None) or y in ("", None) for x, y in pairs)


def split(name: str) -> tuple[str, int | None]:
    """Parameter and component of a column name; None: the whole parameter."""
    found = _COMPONENT.fullmatch(name)
    return (found[1], int(found[2])) if found else (name, None)


def place_of(name: str) -> tuple[str, str, int | None]:
    """Connector, parameter and component of a column name.

    The connector is '' for a parameter of all, or for none of the parameters that exist.
    """
    parameter, component = split(name)
    connector, _, rest = parameter.partition(".")
    own = parameter not in schema() and rest in schema()
    return (connector, rest, component) if own else ("", parameter, component)


def rules_of(name: str) -> Parameter:
    """Rules of a column's parameter, which exists."""
    return schema()[place_of(name)[1]]


def known(name: str) -> str:
    """The column name, if there is such a parameter; raises StudyError with the nearest one."""
    _, parameter, component = place_of(name)
    rules = schema().get(parameter)
    if rules is None:
        near = difflib.get_close_matches(parameter, schema(), n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise StudyError(f"{parameter}: no such parameter{hint}")
    if component is not None and (rules.kind != "vector" or component >= (rules.size or 1 << 16)):
        raise StudyError(f"{name}: no such component; {parameter} is {rules.rule}")
    return name


def axis_of(name: str, values: Sequence[Any]) -> Axis:
    """Return the axis of one parameter with these values; a vector becomes a column a component."""
    known(name)
    if any(isinstance(one, list | tuple | np.ndarray) for one in values):
        sizes = {len(one) if isinstance(one, list | tuple | np.ndarray) else 0 for one in values}
        if rules_of(name).kind != "vector" or split(name)[1] is not None:
            raise StudyError(f"{name} = {show(values[0])}: must be {rules_of(name).rule}")
        if len(sizes) != 1 or 0 in sizes:
            raise StudyError(f"{name}: its values must be vectors of one length")
        return {
            f"{name}[{k}]": np.array([float(one[k]) for one in values]) for k in range(sizes.pop())
        }
    return {name: _column(name, values)}


def _column(name: str, values: Sequence[Any]) -> Column:
    """Values as an array of the parameter's type. Raises StudyError for one of another type."""
    rules = rules_of(name)
    kind = rules.kind
    fitting = [v for v in values if _fits(v, kind)]
    if len(fitting) < len(values):
        wrong = next(v for v in values if not _fits(v, kind))
        raise StudyError(f"{name} = {show(wrong)}: must be {rules.rule}")
    types = {"float": np.float64, "vector": np.float64, "int": np.int64, "bool": np.bool_}
    found: Column = np.empty(len(values), dtype=types.get(kind, object))
    found[:] = values
    return found


def _fits(value: Any, kind: str) -> bool:
    """Whether a value is of a parameter's kind."""
    if isinstance(value, bool | np.bool_) or kind == "bool":
        return isinstance(value, bool | np.bool_) and kind == "bool"
    if kind in ("str", "words"):
        return isinstance(value, str)
    number = isinstance(value, int | float | np.number)
    return number and (kind != "int" or (np.isfinite(value) and float(value) == int(value)))


def read_axis(text: str) -> Axis:
    """Read an axis from the text of --vary.

    ``NAME=LOW:HIGH:COUNT`` (equal distances), ``NAME=LOW:HIGH:COUNT:log`` (equal ratios),
    ``NAME=A,B,C`` (values, vectors as [x, y, z]), ``NAME=@FILE.csv`` (a value or a vector a line),
    or ``@FILE.csv`` (a table whose header names the columns, which vary together). Raises
    StudyError.
    """
    if text.startswith("@"):
        return _table(text[1:])
    name, equals, values = text.partition("=")
    name = name.strip()
    if not equals or not values:
        raise StudyError(f"--vary {text}: must be NAME=VALUES or @FILE.csv")
    known(name)
    if values.startswith("@"):
        axis = _file(name, values[1:])
    elif ":" in values and "[" not in values:
        axis = {name: _column(name, _range(text, values))}
    else:
        try:
            found = [_float(one) for one in parse(f"[{values}]")]
        except SceneError as error:
            raise StudyError(f"--vary {text}: {error}") from None
        axis = axis_of(name, found)
    _check_varies(text, axis)
    return axis


def _float(value: Any) -> Any:
    """Return whole numbers in a vector as floats; other values as they are."""
    return [float(v) for v in value] if _is_vector(value) else value


def _is_vector(value: Any) -> bool:
    return isinstance(value, list | tuple | np.ndarray) and all(
        isinstance(v, int | float) for v in value
    )


def _check_varies(text: str, axis: Axis) -> None:
    """Raise StudyError for an axis whose columns all have one value."""
    if all(len(set(values.tolist())) < 2 for values in axis.values()):
        raise StudyError(f"--vary {text}: does not vary; give a fixed value with --set")


def _range(text: str, values: str) -> list[float]:
    parts = values.split(":")
    try:
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
        logarithmic = parts[3:] == ["log"]
        if len(parts) > 3 + logarithmic or count < 1 or not np.isfinite([low, high]).all():
            raise ValueError
        if logarithmic and min(low, high) <= 0.0:
            raise ValueError
    except (ValueError, IndexError):
        raise StudyError(
            f"--vary {text}: must be LOW:HIGH:COUNT or LOW:HIGH:COUNT:log (both > 0); "
            "LOW:HIGH without a count needs --sample N"
        ) from None
    if not logarithmic:
        return np.linspace(low, high, count).tolist()
    return np.geomspace(low, high, count).tolist()


def _lines(path: str) -> list[list[str]]:
    """Cells of a CSV file, without empty lines and comments. Raises StudyError."""
    from cylconn_ros.study.dataset import open_text

    lines = [line for line in csv.reader(open_text(path).splitlines()) if any(line)]
    found = [[cell.strip() for cell in line] for line in lines if not line[0].startswith("#")]
    if not found:
        raise StudyError(f"{path}: is empty")
    return found


def _file(name: str, path: str) -> Axis:
    """Return the values of one parameter from a file: a value, or a vector, a line."""
    lines = _lines(path)
    first = 0 if _is_number(lines[0][0]) or len(lines) == 1 else 1  # a header
    if rules_of(name).kind in ("str", "words") and lines[0][0] != name:
        first = 0
    width = len(lines[first])
    rows = []
    for number, line in enumerate(lines[first:], first + 1):
        if len(line) != width:
            raise StudyError(f"{path}, line {number}: has {len(line)} values, must have {width}")
        try:
            rows.append([_cell(cell) for cell in line])
        except SceneError as error:
            raise StudyError(f"{path}, line {number}: {error}") from None
    return axis_of(name, [row if width > 1 else row[0] for row in rows])


def _table(path: str) -> Axis:
    """Columns of a file whose header names parameters or their components."""
    names, *lines = _lines(path)
    for name in names:
        known(name)
    if not lines:
        raise StudyError(f"{path}: has a header and no row")
    for number, line in enumerate(lines, 2):
        if len(line) != len(names):
            raise StudyError(f"{path}, line {number}: has {len(line)} values, not {len(names)}")
    axis: dict[str, Column] = {}
    for k, name in enumerate(names):
        try:
            axis.update(axis_of(name, [_cell(line[k]) for line in lines]))
        except SceneError as error:
            raise StudyError(f"{path}, column {name}: {error}") from None
    _check_varies(f"@{path}", axis)
    return axis


_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


def _cell(text: str) -> Any:
    """Read a cell as YAML, a plain number without it: a file may have a million of them."""
    return float(text) if _NUMBER.match(text) else parse(text)


def wrong_value(rows: Rows) -> str:
    """Name the first row with a value that its parameter never accepts; '' if there is none.

    Each different value is checked once, so that this takes little time for many rows.
    """
    first, why = len(rows), ""
    for name, values in rows.columns.items():
        component, rules = split(name)[1], rules_of(name)
        different, at = np.unique(values, return_index=True)
        for value, row in zip(different.tolist(), at.tolist(), strict=True):
            one = (rules.size or 1) * [value] if component is not None else value
            if row >= first or rules.pose:  # an orientation is normalised as a whole
                continue
            try:
                rules.check(one)
            except SceneError:
                bounded = f"{name} = {show(value)}: must be {rules.rule}"
                first, why = row, f"row {row}: {bounded}"
    return why


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def changes(scene: Scene, row: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by name of a row: components are put into the scene's vectors."""
    found: dict[str, Any] = {}
    for name, value in row.items():
        parameter, component = split(name)
        if component is None:
            found[name] = value
            continue
        vector = found.setdefault(parameter, list(scene.parameters()[parameter]))  # type: ignore[arg-type]
        size = schema()[parameter].size or 0
        vector.extend([0.0] * (max(size, component + 1) - len(vector)))
        vector[component] = value
    return found
