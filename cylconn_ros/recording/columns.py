"""Decoder from CDR messages of one type to one NumPy array per field.

The offset of a field in CDR depends only on the lengths of the strings and sequences before it. A
run repeats a few such layouts thousands of times. So one message of each layout is parsed with its
schema, and the others of that layout are read as strided views, without Python code per message.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.mcap.message_block import MessageBlock, RawMessage, from_messages
from cylconn_ros.recording.schema import PRIMITIVES, Schema

# Encapsulation header: byte 1 is 0 for big and 1 for little endian (plain CDR, no parameter lists).
HEADER_BYTES = 4


@dataclass
class _Layout:
    """Offsets of the fields of a message, from the start of its bytes.

    Attributes
    ----------
        numbers: offset, NumPy type and array length (None: a single value) by field.
        strings: offset and length of a string, or of each in an array, by field.
        lengths: offset and value of each length prefix.
    """

    numbers: dict[str, tuple[int, str, int | None]] = field(default_factory=dict)
    strings: dict[str, list[tuple[int, int]] | tuple[int, int]] = field(default_factory=dict)
    lengths: list[tuple[int, int]] = field(default_factory=list)


class _Parser:
    """Parse one message with its schema and store the offset of every field."""

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
        if not members:  # an empty message has one byte
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
                self.layout.numbers[name] = (offset, self.order + code, kept)
            elif member.type == "string":
                found = [self._string() for _ in range(count)]
                self.layout.strings[name] = found if member.is_array else found[0]
            elif member.is_array:
                raise RecordingError(f"field {name} is a list of messages: no columns for it")
            else:
                self.message(member.type, f"{name}.")

    def finish(self) -> _Layout:
        # rclpy adds padding at the end: the alignment that it reserves for empty sequences.
        if len(self.data) - self.at >= 8 * (1 + self.sequences):
            raise RecordingError(f"{len(self.data) - self.at} bytes more than its type has")
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
        return offset, max(length - 1, 0)  # without the terminating zero


def has_columns(schema: Schema, type_name: str) -> bool:
    """Return whether messages of a type can become columns: it has no lists of messages."""
    nested = [m for m in schema[type_name] if m.type not in PRIMITIVES and m.type != "string"]
    return all(not m.is_array and has_columns(schema, m.type) for m in nested)


def columns(
    schema: Schema, type_name: str, messages: Sequence[bytes]
) -> tuple[dict[str, npt.NDArray[Any]], npt.NDArray[np.bool_]]:
    """Decode messages of one type.

    Args:
        schema: from :func:`schema.parse`.
        type_name: ``package/Name``.
        messages: n serialized messages.

    Returns
    -------
        Columns by field name, ``a.b`` for nested fields: arrays of shape (n_ok,) or (n_ok, k),
        strings as objects. If rows differ in length, the column holds one array per row. And a mask
        (n,) of the n_ok messages that could be decoded; a recording may contain malformed messages
        of a broken publisher.

    Raises RecordingError for types with lists of messages, which have no columns.
    """
    return of_block(schema, type_name, from_messages([RawMessage(0, 0, 0, m) for m in messages]))


def of_block(
    schema: Schema,
    type_name: str,
    block: MessageBlock,
    which: npt.NDArray[np.intp] | None = None,
    fields: Collection[str] | None = None,
) -> tuple[dict[str, npt.NDArray[Any]], npt.NDArray[np.bool_]]:
    """Decode messages of a block; see :func:`columns`.

    Args:
        schema, type_name: as of :func:`columns`.
        block: the messages.
        which: (n,) indices of the messages to decode; default: all.
        fields: names of the fields to decode; default: all.
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
            same, part = _one_layout(schema, type_name, table, fields)
            if part is not None:
                parts.append((rows[same], part))
                good[rows[same]] = True
            rows, table = rows[~same], table[~same]
    return _join(parts, good), good


def _one_layout(
    schema: Schema, type_name: str, table: npt.NDArray[np.uint8], fields: Collection[str] | None
) -> tuple[npt.NDArray[np.bool_], dict[str, npt.NDArray[Any]] | None]:
    """Decode all rows with the layout of the first one; return their mask and columns.

    The columns are None if the first row cannot be decoded.
    """
    first = table[0].tobytes()
    try:
        parser = _Parser(schema, first)
        parser.message(type_name)
        layout = parser.finish()
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
    for name, (offset, code, count) in layout.numbers.items():
        if fields is not None and name not in fields:
            continue
        width = np.dtype(code).itemsize * (1 if count is None else count)
        block = np.ascontiguousarray(rows[:, offset : offset + width])
        values = block.view(code) if width else np.empty((len(rows), 0), code)
        values = values.astype(np.dtype(code).newbyteorder("="))
        part[name] = values[:, 0] if count is None else values
    for name, place in layout.strings.items():
        if fields is not None and name not in fields:
            continue
        if isinstance(place, tuple):
            part[name] = _strings(rows, *place)
        else:
            texts = [_strings(rows, *one) for one in place]
            part[name] = np.stack(texts, axis=1) if texts else np.empty((len(rows), 0), object)
    return same, part


def _strings(rows: npt.NDArray[np.uint8], offset: int, length: int) -> npt.NDArray[np.object_]:
    """Decode the string at an offset of every row; each of the few distinct ones only once."""
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
    """Merge the rows of all layouts in the order of the messages."""
    if not parts:
        return {}
    place = np.cumsum(good) - 1  # row among all messages -> row among the decoded ones
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


def concatenate(parts: list[dict[str, npt.NDArray[Any]]]) -> dict[str, npt.NDArray[Any]]:
    """Concatenate the columns of several blocks; empties ``parts`` to save memory."""
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
