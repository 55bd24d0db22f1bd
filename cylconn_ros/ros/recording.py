"""The node's side of recording: which topics, where to, and never in the way of an answer."""

from __future__ import annotations

import datetime
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from cylconn_ros.recording.errors import RecordingError
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.writer import RunWriter


class Recorder:
    """Record while a run is open; a failure is kept in words and counted, never raised."""

    def __init__(self) -> None:
        self._writer: RunWriter | None = None
        self.failure = ""  # the last failure of this or the last run
        self.lost = 0  # messages not recorded because of it
        self.directory: Path | None = None  # of this or the last run

    @property
    def running(self) -> bool:
        """Whether a run is open."""
        return self._writer is not None

    @property
    def recorded(self) -> int:
        """Messages in the open run."""
        return 0 if self._writer is None else sum(self._writer.counts.values())

    def start(
        self,
        parent: Path,
        node_name: str,
        topics: Sequence[TopicInfo],
        metadata: Mapping[str, str],
        compression: str,
    ) -> Path:
        """Open a run in a new directory below ``parent``, named by node and time; return it.

        Raises RecordingError where that cannot be done or a run is open.
        """
        if self._writer is not None:
            raise RecordingError(f"already recording to {self.directory}")
        now = datetime.datetime.now(datetime.timezone.utc)
        name = f"{node_name}_{now:%Y%m%dT%H%M%S}"
        directory, again = parent / name, 1
        while directory.exists():  # two runs within a second
            again += 1
            directory = parent / f"{name}_{again}"
        self._writer = RunWriter(directory, topics, metadata, compression)
        self.directory = self._writer.directory.absolute()
        self.failure, self.lost = "", 0
        return self.directory

    def write(self, topic: str, data: bytes, time_ns: int) -> None:
        """Record a message if a run is open; ``time_ns`` is when it came or went."""
        if self._writer is None:
            return
        try:
            self._writer.write(topic, data, time_ns, time_ns)
        except RecordingError as error:
            self.failure = str(error)
            self.lost += 1

    def stop(self) -> str:
        """Close the run and say what it holds; raises RecordingError where closing fails."""
        if self._writer is None:
            raise RecordingError("not recording")
        writer, self._writer = self._writer, None
        try:
            writer.close()
        except RecordingError as error:
            self.failure = str(error)
            raise
        return f"recorded {sum(writer.counts.values())} messages in {self.directory}"


def now() -> int:
    """Time of day in ns, the clock of recordings."""
    return time.time_ns()
