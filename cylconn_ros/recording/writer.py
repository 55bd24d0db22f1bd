"""Write a run as a rosbag2 directory: one MCAP file (profile ros2) and its metadata.yaml.

Who writes a message only lays it into a buffer. A thread of the run's own takes the buffer every
:data:`INTERVAL`, compresses it and puts it on disk: long work, and nearly all of it in calls that
let other threads go on. A killed process loses what came within about two intervals.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from .container import COMPRESSIONS, INDEX_ENTRY, MESSAGE, MESSAGE_REST, Container
from .errors import RecordingError
from .interfaces import Interface, interface
from .metadata import TopicInfo, bag_information, to_yaml

METADATA_RECORD = "cylconn_ros"  # MCAP metadata record holding parameters, version, method

INTERVAL = 0.04
"""Seconds between chunks."""

_CHUNK = 1 << 20  # bytes after which a chunk does not wait for its time
_BACKLOG = 1 << 26  # bytes that may wait for a slow disk
_OPCODE = 0x05  # of a message
_head, _entry, _REST = MESSAGE.pack, INDEX_ENTRY.pack, MESSAGE_REST


class _Buffer:
    """Messages that wait to become a chunk."""

    def __init__(self, streams: Iterable[_Stream]) -> None:
        self.records = bytearray()
        self.index: dict[int, bytearray] = {}
        for stream in streams:
            self.index[stream.channel] = stream.index = bytearray()


class _Stream:
    """A topic: its channel, its next sequence number, its entries in the open buffer's index."""

    __slots__ = ("channel", "index", "sequence", "topic")

    def __init__(self, topic: str, channel: int) -> None:
        self.topic, self.channel = topic, channel
        self.sequence = 0
        self.index = bytearray()


class RunWriter:
    """Record serialised messages of known topics; a context manager.

    The directory must not exist: a run is never overwritten. Messages are stored byte for byte.
    ``write`` and ``close`` may be called from different threads.

    Attributes
    ----------
        directory: the rosbag2 directory.
        counts: messages accepted, per topic; without those the disk then refused.
        lost: messages refused since the recording failed or was closed, by the disk, or because it
            was too slow, per topic.
        failure: why the recording failed, or None.
    """

    def __init__(
        self,
        directory: Path,
        topics: Sequence[TopicInfo],
        metadata: Mapping[str, str],
        compression: str = "zstd",
        *,
        interfaces: Mapping[str, Interface] | None = None,
        patient: bool = True,
    ) -> None:
        """Create ``directory`` and open the file.

        Args:
            directory: the run to create; parents are made as needed.
            topics: everything that may be written, each name once.
            metadata: texts kept with the run: ``version``, ``method``, ``parameters`` (a scene
                file as YAML), … They go into an MCAP metadata record and into metadata.yaml.
            compression: ``zstd`` or ``none``.
            interfaces: definitions by type; by default those that are installed.
            patient: wait where the disk is slower than the messages come; otherwise a message that
                finds 64 MiB waiting is refused.

        Raises
        ------
            RecordingError: the directory exists or cannot be made, a topic is given twice, a type
                is not installed, or the compression is unknown.
        """
        if compression not in COMPRESSIONS:
            choices = ", ".join(COMPRESSIONS)
            raise RecordingError(f"record.compression: {compression!r} is not one of {choices}")
        names = [topic.name for topic in topics]
        for name in names:
            if names.count(name) > 1:
                raise RecordingError(f"topic {name} is listed more than once")
        defined = interfaces or {topic.type: interface(topic.type) for topic in topics}
        found = {topic.type: defined[topic.type] for topic in topics}

        self.directory = Path(directory)
        self.counts = dict.fromkeys(names, 0)
        self.lost = dict.fromkeys(names, 0)
        self.failure: str | None = None
        self._topics = tuple(topics)
        self._metadata = {str(key): str(value) for key, value in metadata.items()}
        self._hashes = {name: known.type_hash for name, known in found.items()}
        self._start, self._end = 1 << 64, 0  # log times of the chunks on disk, ns
        self._patient = patient
        self._open = True
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError:
            raise RecordingError(f"{self.directory} exists; a run is never overwritten") from None
        except OSError as error:
            raise RecordingError(f"{self.directory}: {error.strerror or error}") from error
        self._path = self.directory / f"{self.directory.name}_0.mcap"
        try:
            self._file = Container(self._path, compression)
            self._file.add_metadata(METADATA_RECORD, self._metadata)
            self._streams = self._register(found)
        except OSError as error:
            raise RecordingError(f"{self._path}: {error.strerror or error}") from error
        self._buffer = _Buffer(self._streams.values())
        self._refusing = False  # failed or closed
        self._lock = threading.Lock()  # of the buffer, the counts and the reasons to refuse
        self._wake = threading.Event()  # the thread shall not wait for the end of its interval
        self._thread = threading.Thread(target=self._work, name="recording", daemon=True)
        self._thread.start()

    def _register(self, interfaces: Mapping[str, Interface]) -> dict[str, _Stream]:
        schemas = {
            found.type: self._file.add_schema(found.type, found.definition)
            for found in interfaces.values()
        }
        streams = {}
        for topic in self._topics:
            channel = self._file.add_channel(
                topic.name,
                schemas[topic.type],
                {
                    "offered_qos_profiles": to_yaml(topic.qos()),
                    "topic_type_hash": self._hashes[topic.type],
                },
            )
            streams[topic.name] = _Stream(topic.name, channel)
        return streams

    def write(self, topic: str, cdr: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append one message.

        Args:
            topic: one of the topics given at construction.
            cdr: the serialised message, encapsulation header included.
            log_time_ns: when it was received or published, ns since the epoch.
            publish_time_ns: when its publisher sent it, ns since the epoch.

        Raises
        ------
            RecordingError: unknown topic, closed recording, or the file cannot take it. After a
                failure every further call raises and counts the message in ``lost``. What the disk
                refuses is known within :data:`INTERVAL`, not in the same call.
        """
        with self._lock:
            stream = self._streams.get(topic)
            if stream is None:
                known = ", ".join(self.counts)
                raise RecordingError(f"topic {topic} is not recorded here (only {known})")
            records = self._buffer.records
            at = len(records)
            if at > _CHUNK:
                at = self._hurry(stream)
                records = self._buffer.records
            if self._refusing:
                raise self._refuse(stream)
            records += _head(
                _OPCODE, _REST + len(cdr), stream.channel, stream.sequence, log_time_ns,
                publish_time_ns,
            )  # fmt: skip
            records += cdr
            stream.index += _entry(log_time_ns, at)
            stream.sequence += 1
            self.counts[topic] += 1

    def _hurry(self, stream: _Stream) -> int:
        """Have the buffer written now; its size. Raises RecordingError where too much waits."""
        self._wake.set()
        while len(self._buffer.records) > _BACKLOG and not self._refusing:
            if not self._patient:
                self.lost[stream.topic] += 1
                raise RecordingError(
                    f"{self._path}: the disk is too slow: {_BACKLOG >> 20} MiB wait for it"
                )
            self._lock.release()
            try:
                time.sleep(0.01)
            finally:
                self._lock.acquire()
        return len(self._buffer.records)

    def _refuse(self, stream: _Stream) -> RecordingError:
        self.lost[stream.topic] += 1
        return RecordingError(self.failure or f"{self.directory}: recording is closed")

    def _work(self) -> None:
        """Put chunks on disk until the recording is closed or fails."""
        while not self._refusing:
            self._wake.wait(INTERVAL)
            self._wake.clear()
            self._flush()

    def _flush(self) -> None:
        with self._lock:
            full, self._buffer = self._buffer, _Buffer(self._streams.values())
        if not full.records or self.failure is not None:
            return
        try:
            times = [np.frombuffer(e, "<u8")[::2] for e in full.index.values() if e]
            start = min(int(column.min()) for column in times)
            end = max(int(column.max()) for column in times)
            self._file.add_chunk(full.records, full.index, start, end)
        except Exception as error:  # whatever the disk or the library says, the program goes on
            self._fail(error, full)
        else:
            self._start, self._end = min(self._start, start), max(self._end, end)

    def _fail(self, error: Exception, chunk: _Buffer | None = None) -> RecordingError:
        """Refuse everything from now on; what has not reached the disk is lost."""
        reason = getattr(error, "strerror", None) or repr(error)
        with self._lock:
            self.failure = f"{self._path}: {reason}"
            self._refusing = True
            for buffer in (chunk, self._buffer) if chunk is not None else (self._buffer,):
                for stream in self._streams.values():
                    count = len(buffer.index[stream.channel]) // INDEX_ENTRY.size
                    self.counts[stream.topic] -= count
                    self.lost[stream.topic] += count
            self._buffer = _Buffer(self._streams.values())
        return RecordingError(self.failure)

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        Raises
        ------
            RecordingError: something could not be written. metadata.yaml is written if it can be,
                and says under ``custom_data: incomplete`` what went wrong.
        """
        with self._lock:
            if not self._open:
                return
            self._open, self._refusing = False, True
        self._wake.set()
        self._thread.join()
        self._flush()
        failure = RecordingError(self.failure) if self.failure is not None else None
        try:  # also after a failure: the file then ends with its last whole chunk
            self._file.add_metadata("rosbag2", {"serialized_metadata": self._bag_yaml()})
            self._file.finish()
        except Exception as error:
            failure = failure or self._fail(error)
        try:
            self._file.close()
        except OSError as error:
            failure = failure or self._fail(error)
        try:
            self._write_metadata_file()
        except OSError as error:
            failure = failure or self._fail(error)
        if failure is not None:
            raise failure

    def _bag_information(self) -> dict[str, object]:
        custom = dict(self._metadata)
        if self.failure is not None:
            custom["incomplete"] = self.failure
        none = not any(self.counts.values())
        return bag_information(
            self._path.name,
            self._topics,
            self._hashes,
            self.counts,
            0 if none else self._start,
            self._end,
            custom,
        )

    def _bag_yaml(self) -> str:
        return to_yaml(self._bag_information())

    def _write_metadata_file(self) -> None:
        path = self.directory / "metadata.yaml"
        draft = path.with_name("metadata.yaml.part")
        text = to_yaml({"rosbag2_bagfile_information": self._bag_information()})
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)  # a reader sees the whole file or none

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except RecordingError:
            if exc is None:  # never hide the error that ended the block
                raise
