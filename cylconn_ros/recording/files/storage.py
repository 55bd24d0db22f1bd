"""What every storage format of a recording offers: channels, places of messages, their times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from cylconn_ros.recording.mcap.message_block import MessageBlock


class Unit(NamedTuple):
    """A part of a file that is read at once.

    Attributes
    ----------
        begin, end: its bytes in the file.
        first, last: least and greatest log time of its messages, ns.
        size: bytes of its messages, uncompressed.
        chunk: whether it is an MCAP chunk.
    """

    begin: int
    end: int
    first: int
    last: int
    size: int
    chunk: bool = True


@dataclass
class StoredChannel:
    """A channel of a file; ``reason`` says why its messages cannot be decoded, if they cannot."""

    topic: str
    type: str = ""  # package/msg/Name
    definition: str = ""  # ros2msg text, empty if the file has none
    definition_encoding: str = "ros2msg"
    type_hash: str = ""
    qos: str = ""  # offered_qos_profiles, YAML
    reason: str = ""


@dataclass
class Extent:
    """Number of messages, and the log times of the first and the last, ns."""

    count: int = 0
    first: int = 0
    last: int = 0

    def add(self, count: int, first: int, last: int) -> None:
        """Include messages."""
        self.first = min(self.first, first) if self.count else first
        self.last = max(self.last, last) if self.count else last
        self.count += count


@dataclass
class Contents:
    """Index of a file, made by reading it once.

    Attributes
    ----------
        channels: by number in the file.
        extents: messages of each channel, also of channels that the file does not define.
        units: parts that contain messages, in file order.
        metadata: texts that cylconn_ros stored.
        damage: descriptions of what cannot be read.
        finished: whether the file has its end.
    """

    channels: dict[int, StoredChannel] = field(default_factory=dict)
    extents: dict[int, Extent] = field(default_factory=dict)
    units: list[Unit] = field(default_factory=list)
    metadata: dict[str, str] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    finished: bool = True

    def count(self, block: MessageBlock) -> None:
        """Include the messages of a block in ``extents``."""
        for number in np.unique(block.channel).tolist():
            times = block.log_time[block.channel == number]
            extent = self.extents.setdefault(int(number), Extent())
            extent.add(len(times), int(times.min()), int(times.max()))


class StorageFile(Protocol):
    """A file of a recording."""

    def contents(self) -> Contents:
        """Read the file once."""

    def load(self, unit: Unit, begin: int, end: int) -> Iterator[MessageBlock]:
        """Yield the messages with ``begin`` <= log time < ``end`` (ns), in order of log time.

        Raises OSError; what is damaged is left out, and is in the damage of the contents.
        """

    def close(self) -> None:
        """Release what the file holds."""


class Topics(dict[int, str]):
    """Topic names by channel number; a channel without definition gets a placeholder name."""

    def __missing__(self, channel: int) -> str:
        """Return the placeholder."""
        return f"(channel {channel}, not described)"


Custom = dict[str, Any]
