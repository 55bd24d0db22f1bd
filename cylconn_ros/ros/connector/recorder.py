"""Recording switch of the node: start, write, stop; a failure never stops the samples."""

from __future__ import annotations

import contextlib
import datetime
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.metadata import TopicInfo

# A node that does not record also runs where these packages are not installed. They are not loaded
# when a recording starts: that would hold up the samples.
_MISSING = ""
try:
    from cylconn_ros.recording.writer import RunWriter
except ImportError as error:
    _MISSING = f"needs the package {error.name}: pip install mcap zstandard"


class Recorder:
    """Record while a run is open; a failure to write is stored and counted, not raised.

    ``permitted``: directory in or below which runs may be created; None: any.
    """

    def __init__(self, permitted: Path | None = None, lock: Any = None) -> None:
        """``lock`` is held by the threads that write, and here while a run is closed."""
        self._lock = lock or contextlib.nullcontext()
        self._permitted = None if permitted is None else permitted.expanduser().resolve()
        self._writer: RunWriter | None = None
        self._error = ""
        self._lost = 0  # not recorded, and not counted by the writer of the open run
        self.directory: Path | None = None  # of this or the last run

    @property
    def running(self) -> bool:
        """True while a run is open."""
        return self._writer is not None

    @property
    def writer(self) -> RunWriter | None:
        """Writer of the open run, to whose chunk buffer compiled code appends."""
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
        """Messages that were not recorded."""
        return self._lost + (sum(self._writer.lost.values()) if self._writer is not None else 0)

    def check(self, directory: str | Path) -> Path:
        """Resolve ``directory``; raise RecordingError if runs may not be created there."""
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

        Raises RecordingError if the directory cannot be created, a run is open, or a package that
        recordings need is not installed.
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
            if _MISSING:
                raise RecordingError(_MISSING)
            self._writer = RunWriter(directory, topics, metadata, compression, wait_for_disk=False)
        except (RecordingError, OSError) as error:
            self._error = f"cannot record: {error}"
            raise RecordingError(self._error) from None
        self.directory = self._writer.directory.absolute()
        self._error, self._lost = "", 0
        return self.directory

    def write(self, topic: str, data: bytes, time_ns: int) -> None:
        """Record a message, if a run is open; ``time_ns``: time of reception or publication."""
        writer = self._writer
        if writer is None:
            return
        channel = writer.channels.get(topic, 0)
        if channel:
            writer.append(channel, data, time_ns, time_ns)  # counts the messages that it refuses
        else:
            self._error = f"topic {topic} is not part of this recording"
            self._lost += 1

    def stop(self) -> str:
        """Close the run; return a summary. Raises RecordingError if closing fails."""
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
    """Time of day in ns: the clock of recordings."""
    return time.time_ns()
