"""Write a run as a rosbag2 directory: one MCAP file (profile ros2) and its metadata.yaml.

Who writes a message only copies it into a tray (:mod:`~cylconn_ros.recording.chunk_buffer`). A thread of
the run's own takes the tray away every :data:`INTERVAL`, or when it is full, compresses it and puts
it on disk as a chunk, while others go on with another tray; all that takes long is done without the
interpreter's lock. A killed process loses what came within about one interval.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.chunk_buffer import ACCEPTED, CHANNEL, REFUSED, Messages, Tray
from cylconn_ros.recording.mcap_writer import COMPRESSIONS, Container
from cylconn_ros.recording.message_definitions import Interface, interface
from cylconn_ros.recording.metadata import TopicInfo, bag_information, to_yaml

METADATA_RECORD = "cylconn_ros"  # MCAP metadata record holding parameters, version, method

INTERVAL = 0.09
"""Seconds between chunks."""

_CHUNK = 1 << 20  # bytes of a tray; when they are used up, a chunk does not wait for its time
_BACKLOG = 1 << 26  # bytes of trays that may wait for a slow disk
_SPARE = 2  # empty trays that are kept


class RunWriter:
    """Record serialised messages of known topics; a context manager.

    The directory must not exist: a run is never overwritten. Messages are stored byte for byte.
    ``write``, ``put`` and ``close`` may be called from different threads.

    Compiled code may put messages in, too, and needs no interpreter for that. It is given the
    memory of a tray that has room for them, and calls :func:`~cylconn_ros.recording.kernels.put` for
    each, before the lock is released::

        channels = np.array([writer.channels[topic] for topic in topics])  # once a run
        with writer.lock:
            compiled(*writer.tray(messages=8, size=4096).arrays, channels, time.time_ns(), ...)

    ``size`` are bytes of messages, all together, at most. Either there is room for all of them, or
    for none, and ``put`` then counts them as refused: nothing else need be done.

    Attributes
    ----------
        directory: the rosbag2 directory.
        failure: why the recording failed, or None.
        refusal: why a message was last refused; empty where none was.
        channels: the number of each topic in the file.
        lock: held by whoever puts something into a tray.
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
            self._register(found)
        except OSError as error:
            raise RecordingError(f"{self._path}: {error.strerror or error}") from error
        self.channels = {topic.name: channel for channel, topic in enumerate(topics, 1)}
        self.refusal = ""
        self._counts = np.zeros((2, 1 + len(topics)), np.int64)
        self._lost = np.zeros(1 + len(topics), np.int64)  # accepted, but the disk then refused them
        self._none = Tray(0, self._counts)
        self._tray = Tray(_CHUNK, self._counts)  # that is being filled
        self._spare = [Tray(_CHUNK, self._counts)]
        self._full: deque[Tray] = deque()
        self._waiting = 0  # bytes of the trays that are full, or on their way to the disk
        self._refusing = False  # failed or closed
        self.lock = threading.Lock()
        self._emptied = threading.Condition(self.lock)  # a tray is, or none will be any more
        self._bell = threading.Lock()  # released: the thread shall not wait for its time
        self._bell.acquire()
        self._thread = threading.Thread(target=self._work, name="recording", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> dict[str, int]:
        """Messages accepted, per topic; without those that the disk then refused."""
        return self._by_topic(self._counts[ACCEPTED] - self._lost)

    @property
    def lost(self) -> dict[str, int]:
        """Messages refused, per topic: by the disk, because it was too slow, or after the end."""
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
            cdr: the serialised message, encapsulation header included.
            log_time_ns: when it was received or published, ns since the epoch.
            publish_time_ns: when its publisher sent it, ns since the epoch.

        Raises
        ------
            RecordingError: unknown topic, closed recording, or the file cannot take it. After a
                failure every further call raises and counts the message in ``lost``. What the disk
                refuses is known within :data:`INTERVAL`, not in the same call.
        """
        channel = self.channels.get(topic) or self.channel(topic)
        if not self.put(channel, cdr, log_time_ns, publish_time_ns):
            raise RecordingError(self.refusal)

    def channel(self, topic: str) -> int:
        """The number of a topic; raises RecordingError for one that is not recorded here."""
        try:
            return self.channels[topic]
        except KeyError:
            known = ", ".join(self.channels)
            raise RecordingError(f"topic {topic} is not recorded here (only {known})") from None

    def put(self, channel: int, cdr: bytes, log_time_ns: int, publish_time_ns: int) -> bool:
        """Append one message of the topic of that number; where it is refused, count it: False."""
        with self.lock:
            if self._tray.put(channel, cdr, log_time_ns, publish_time_ns):
                return True
            if self.tray(1, len(cdr)).put(channel, cdr, log_time_ns, publish_time_ns):
                return True
            self._counts[REFUSED, channel] += 1
            return False

    def write_each(self, messages: Messages) -> None:
        """Append many messages, sooner than one by one; raises as :meth:`write` does."""
        from cylconn_ros.recording.kernels import put_each  # brings the compiler

        done, total = 0, len(messages.channel)
        while done < total:
            with self.lock:
                tray = self.tray(1, int(messages.size[done]))
                arrays = *tray.arrays, *messages
                behind = put_each(*arrays, done)
                if behind == done:
                    np.add.at(self._counts[REFUSED], messages.channel[done:], 1)
                    raise RecordingError(self.refusal)
                done = behind

    def tray(self, messages: int, size: int) -> Tray:
        """The tray for so many messages of ``size`` bytes together, for who holds the lock.

        It is to be filled before the lock is released. A writer that is not patient gives one
        without any room where there is none: it refuses, and counts, all that is put into it.
        """
        if self._tray.has_room(messages, size):
            return self._tray
        while not self._refusing:
            self._ring()
            if self._waiting < _BACKLOG:
                self._set_aside()
                self._tray = self._empty_one(messages, size)
                return self._tray
            if not self._patient:
                self.refusal = (
                    f"{self._path}: the disk is too slow: {_BACKLOG >> 20} MiB wait for it"
                )
                return self._none
            self._emptied.wait()
        self.refusal = self.failure or f"{self.directory}: recording is closed"
        return self._none

    def _set_aside(self) -> None:
        """Have the tray that is being filled written, if there is anything in it."""
        tray, self._tray = self._tray, self._none
        if len(tray):
            self._full.append(tray)
            self._waiting += tray.size
        else:
            self._keep(tray)

    def _empty_one(self, messages: int = 0, size: int = 0) -> Tray:
        if self._spare and self._spare[-1].has_room(messages, size):
            return self._spare.pop()
        tray = Tray(_CHUNK, self._counts)
        return (
            tray
            if tray.has_room(messages, size)
            else Tray.for_messages(messages, size, self._counts)
        )

    def _keep(self, tray: Tray) -> None:
        """Use an empty tray again: that which was used last, as it is in the cache."""
        if tray.size == _CHUNK and len(self._spare) < _SPARE:
            self._spare.append(tray)

    def _work(self) -> None:
        """Put chunks on disk until the recording is closed or fails."""
        while not self._refusing:
            self._bell.acquire(timeout=INTERVAL)
            with self.lock:
                if len(self._tray):
                    self._set_aside()
                    self._tray = self._empty_one()
            self._flush()

    def _flush(self) -> None:
        """Put on disk what has been set aside."""
        while self._full:
            tray = self._full.popleft()
            try:
                self._file.add_chunk(*tray.held())
            except Exception as error:  # whatever the disk or the library says, others go on
                self._fail(error, tray)
            with self.lock:
                self._waiting -= tray.size
                tray.clear()
                self._keep(tray)
                self._emptied.notify_all()

    def _ring(self) -> None:
        """Have what is set aside written now."""
        if self._bell.locked():
            self._bell.release()

    def _fail(self, error: Exception, tray: Tray | None = None) -> RecordingError:
        """Refuse everything from now on; what has not reached the disk is lost."""
        reason = getattr(error, "strerror", None) or repr(error)
        with self.lock:
            self.failure = f"{self._path}: {reason}"
            self._refusing = True
            self._set_aside()
            for lost in (*self._full, *([tray] if tray is not None else [])):
                channels = lost.held()[1][:, CHANNEL]
                self._lost += np.bincount(channels, minlength=len(self._lost))
            self._full.clear()
            self._emptied.notify_all()
        return RecordingError(self.failure)

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        Raises
        ------
            RecordingError: something could not be written. metadata.yaml is written if it can be,
                and says under ``custom_data: incomplete`` what went wrong.
        """
        with self.lock:
            if not self._open:
                return
            self._open, self._refusing = False, True
            self._set_aside()
            self._emptied.notify_all()
            self._ring()
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
