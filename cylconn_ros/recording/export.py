"""Export of a recorded topic with one value per cell: pandas, CSV and Parquet.

The columns are ``time``, seconds since the first stamp (without stamps: since the first log time),
and the fields of the message by name. An array is one column per element, ``force[0]``. Where
messages have fewer elements than others, the cells are NaN, or empty if they are not floats.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.connector.outputs import DERIVED, acceleration
from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.table import STAMP, Table

if TYPE_CHECKING:
    import pandas

Array = npt.NDArray[Any]
LONGEST = 64
"""Elements of an array that become columns; a field with more (an image) is left out and named."""


@dataclass
class Layout:
    """Columns of a topic, over all of its messages.

    Attributes
    ----------
        fields: element type and greatest number of elements (None: a single value) by field.
        rows: number of messages.
        first: stamp of the first message, or its log time, ns.
    """

    fields: dict[str, tuple[np.dtype[Any], int | None]] = field(default_factory=dict)
    rows: int = 0
    first: int = 0

    @property
    def left_out(self) -> list[str]:
        """Fields with more than LONGEST elements."""
        return [name for name, (_, count) in self.fields.items() if (count or 0) > LONGEST]

    def add(self, table: Table) -> None:
        """Extend the layout by the next messages."""
        if not self.rows and len(table):
            self.first = int(_stamps(table)[0])
        self.rows += len(table)
        for name, values in table.columns.items():
            kind, count = _kind(values)
            known = self.fields.get(name)
            if known is not None and known[1]:
                kind, count = known[0], max(known[1], count or 0)
            self.fields[name] = kind, count

    def cells(self, table: Table) -> dict[str, Array]:
        """Return the columns of some messages, (n,) each, by name."""
        found = {"time": (_stamps(table) - self.first) * 1e-9}
        for name, (kind, count) in self.fields.items():
            values = table.columns[name]
            if count is None:
                found[name] = values
            elif count <= LONGEST:
                found |= {f"{name}[{k}]": _element(values, k, kind) for k in range(count)}
        return found

    def kinds(self) -> dict[str, np.dtype[Any]]:
        """Return the type of every column by name; object for texts."""
        found = {"time": np.dtype(np.float64)}
        for name, (kind, count) in self.fields.items():
            if count is None:
                found[name] = kind
            elif count <= LONGEST:
                found |= {f"{name}[{k}]": kind for k in range(count)}
        return found


def layout_of(blocks: Iterable[Table]) -> Layout:
    """Return the layout of the messages of a topic."""
    layout = Layout()
    for block in blocks:
        layout.add(block)
    return layout


def with_acceleration(blocks: Iterable[Table]) -> Iterator[Table]:
    """Yield blocks of states with the columns of connector.outputs.DERIVED.

    The last sample of a block needs the first of the next one.
    """
    held: Table | None = None
    for block in blocks:
        if len(block):
            if held is not None:
                yield _accelerated(held, block)
            held = block
    if held is not None:
        yield _accelerated(held, None)


def _accelerated(block: Table, after: Table | None) -> Table:
    both = [block] if after is None else [block, after]
    stamp = np.concatenate([part.stamp for part in both])[: len(block) + 1]
    columns = dict(block.columns)
    for name, of in DERIVED.items():
        if of not in columns:
            raise RecordingError(f"{block.topic}: has no {of}, so that it has no {name}")
        rate = np.concatenate([part[of][:, 0] for part in both])[: len(block) + 1]
        columns[name] = acceleration(np.diff(stamp) * 1e-9, rate)[: len(block)]
    return replace(block, columns=columns)


def to_dataframe(table: Table) -> pandas.DataFrame:
    """Return a topic as a DataFrame with ``time`` as the index; see ``Run.to_dataframe``."""
    try:
        import pandas
    except ImportError:
        raise RecordingError("pandas is not installed: pip install pandas") from None
    cells = layout_of([table]).cells(table)
    return pandas.DataFrame(cells).set_index("time")


def write_csv(read: Callable[[], Iterator[Table]], path: Path) -> Layout:
    """Write the messages of a topic as CSV, numbers with all their digits, block by block.

    ``read`` returns the blocks of the topic from the beginning; it is called twice. Raises
    RecordingError if the topic has no columns, or the file exists or cannot be written.
    """
    layout = layout_of(read())
    try:
        with path.open("x", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(layout.kinds())
            for cells in _blocks(read, layout):
                writer.writerows(zip(*(column.tolist() for column in cells.values()), strict=True))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    return layout


def write_parquet(read: Callable[[], Iterator[Table]], path: Path) -> Layout:
    """Write the messages of a topic as Parquet, one row group per block; needs pyarrow.

    ``read`` is that of :func:`write_csv`. Raises RecordingError if pyarrow is not installed, the
    topic has no columns, or the file exists or cannot be written.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise RecordingError("Parquet needs pyarrow: pip install pyarrow") from None
    layout = layout_of(read())
    types = {
        name: pyarrow.string() if kind.kind == "O" else pyarrow.from_numpy_dtype(kind)
        for name, kind in layout.kinds().items()
    }
    schema = pyarrow.schema(list(types.items()))
    try:
        with path.open("xb") as file, parquet.ParquetWriter(file, schema) as writer:
            for cells in _blocks(read, layout):
                columns = [pyarrow.array(cells[name], kind) for name, kind in types.items()]
                writer.write_table(pyarrow.Table.from_arrays(columns, schema=schema))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    return layout


def _blocks(read: Callable[[], Iterator[Table]], layout: Layout) -> Iterator[dict[str, Array]]:
    return (layout.cells(block) for block in read() if len(block))


def _stamps(table: Table) -> npt.NDArray[np.int64]:
    return table.stamp if set(STAMP) <= set(table.columns) else table.log_time


def _kind(values: Array) -> tuple[np.dtype[Any], int | None]:
    """Return the element type of a column, and the greatest number of elements of a row."""
    if values.ndim == 2:
        return values.dtype, values.shape[1]
    if len(values) and isinstance(values[0], np.ndarray):  # rows of different lengths
        longest = max(values, key=len)
        return longest.dtype, len(longest)
    return values.dtype, None


def _element(values: Array, k: int, kind: np.dtype[Any]) -> Array:
    """Return element ``k`` of every row; where a row is shorter, NaN or None."""
    if values.ndim == 2 and k < values.shape[1]:
        return np.asarray(values[:, k])
    found = np.empty(len(values), kind if kind.kind == "f" else object)
    missing = np.nan if kind.kind == "f" else None
    found[:] = [row[k] if k < len(row) else missing for row in values]
    return found
