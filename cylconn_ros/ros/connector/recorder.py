"""The node's side of recording: which topics, where to, and never in the way of an answer."""

from __future__ import annotations

import contextlib
import datetime
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.writer import RunWriter


class Recorder:
    """Record while a run is open; a failure is kept in words and counted, never raised.

    ``permitted`` is the directory that runs may be put in or below; None: any.
    """

    def __init__(self, permitted: Path | None = None, lock: Any = None) -> None:
        """``lock`` is held by whoever writes, and here while a run is taken away from them."""
        self._lock = lock or contextlib.nullcontext()
        self._permitted = None if permitted is None else permitted.expanduser().resolve()
        self._writer: RunWriter | None = None
        self._error = ""
        self._lost = 0  # not recorded, and not known to the writer of the open run
        self.directory: Path | None = None  # of this or the last run

    @property
    def running(self) -> bool:
        """Whether a run is open."""
        return self._writer is not None

    @property
    def writer(self) -> RunWriter | None:
        """What writes the open run, for compiled code to put messages in (see there)."""
        return self._writer

    @property
    def recorded(self) -> int:
        """Messages in the open run."""
        return 0 if self._writer is None else sum(self._writer.counts.values())

    @property
    def failure(self) -> str:
        """The last failure of this or the last run, or of the attempt to open one."""
        writer = self._writer
        return (writer and (writer.failure or writer.refusal)) or self._error

    @property
    def lost(self) -> int:
        """Messages not recorded because of it."""
        return self._lost + (sum(self._writer.lost.values()) if self._writer is not None else 0)

    def check(self, directory: str | Path) -> Path:
        """Where ``directory`` is, if runs may be put there; otherwise raises RecordingError."""
        path = Path(directory).expanduser().resolve()
        if self._permitted is not None and self._permitted not in (path, *path.parents):
            raise RecordingError(
                f"record.directory = {str(directory)!r}: must be {self._permitted}, which was "
                "given when the node started, or below it"
            )
        return path

    def start(
        self,
        parent: str | Path,
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
        try:
            place = self.check(parent)
            directory, again = place / name, 1
            while directory.exists():  # two runs within a second
                again += 1
                directory = place / f"{name}_{again}"
            self._writer = RunWriter(directory, topics, metadata, compression, patient=False)
        except (RecordingError, OSError) as error:
            self._error = f"cannot record: {error}"
            raise RecordingError(self._error) from None
        self.directory = self._writer.directory.absolute()
        self._error, self._lost = "", 0
        return self.directory

    def write(self, topic: str, data: bytes, time_ns: int) -> None:
        """Record a message, if a run is open; ``time_ns`` is when it came or went."""
        writer = self._writer
        if writer is None:
            return
        channel = writer.channels.get(topic, 0)
        if channel:
            writer.put(channel, data, time_ns, time_ns)  # which counts what it refuses
        else:
            self._error = f"topic {topic} is not recorded here"
            self._lost += 1

    def stop(self) -> str:
        """Close the run and say what it holds; raises RecordingError where closing fails."""
        with self._lock:
            writer, self._writer = self._writer, None
        if writer is None:
            raise RecordingError("not recording")
        try:
            writer.close()
        except RecordingError as error:
            self._error = str(error)
            raise
        finally:
            self._lost += sum(writer.lost.values())
        return f"recorded {sum(writer.counts.values())} messages in {self.directory}"


def now() -> int:
    """Time of day in ns, the clock of recordings."""
    return time.time_ns()
