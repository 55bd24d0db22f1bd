"""Serialised messages of one type to one NumPy array per field.

CDR puts fields at offsets that depend only on the lengths of the strings and sequences before them.
A run repeats a few such shapes thousands of times, so one message of each shape is walked by its
schema and all others of that shape are read as strided views: no Python per message.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.message_block import Block, Found, of_messages
from cylconn_ros.recording.schema import PRIMITIVES, Schema

HEADER_BYTES = (
    4  # encapsulation: byte 1 says 0 big, 1 little endian (plain CDR, no parameter lists)
)


@dataclass
class _Layout:
    """Where one shape of message keeps its fields (offsets from the start of the bytes)."""

    leaves: dict[str, tuple[int, str, int | None]] = field(default_factory=dict)
    strings: dict[str, list[tuple[int, int]] | tuple[int, int]] = field(default_factory=dict)
    lengths: list[tuple[int, int]] = field(default_factory=list)  # offset, value of a length prefix
    size: int = 0


class _Walker:
    """Walk one message by its schema and note the place of every field."""

    def __init__(self, schema: Schema, data: bytes) -> None:
        if len(data) < HEADER_BYTES or data[0] != 0 or data[1] not in (0, 1):
            raise RecordingError("not plain CDR")
        self.schema, self.data = schema, data
        self.order = "<" if data[1] else ">"
        self.at = HEADER_BYTES
        self.sequences = 0
        self.layout = _Layout()

    def message(self, type_name: str, prefix: str = "") -> None:
        members = self.schema[type_name]
        if not members:  # an empty message still has one byte
            self._take(1, 1)
        for member in members:
            name = f"{prefix}{member.name}"
            count = member.count
            if count is None:
                count = self._length()
                self.sequences += 1
            if member.type in PRIMITIVES:
                code = PRIMITIVES[member.type]
                width = np.dtype(code).itemsize
                offset = self._take(width * count, width) if count else self.at
                kept = count if member.is_array else None
                self.layout.leaves[name] = (offset, self.order + code, kept)
            elif member.type == "string":
                found = [self._string() for _ in range(count)]
                self.layout.strings[name] = found if member.is_array else found[0]
            elif member.is_array:
                raise RecordingError(f"field {name} is a list of messages: no columns for it")
            else:
                self.message(member.type, f"{name}.")

    def finish(self) -> _Layout:
        # rclpy reserves the alignment of empty sequences and leaves it at the end as padding.
        if len(self.data) - self.at >= 8 * (1 + self.sequences):
            raise RecordingError(f"{len(self.data) - self.at} bytes more than its type has")
        self.layout.size = len(self.data)
        return self.layout

    def _take(self, size: int, alignment: int) -> int:
        body = self.at - HEADER_BYTES
        offset = self.at + (-body % alignment)
        if offset + size > len(self.data):
            raise RecordingError("shorter than its type")
        self.at = offset + size
        return offset

    def _length(self) -> int:
        offset = self._take(4, 4)
        value = int.from_bytes(
            self.data[offset : offset + 4], "little" if self.order == "<" else "big"
        )
        if value > len(self.data):
            raise RecordingError("a length beyond its end")
        self.layout.lengths.append((offset, value))
        return value

    def _string(self) -> tuple[int, int]:
        length = self._length()
        offset = self._take(length, 1)
        return offset, max(length - 1, 0)  # without the closing zero


def has_columns(schema: Schema, type_name: str) -> bool:
    """Whether messages of a type become columns: none holds a list of messages."""
    nested = [m for m in schema[type_name] if m.type not in PRIMITIVES and m.type != "string"]
    return all(not m.is_array and has_columns(schema, m.type) for m in nested)


def columns(
    schema: Schema, type_name: str, messages: Sequence[bytes]
) -> tuple[dict[str, npt.NDArray[Any]], npt.NDArray[np.bool_]]:
    """Decode messages of one type.

    Args:
        schema: from :func:`schema.parse`.
        type_name: ``package/Name``.
        messages: n serialised messages.

    Returns
    -------
        The fields, ``a.b`` for nested ones: arrays of shape (n_ok,) or (n_ok, k), text as objects;
        where rows differ in length the column holds one array per row. And a mask (n,) of the
        messages that could be decoded (n_ok of them): a recording may hold what a broken publisher
        sent.

    Raises RecordingError for types with lists of messages inside, which have no columns.
    """
    return of_block(schema, type_name, of_messages([Found(0, 0, 0, m) for m in messages]))


def of_block(
    schema: Schema,
    type_name: str,
    block: Block,
    which: npt.NDArray[np.intp] | None = None,
    only: Collection[str] | None = None,
) -> tuple[dict[str, npt.NDArray[Any]], npt.NDArray[np.bool_]]:
    """Decode messages ``which`` (n,) of a block, by default all, as :func:`columns` does.

    ``only``: the fields that are wanted; by default all.
    """
    which = np.arange(len(block)) if which is None else which
    good = np.zeros(len(which), dtype=bool)
    sizes = block.size[which]
    parts: list[tuple[npt.NDArray[np.intp], dict[str, npt.NDArray[Any]]]] = []
    for size in np.unique(sizes).tolist():
        if size < HEADER_BYTES:
            continue
        rows = np.flatnonzero(sizes == size)
        table = block.rows(which[rows], size)
        while len(rows):
            same, part = _one_shape(schema, type_name, table, only)
            if part is not None:
                parts.append((rows[same], part))
                good[rows[same]] = True
            rows, table = rows[~same], table[~same]
    return _join(parts, good), good


def _one_shape(
    schema: Schema, type_name: str, table: npt.NDArray[np.uint8], only: Collection[str] | None
) -> tuple[npt.NDArray[np.bool_], dict[str, npt.NDArray[Any]] | None]:
    """Decode all rows shaped like the first one; the mask says which those are."""
    first = table[0].tobytes()
    try:
        walker = _Walker(schema, first)
        walker.message(type_name)
        layout = walker.finish()
    except RecordingError as error:
        if "list of messages" in str(error):
            raise
        alone = np.zeros(len(table), dtype=bool)
        alone[0] = True
        return alone, None
    same = (table[:, :2] == table[0, :2]).all(axis=1)
    for offset, _ in layout.lengths:
        same &= (table[:, offset : offset + 4] == table[0, offset : offset + 4]).all(axis=1)
    rows = table[same]
    part: dict[str, npt.NDArray[Any]] = {}
    for name, (offset, code, count) in layout.leaves.items():
        if only is not None and name not in only:
            continue
        width = np.dtype(code).itemsize * (1 if count is None else count)
        block = np.ascontiguousarray(rows[:, offset : offset + width])
        values = block.view(code) if width else np.empty((len(rows), 0), code)
        values = values.astype(np.dtype(code).newbyteorder("="))
        part[name] = values[:, 0] if count is None else values
    for name, place in layout.strings.items():
        if only is not None and name not in only:
            continue
        if isinstance(place, tuple):
            part[name] = _texts(rows, *place)
        else:
            texts = [_texts(rows, *one) for one in place]
            part[name] = np.stack(texts, axis=1) if texts else np.empty((len(rows), 0), object)
    return same, part


def _texts(rows: npt.NDArray[np.uint8], offset: int, length: int) -> npt.NDArray[np.object_]:
    """Text at a fixed place of every row; a run has few different ones, so each is decoded once."""
    block = np.ascontiguousarray(rows[:, offset : offset + length])
    if (block == block[:1]).all():
        found = np.empty(len(rows), dtype=object)
        found[:] = block[0].tobytes().decode("utf-8", errors="replace")
        return found
    distinct, inverse = np.unique(block, axis=0, return_inverse=True)
    decoded = np.empty(len(distinct), dtype=object)
    decoded[:] = [row.tobytes().decode("utf-8", errors="replace") for row in distinct]
    return decoded[inverse.reshape(-1)]


def _join(
    parts: list[tuple[npt.NDArray[np.intp], dict[str, npt.NDArray[Any]]]],
    good: npt.NDArray[np.bool_],
) -> dict[str, npt.NDArray[Any]]:
    """Put the rows of all shapes back into the order of the messages."""
    if not parts:
        return {}
    place = np.cumsum(good) - 1  # row among all messages -> row among the good ones
    result: dict[str, npt.NDArray[Any]] = {}
    for name, sample in parts[0][1].items():
        pieces = [part[name] for _, part in parts]
        ragged = _are_ragged(pieces)
        column = (
            np.empty(int(good.sum()), dtype=object)
            if ragged
            else np.empty((int(good.sum()), *sample.shape[1:]), dtype=sample.dtype)
        )
        for (rows, _), piece in zip(parts, pieces, strict=True):
            if ragged:
                for row, value in zip(place[rows], piece, strict=True):
                    column[row] = value
            else:
                column[place[rows]] = piece
        result[name] = column
    return result


def appended(parts: list[dict[str, npt.NDArray[Any]]]) -> dict[str, npt.NDArray[Any]]:
    """The columns of several lots of messages, one lot after the other; takes ``parts`` apart."""
    parts = [part for part in parts if part]
    result: dict[str, npt.NDArray[Any]] = {}
    for name in list(parts[0]) if parts else ():
        pieces = [part.pop(name) for part in parts]
        if not _are_ragged(pieces):
            result[name] = np.concatenate(pieces)
            continue
        result[name] = np.empty(sum(map(len, pieces)), dtype=object)
        for k, row in enumerate(row for piece in pieces for row in piece):
            result[name][k] = row
    return result


def _are_ragged(pieces: list[npt.NDArray[Any]]) -> bool:
    return len({(piece.shape[1:], piece.dtype == object) for piece in pieces}) > 1
