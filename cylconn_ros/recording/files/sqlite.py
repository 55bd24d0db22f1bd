"""Reader of SQLite storage (.db3), the rosbag2 default before Iron."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.files.storage import Contents, Extent, StoredChannel, Unit
from cylconn_ros.recording.mcap.message_block import MessageBlock, RawMessage, from_messages

_ROWS = 2000  # read at once
_MAX_TIME = (1 << 63) - 1
_TIMES = "timestamp BETWEEN ? AND ?"
# A table, not a view: a view computes what it likes for as long as it likes.
_TABLES = "SELECT name FROM sqlite_master WHERE type = 'table'"


class SqliteFile:
    """An SQLite file of rosbag2: tables ``topics``, ``messages``, later ``message_definitions``."""

    def __init__(self, path: Path, name: Path | None = None) -> None:
        """Open ``path``; ``name`` is the one in messages, by default the same."""
        self._path = name or path
        self._connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
        self._connection.text_factory = lambda text: text.decode("utf-8", errors="replace")
        self._numbers: dict[int, int] = {}  # channel number by id in the file, which is arbitrary
        self._found = Contents()

    def close(self) -> None:
        """Close the database."""
        self._connection.close()

    def contents(self) -> Contents:
        """Read the index of the file (recording/files/storage.py).

        Raises RecordingError if it is not a database of rosbag2.
        """
        found = self._found
        try:
            tables = {name for (name,) in self._rows(_TABLES)}
            if not {"topics", "messages"} <= tables:
                raise RecordingError(
                    f"{self._path}: an SQLite database without the tables of rosbag2, topics and "
                    "messages"
                )
            self._read_topics("message_definitions" in tables)
            self._read_extents()
        except sqlite3.Error as error:
            if not self._numbers:
                raise RecordingError(f"{self._path}: not a readable recording: {error}") from None
            self._damaged(error)
        return found

    def load(self, unit: Unit, begin: int, end: int) -> Iterator[MessageBlock]:
        """Yield messages; see :class:`~cylconn_ros.recording.files.storage.StorageFile`."""
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE {_TIMES} " \
            "ORDER BY timestamp, rowid"  # fmt: skip
        limits = max(begin, 0), min(end - 1, _MAX_TIME)
        part: list[RawMessage] = []
        try:
            for topic_id, time, data in self._rows(query, *limits):
                if isinstance(time, int) and isinstance(data, bytes):
                    number = self._numbers.get(topic_id, len(self._numbers))
                    part.append(RawMessage(number, time, time, data))
                if len(part) == _ROWS:
                    yield from_messages(part)
                    part = []
        except sqlite3.Error as error:
            self._damaged(error)
        if part:
            yield from_messages(part)

    def _rows(self, query: str, *values: object) -> Iterator[tuple[Any, ...]]:
        return iter(self._connection.execute(query, values))

    def _read_topics(self, has_definitions: bool) -> None:
        columns = {name for _, name, *_ in self._rows("PRAGMA table_info(topics)")}
        optional = [
            name if name in columns else "''"
            for name in ("serialization_format", "offered_qos_profiles", "type_description_hash")
        ]
        query = f"SELECT id, name, type, {', '.join(optional)} FROM topics ORDER BY id"
        definitions: dict[str, tuple[str, str]] = {}
        if has_definitions:
            rows = self._rows(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
            definitions = {str(kind): (str(code), str(text)) for kind, code, text in rows}
        for number, (topic_id, name, kind, form, qos, type_hash) in enumerate(self._rows(query)):
            self._numbers[topic_id] = number
            encoding, text = definitions.get(str(kind), ("ros2msg", ""))
            channel = StoredChannel(str(name), str(kind), text, encoding, str(type_hash), str(qos))
            if form and form != "cdr":
                channel.reason = f"its messages are {form}, not cdr"
            self._found.channels[number] = channel

    def _read_extents(self) -> None:
        found, first, last = self._found, _MAX_TIME, 0
        rows = self._rows(
            "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages "
            f"WHERE typeof(timestamp) = 'integer' AND typeof(data) = 'blob' AND {_TIMES} "
            "GROUP BY topic_id",
            0,
            _MAX_TIME,
        )
        for topic_id, count, low, high in rows:
            number = self._numbers.get(topic_id, len(self._numbers))
            found.extents.setdefault(number, Extent()).add(count, low, high)
            first, last = min(first, low), max(last, high)
        (total,) = next(self._rows("SELECT COUNT(*) FROM messages"))
        others = total - sum(extent.count for extent in found.extents.values())
        if others:
            found.damage.append(f"{others} rows are no messages with a time")
        if found.extents:
            size = self._path.stat().st_size
            found.units.append(Unit(0, size, first, last, size, False))

    def _damaged(self, error: sqlite3.Error) -> None:
        text = str(error)
        if text not in self._found.damage:
            self._found.damage.append(text)
