"""Recordings in SQLite, as ROS 2 wrote them before Jazzy: read only."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from cylconn_ros.recording.message_block import Block, Found, of_messages

SUFFIX = ".db3"
_ROWS = 2000  # that are read at once


class Topics(dict[int, str]):
    """Topics by the number of their channel; one that nothing describes has a name, too."""

    def __missing__(self, channel: int) -> str:
        """Name it."""
        return f"(channel {channel}, not described)"


def topics(file: Path) -> list[tuple[str, str]]:
    """Name and type of every topic, by the number of its channel; may raise sqlite3.Error."""
    with closing(_database(file)) as database:
        return list(database.execute("SELECT name, type FROM topics ORDER BY id"))


def messages(file: Path) -> Iterator[tuple[Topics, Block, float]]:
    """Messages by the block, and the share of them that has been read; may raise sqlite3.Error."""
    with closing(_database(file)) as database:
        rows = list(database.execute("SELECT id, name FROM topics ORDER BY id"))
        numbers = {topic: k for k, (topic, _) in enumerate(rows)}  # of the database: any
        names = Topics(enumerate(name for _, name in rows))
        (count,) = database.execute("SELECT COUNT(*) FROM messages").fetchone()
        found = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        done = 0
        while part := found.fetchmany(_ROWS):
            done += len(part)
            some = [Found(numbers[topic], time, time, bytes(data)) for topic, time, data in part]
            yield names, of_messages(some), done / count


def _database(file: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)
