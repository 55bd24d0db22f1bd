"""Recorder of a run: a rosbag2 directory with one MCAP file (profile ros2) and metadata.yaml.

A caller of :class:`RunWriter` copies each message into a chunk buffer
(:mod:`~cylconn_ros.recording.mcap.chunk_buffer`). A thread of the writer rotates the buffer every
:data:`INTERVAL` or when it is full, then compresses its records and writes them as one chunk, while
callers append to another buffer. Compression and the write itself release the GIL. A killed process
loses the messages of about one interval.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.mcap.chunk_buffer import (
    ACCEPTED,
    CHANNEL,
    REFUSED,
    ChunkBuffer,
    MessageArrays,
)
from cylconn_ros.recording.mcap.writer import COMPRESSIONS, McapWriter
from cylconn_ros.recording.message_definitions import Interface, interface
from cylconn_ros.recording.metadata import METADATA_RECORD, TopicInfo, bag_information, to_yaml

INTERVAL = 0.09
"""Seconds between chunks."""

_CHUNK = 1 << 20  # bytes of a chunk buffer; a full one is written before the interval ends
_BACKLOG = 1 << 26  # bytes of buffers that may wait for the disk
_SPARE = 2  # empty buffers that are kept for reuse


class RunWriter:
    """Record serialized messages of known topics; a context manager.

    The directory must not exist: a run is never overwritten. Messages are stored byte for byte.
    ``write``, ``append`` and ``close`` may be called from different threads.

    Compiled code may append, too, without the GIL: the caller holds ``lock``, passes the arrays of
    a reserved chunk buffer to the compiled function, and that function calls
    :func:`~cylconn_ros.recording.mcap.kernels.append` for each message::

        channels = np.array([writer.channels[topic] for topic in topics])  # once per run
        with writer.lock:
            buffer = writer.reserve(messages=8, size=4096)
            compiled(*buffer.arrays, channels, time.time_ns(), ...)

    ``size`` is an upper bound of the messages' total size in bytes. If the writer cannot provide
    the memory, it returns a buffer of size zero; the compiled ``append`` then counts every message
    as refused, and the caller need not check.

    Attributes
    ----------
        directory: the rosbag2 directory.
        failure: why the recording failed, or None.
        refusal: why a message was last refused; empty if none was.
        channels: channel number of each topic in the file.
        lock: to be held while appending to a reserved buffer.
    """

    def __init__(
        self,
        directory: Path,
        topics: Sequence[TopicInfo],
        metadata: Mapping[str, str],
        compression: str = "zstd",
        *,
        interfaces: Mapping[str, Interface] | None = None,
        wait_for_disk: bool = True,
    ) -> None:
        """Create ``directory`` and open the file.

        Args:
            directory: the run to create; missing parents are created.
            topics: all topics that may be written, each name once.
            metadata: texts kept with the run: ``version``, ``method``, ``parameters`` (a scene
                file as YAML), etc. They go into an MCAP metadata record and into metadata.yaml.
            compression: ``zstd`` or ``none``.
            interfaces: message definitions by type; default: the installed ones.
            wait_for_disk: block while more than 64 MiB wait for the disk. If False, messages are
                refused instead.

        Raises
        ------
            RecordingError: the directory exists or cannot be created, a topic is listed twice, a
                type is not installed, or the compression is unknown.
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
        self._wait_for_disk = wait_for_disk
        self._open = True
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError:
            raise RecordingError(f"{self.directory} exists; a run is never overwritten") from None
        except OSError as error:
            raise RecordingError(f"{self.directory}: {error.strerror or error}") from error
        self._path = self.directory / f"{self.directory.name}_0.mcap"
        try:
            self._file = McapWriter(self._path, compression)
            self._file.add_metadata(METADATA_RECORD, self._metadata)
            self._register(found)
        except OSError as error:
            raise RecordingError(f"{self._path}: {error.strerror or error}") from error
        self.channels = {topic.name: channel for channel, topic in enumerate(topics, 1)}
        self.refusal = ""
        self._counts = np.zeros((2, 1 + len(topics)), np.int64)
        self._lost = np.zeros(1 + len(topics), np.int64)  # accepted, then refused by the disk
        self._no_buffer = ChunkBuffer(0, self._counts)
        self._buffer = ChunkBuffer(_CHUNK, self._counts)  # the one being filled
        self._spare = [ChunkBuffer(_CHUNK, self._counts)]
        self._full: deque[ChunkBuffer] = deque()
        self._waiting = 0  # bytes of the buffers that are full or being written
        self._refusing = False  # failed or closed
        self.lock = threading.Lock()
        self._freed = threading.Condition(self.lock)  # a buffer was written, or the writer refuses
        self._wake = threading.Lock()  # released by _notify(): the thread writes at once
        self._wake.acquire()
        self._thread = threading.Thread(target=self._write_chunks, name="recording", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> dict[str, int]:
        """Messages recorded, per topic."""
        return self._by_topic(self._counts[ACCEPTED] - self._lost)

    @property
    def lost(self) -> dict[str, int]:
        """Messages lost, per topic: refused by the disk, by a full backlog, or after the end."""
        return self._by_topic(self._counts[REFUSED] + self._lost)

    def _by_topic(self, counts: np.ndarray) -> dict[str, int]:
        return {topic: int(counts[channel]) for topic, channel in self.channels.items()}

    def _register(self, interfaces: Mapping[str, Interface]) -> None:
        schemas = {
            found.type: self._file.add_schema(found.type, found.definition)
            for found in interfaces.values()
        }
        for topic in self._topics:
            self._file.add_channel(
                topic.name,
                schemas[topic.type],
                {
                    "offered_qos_profiles": to_yaml(topic.qos()),
                    "topic_type_hash": self._hashes[topic.type],
                },
            )

    def write(self, topic: str, cdr: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append one message.

        Args:
            topic: one of the topics given at construction.
            cdr: the serialized message, including its encapsulation header.
            log_time_ns: time of reception or publication, ns since the epoch.
            publish_time_ns: time at which the publisher sent it, ns since the epoch.

        Raises
        ------
            RecordingError: unknown topic, closed recording, or the file cannot be written. After a
                failure every further call raises and counts the message in ``lost``. An error of
                the disk shows within :data:`INTERVAL`, not in the same call.
        """
        channel = self.channels.get(topic) or self.channel(topic)
        if not self.append(channel, cdr, log_time_ns, publish_time_ns):
            raise RecordingError(self.refusal)

    def channel(self, topic: str) -> int:
        """Return the channel number of a topic; raise RecordingError if it is not recorded."""
        try:
            return self.channels[topic]
        except KeyError:
            known = ", ".join(self.channels)
            raise RecordingError(f"topic {topic} is not recorded here (only {known})") from None

    def append(self, channel: int, cdr: bytes, log_time_ns: int, publish_time_ns: int) -> bool:
        """Append one message to a channel; return False, and count it, if it is refused."""
        with self.lock:
            if self._buffer.append(channel, cdr, log_time_ns, publish_time_ns):
                return True
            if self.reserve(1, len(cdr)).append(channel, cdr, log_time_ns, publish_time_ns):
                return True
            self._counts[REFUSED, channel] += 1
            return False

    def write_batch(self, messages: MessageArrays) -> None:
        """Append many messages with compiled code; raises as :meth:`write` does."""
        from cylconn_ros.recording.mcap.kernels import append_batch  # loads the compiler

        done, total = 0, len(messages.channel)
        while done < total:
            with self.lock:
                buffer = self.reserve(1, int(messages.size[done]))
                arrays = *buffer.arrays, *messages
                behind = append_batch(*arrays, done)
                if behind == done:
                    np.add.at(self._counts[REFUSED], messages.channel[done:], 1)
                    raise RecordingError(self.refusal)
                done = behind

    def reserve(self, messages: int, size: int) -> ChunkBuffer:
        """Return a chunk buffer that fits ``messages`` messages of ``size`` bytes in total.

        The caller holds ``lock`` and appends before it releases it. The buffer has size zero if the
        recording has failed or is closed, or if the backlog is full and ``wait_for_disk`` is False.
        """
        if self._buffer.fits(messages, size):
            return self._buffer
        while not self._refusing:
            self._notify()
            if self._waiting < _BACKLOG:
                self._rotate()
                self._buffer = self._empty_buffer(messages, size)
                return self._buffer
            if not self._wait_for_disk:
                self.refusal = (
                    f"{self._path}: the disk is too slow: {_BACKLOG >> 20} MiB wait for it"
                )
                return self._no_buffer
            self._freed.wait()
        self.refusal = self.failure or f"{self.directory}: recording is closed"
        return self._no_buffer

    def _rotate(self) -> None:
        """Queue the current buffer for writing, unless it is empty."""
        buffer, self._buffer = self._buffer, self._no_buffer
        if len(buffer):
            self._full.append(buffer)
            self._waiting += buffer.size
        else:
            self._reuse(buffer)

    def _empty_buffer(self, messages: int = 0, size: int = 0) -> ChunkBuffer:
        if self._spare and self._spare[-1].fits(messages, size):
            return self._spare.pop()
        buffer = ChunkBuffer(_CHUNK, self._counts)
        return (
            buffer
            if buffer.fits(messages, size)
            else ChunkBuffer.for_messages(messages, size, self._counts)
        )

    def _reuse(self, buffer: ChunkBuffer) -> None:
        """Keep an empty buffer; the last one kept is used first, as it is in the CPU cache."""
        if buffer.size == _CHUNK and len(self._spare) < _SPARE:
            self._spare.append(buffer)

    def _write_chunks(self) -> None:
        """Write chunks until the recording is closed or fails; runs in the writer's thread."""
        while not self._refusing:
            self._wake.acquire(timeout=INTERVAL)
            with self.lock:
                if len(self._buffer):
                    self._rotate()
                    self._buffer = self._empty_buffer()
            self._flush()

    def _flush(self) -> None:
        """Write the queued buffers."""
        while self._full:
            buffer = self._full.popleft()
            try:
                self._file.add_chunk(*buffer.contents())
            except Exception as error:  # any error ends the recording, not the program
                self._fail(error, buffer)
            with self.lock:
                self._waiting -= buffer.size
                buffer.clear()
                self._reuse(buffer)
                self._freed.notify_all()

    def _notify(self) -> None:
        """Wake the thread before its interval ends."""
        if self._wake.locked():
            self._wake.release()

    def _fail(self, error: Exception, buffer: ChunkBuffer | None = None) -> RecordingError:
        """Refuse all further messages; count those that are not on disk as lost."""
        reason = getattr(error, "strerror", None) or repr(error)
        with self.lock:
            self.failure = f"{self._path}: {reason}"
            self._refusing = True
            self._rotate()
            for lost in (*self._full, *([buffer] if buffer is not None else [])):
                channels = lost.contents()[1][:, CHANNEL]
                self._lost += np.bincount(channels, minlength=len(self._lost))
            self._full.clear()
            self._freed.notify_all()
        return RecordingError(self.failure)

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        Raises
        ------
            RecordingError: something could not be written. metadata.yaml is written if possible;
                its ``custom_data: incomplete`` holds the reason.
        """
        with self.lock:
            if not self._open:
                return
            self._open, self._refusing = False, True
            self._rotate()
            self._freed.notify_all()
            self._notify()
        self._thread.join()
        self._flush()
        failure = RecordingError(self.failure) if self.failure is not None else None
        try:  # also after a failure: the file then ends with its last complete chunk
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
        start, end = self._file.times
        return bag_information(
            self._path.name,
            self._topics,
            self._hashes,
            self.counts,
            start,
            end,
            custom,
        )

    def _bag_yaml(self) -> str:
        return to_yaml(self._bag_information())

    def _write_metadata_file(self) -> None:
        path = self.directory / "metadata.yaml"
        draft = path.with_name("metadata.yaml.part")
        text = to_yaml({"rosbag2_bagfile_information": self._bag_information()})
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)  # atomic: a reader sees the complete file or none

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
            if exc is None:  # do not hide the exception that ended the block
                raise
