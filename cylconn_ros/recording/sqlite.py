"""Reader of SQLite storage (.db3), the rosbag2 default before Jazzy."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from cylconn_ros.recording.mcap.message_block import MessageBlock, RawMessage, from_messages

SUFFIX = ".db3"
_ROWS = 2000  # read at once


class Topics(dict[int, str]):
    """Topic names by channel number; a channel without definition gets a placeholder name."""

    def __missing__(self, channel: int) -> str:
        """Return the placeholder."""
        return f"(channel {channel}, not described)"


def topics(file: Path) -> list[tuple[str, str]]:
    """Return name and type of every topic, by channel number; may raise sqlite3.Error."""
    with closing(_connect(file)) as connection:
        return list(connection.execute("SELECT name, type FROM topics ORDER BY id"))


def messages(file: Path) -> Iterator[tuple[Topics, MessageBlock, float]]:
    """Yield topics, a block of messages, and the share read so far; may raise sqlite3.Error."""
    with closing(_connect(file)) as connection:
        rows = list(connection.execute("SELECT id, name FROM topics ORDER BY id"))
        numbers = {topic_id: k for k, (topic_id, _) in enumerate(rows)}  # ids may be arbitrary
        names = Topics(enumerate(name for _, name in rows))
        (count,) = connection.execute("SELECT COUNT(*) FROM messages").fetchone()
        found = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        done = 0
        while part := found.fetchmany(_ROWS):
            done += len(part)
            block = from_messages([
                RawMessage(numbers[topic_id], time, time, bytes(data))
                for topic_id, time, data in part
            ])  # fmt: skip
            yield names, block, done / count


def _connect(file: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)
