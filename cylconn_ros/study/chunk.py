"""A chunk of rows: what a worker computes and returns, as the bytes of a Parquet file."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cylconn_ros.errors import CylconnError, StudyError
from cylconn_ros.study.rows import Rows

ROW, STATUS, ERROR = "row", "status", "error"
OK, FAILED = "ok", "failed"
_PAGE = os.sysconf("SC_PAGE_SIZE")


class Task(Protocol):
    """The function of a row: picklable, without state.

    Attributes
    ----------
        outputs: type of each column that it returns, by name: float64, int64, bool or string.
    """

    @property
    def outputs(self) -> Mapping[str, str]:
        """Type of each output column."""
        ...

    def __call__(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the record of a row; an output that is not in it is null."""
        ...


@dataclass(frozen=True)
class Chunk:
    """The computed rows of a chunk.

    Attributes
    ----------
        data: Parquet file. rows, failed: numbers of rows.
        cpu: processor time of the thread, s. worker: host and process. memory: of the process
            afterwards, bytes.
    """

    data: bytes
    rows: int
    failed: int
    cpu: float
    worker: str
    memory: int


def compute(task: Task, first: int, rows: Rows) -> Chunk:
    """Compute rows, the first of which has the number ``first``.

    An exception of a row becomes its status and error, and the other rows are computed.
    """
    begin = time.thread_time()
    records: list[Mapping[str, Any]] = []
    errors: list[str] = []
    for k in range(len(rows)):
        try:
            records.append(task(rows.row(k)))
            errors.append("")
        except Exception as error:
            records.append({})
            known = isinstance(error, CylconnError)
            errors.append(str(error) if known else f"{type(error).__name__}: {error}")
    data = pack(first, rows, task.outputs, records, errors)
    worker = f"{socket.gethostname()}/{os.getpid()}/{threading.get_native_id()}"
    failed = sum(map(bool, errors))
    cpu = time.thread_time() - begin
    return Chunk(data, len(rows), failed, cpu, worker, resident())


def lost(task: Task, first: int, rows: Rows) -> Chunk:
    """Return rows whose process ended whenever it computed them, as failures."""
    text = "the process that computed this chunk ended each time (killed, or out of memory)"
    records: list[Mapping[str, Any]] = [{}] * len(rows)
    data = pack(first, rows, task.outputs, records, [text] * len(rows))
    return Chunk(data, len(rows), len(rows), 0.0, "", 0)


def pack(
    first: int,
    rows: Rows,
    outputs: Mapping[str, str],
    records: list[Mapping[str, Any]],
    errors: list[str],
) -> bytes:
    """Return a Parquet file with number, inputs, status, error and outputs of each row."""
    pyarrow, parquet = arrow()
    columns = {ROW: pyarrow.array(np.arange(first, first + len(rows)))}
    for name, values in rows.columns.items():
        kind = pyarrow.string() if values.dtype == object else None
        columns[name] = pyarrow.array(values, kind)
    columns[STATUS] = pyarrow.array([FAILED if error else OK for error in errors])
    columns[ERROR] = pyarrow.array(errors)
    for name, kind in outputs.items():
        arrow_type = getattr(pyarrow, "bool_" if kind == "bool" else kind)()
        columns[name] = pyarrow.array([record.get(name) for record in records], arrow_type)
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(columns), sink, compression="zstd")
    return bytes(sink.getvalue())


def arrow() -> tuple[Any, Any]:
    """Return pyarrow and its module for Parquet. Raises StudyError if it is not installed."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise StudyError("datasets need pyarrow: pip install '.[scale]'") from None
    return pyarrow, parquet


def resident() -> int:
    """Memory of this process, bytes; 0 where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE
    except (OSError, ValueError, IndexError):
        return 0
