"""Write a run as a rosbag2 directory: one MCAP file (profile ros2) and its metadata.yaml.

Who writes a message only puts it into a queue. A thread of the run's own empties the queue every
:data:`INTERVAL`, makes a chunk of it, compresses that and puts it on disk; it lets others go on
after every few messages, and what takes long is done without the interpreter's lock. A killed
process loses what came within about one interval.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from .container import COMPRESSIONS, INDEX_ENTRY, MESSAGE, MESSAGE_REST, Container
from .errors import RecordingError
from .interfaces import Interface, interface
from .metadata import TopicInfo, bag_information, to_yaml

METADATA_RECORD = "cylconn_ros"  # MCAP metadata record holding parameters, version, method

INTERVAL = 0.08
"""Seconds between chunks."""

_CHUNK = 1 << 20  # bytes of messages after which a chunk does not wait for its time
_SLICE = 32  # pieces of the queue laid out in one go, for some hundred microseconds
_PAUSE = 2e-5  # s between slices: after none, who waits for the interpreter may wait for 5 ms
_BACKLOG = 1 << 26  # bytes that may wait for a slow disk
_OPCODE = 0x05  # of a message
_head, _entry, _REST = MESSAGE.pack, INDEX_ENTRY.pack, MESSAGE_REST


Message = tuple[str, bytes, int, int]
"""Topic, bytes, log time and publish time (ns)."""


class _Stream:
    """A topic: its channel, and what became of its messages."""

    __slots__ = ("accepted", "channel", "lost", "refused", "sequence", "topic")

    def __init__(self, topic: str, channel: int) -> None:
        self.topic, self.channel = topic, channel
        self.sequence = 0  # of the next in the file
        self.accepted = 0
        self.refused = 0  # not accepted
        self.lost = 0  # accepted, but the disk then refused them


class _Chunk:
    """Messages as they will stand in the file."""

    def __init__(self, channels: Iterable[int]) -> None:
        self.records = bytearray()
        self.index = {channel: bytearray() for channel in channels}

    def times(self) -> tuple[int, int]:
        """The first and the last log time, ns."""
        entries = np.frombuffer(b"".join(self.index.values()), "<u8")[::2]
        return int(entries.min()), int(entries.max())


class RunWriter:
    """Record serialised messages of known topics; a context manager.

    The directory must not exist: a run is never overwritten. Messages are stored byte for byte.
    ``write`` and ``close`` may be called from different threads.

    Attributes
    ----------
        directory: the rosbag2 directory.
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
        self._queue: deque[Sequence[Message]] = deque()
        self._came = self._gone = 0  # bytes of messages that came into the queue, and left it
        self._refusing = False  # failed or closed
        self._lock = threading.Lock()  # of the end of the recording
        self._wake = threading.Event()  # the thread shall not wait for the end of its interval
        self._thread = threading.Thread(target=self._work, name="recording", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> dict[str, int]:
        """Messages accepted, per topic; without those that the disk then refused."""
        return {topic: s.accepted - s.lost for topic, s in self._streams.items()}

    @property
    def lost(self) -> dict[str, int]:
        """Messages refused, per topic: by the disk, because it was too slow, or after the end."""
        return {topic: s.refused + s.lost for topic, s in self._streams.items()}

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
        self.write_all([(topic, cdr, log_time_ns, publish_time_ns)])

    def write_all(self, messages: Sequence[Message]) -> None:
        """Append messages, all of them or none; as :meth:`write` does, and may raise."""
        streams = self._streams
        try:
            if self._came - self._gone > _CHUNK:
                self._hurry()
            if self._refusing:
                raise RecordingError(self.failure or f"{self.directory}: recording is closed")
            for topic, data, _, _ in messages:
                streams[topic].accepted += 1
                self._came += len(data)
        except KeyError as unknown:
            for topic, data, _, _ in messages:
                if topic not in streams:
                    break
                streams[topic].accepted -= 1
                self._came -= len(data)
            known = ", ".join(streams)
            raise RecordingError(
                f"topic {unknown.args[0]} is not recorded here (only {known})"
            ) from None
        except RecordingError:
            for topic, _, _, _ in messages:
                streams[topic].refused += 1
            raise
        self._queue.append(messages)

    def _hurry(self) -> None:
        """Have the queue written now; raises RecordingError where too much waits."""
        self._wake.set()
        while self._came - self._gone > _BACKLOG and not self._refusing:
            if not self._patient:
                raise RecordingError(
                    f"{self._path}: the disk is too slow: {_BACKLOG >> 20} MiB wait for it"
                )
            time.sleep(0.01)

    def _work(self) -> None:
        """Put chunks on disk until the recording is closed or fails."""
        while not self._refusing:
            self._wake.wait(INTERVAL)
            self._wake.clear()
            self._flush()

    def _flush(self) -> None:
        """Empty the queue."""
        queue, take, streams = self._queue, self._queue.popleft, self._streams
        channels = [stream.channel for stream in self._streams.values()]
        while queue and self.failure is None:
            chunk, size = _Chunk(channels), 0
            records, index = chunk.records, chunk.index
            try:
                while queue and size <= _CHUNK:
                    for _ in range(min(len(queue), _SLICE)):
                        for topic, data, log_time, publish_time in take():
                            stream, length = streams[topic], len(data)
                            channel = stream.channel
                            index[channel] += _entry(log_time, len(records))
                            records += _head(
                                _OPCODE, _REST + length, channel, stream.sequence, log_time,
                                publish_time,
                            )  # fmt: skip
                            records += data
                            stream.sequence += 1
                            size += length
                    if queue:
                        time.sleep(_PAUSE)
                start, end = chunk.times()
                self._file.add_chunk(records, index, start, end)
            except Exception as error:  # whatever the disk or the library says, others go on
                self._fail(error, chunk)
            else:
                self._start, self._end = min(self._start, start), max(self._end, end)
            self._gone += size

    def _fail(self, error: Exception, chunk: _Chunk | None = None) -> RecordingError:
        """Refuse everything from now on; what has not reached the disk is lost."""
        reason = getattr(error, "strerror", None) or repr(error)
        self.failure = f"{self._path}: {reason}"
        self._refusing = True
        if chunk is not None:
            for stream in self._streams.values():
                stream.lost += len(chunk.index[stream.channel]) // INDEX_ENTRY.size
        self._drop_queue()
        return RecordingError(self.failure)

    def _drop_queue(self) -> None:
        while self._queue:
            for topic, _, _, _ in self._queue.popleft():
                self._streams[topic].lost += 1

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
        self._drop_queue()  # of a recording that failed
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
