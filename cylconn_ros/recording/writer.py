"""Write a run as a rosbag2 directory: one MCAP file (profile ros2) and its metadata.yaml."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from .errors import RecordingError
from .interfaces import Interface, interface
from .metadata import TopicInfo, bag_information, to_yaml

METADATA_RECORD = "cylconn_ros"  # MCAP metadata record holding parameters, version, method
COMPRESSIONS = {"zstd": CompressionType.ZSTD, "none": CompressionType.NONE}

# A chunk is compressed and written in one go while the caller waits, and it is what a killed
# process loses: 64 KiB keep the wait at a fraction of a millisecond.
_CHUNK_BYTES = 64 * 1024


class RunWriter:
    """Record serialised messages of known topics; a context manager.

    The directory must not exist: a run is never overwritten. Messages are stored byte for byte.
    ``write`` and ``close`` may be called from different threads.

    Attributes
    ----------
        directory: the rosbag2 directory.
        counts: messages accepted, per topic.
        lost: messages refused since the recording failed or was closed, per topic.
        failure: why the recording failed, or None.
    """

    def __init__(
        self,
        directory: Path,
        topics: Sequence[TopicInfo],
        metadata: Mapping[str, str],
        compression: str = "zstd",
    ) -> None:
        """Create ``directory`` and open the file.

        Args:
            directory: the run to create; parents are made as needed.
            topics: everything that may be written, each name once.
            metadata: texts kept with the run: ``version``, ``method``, ``parameters`` (a scene
                file as YAML), … They go into an MCAP metadata record and into metadata.yaml.
            compression: ``zstd`` or ``none``.

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
        interfaces = {topic.type: interface(topic.type) for topic in topics}

        self.directory = Path(directory)
        self.counts = dict.fromkeys(names, 0)
        self.lost = dict.fromkeys(names, 0)
        self.failure: str | None = None
        self._topics = tuple(topics)
        self._metadata = {str(key): str(value) for key, value in metadata.items()}
        self._hashes = {name: found.type_hash for name, found in interfaces.items()}
        self._start_ns: int | None = None
        self._end_ns = 0
        self._open = True
        self._lock = threading.Lock()
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError:
            raise RecordingError(f"{self.directory} exists; a run is never overwritten") from None
        except OSError as error:
            raise RecordingError(f"{self.directory}: {error.strerror or error}") from error
        self._path = self.directory / f"{self.directory.name}_0.mcap"
        try:
            self._file: BinaryIO = self._path.open("xb")
        except OSError as error:
            raise RecordingError(f"{self._path}: {error.strerror or error}") from error
        try:
            self._writer = Writer(
                self._file, chunk_size=_CHUNK_BYTES, compression=COMPRESSIONS[compression]
            )
            self._writer.start(profile="ros2")
            self._writer.add_metadata(METADATA_RECORD, self._metadata)
            self._channels = self._register(interfaces)
        except OSError as error:
            self._file.close()
            raise RecordingError(f"{self._path}: {error.strerror or error}") from error

    def _register(self, interfaces: Mapping[str, Interface]) -> dict[str, int]:
        schemas = {
            found.type: self._writer.register_schema(
                name=found.type, encoding="ros2msg", data=found.definition.encode()
            )
            for found in interfaces.values()
        }
        return {
            topic.name: self._writer.register_channel(
                topic=topic.name,
                message_encoding="cdr",
                schema_id=schemas[topic.type],
                metadata={
                    "offered_qos_profiles": to_yaml(topic.qos()),
                    "topic_type_hash": self._hashes[topic.type],
                },
            )
            for topic in self._topics
        }

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
                failure every further call raises and counts the message in ``lost``.
        """
        with self._lock:
            channel = self._channels.get(topic)
            if channel is None:
                known = ", ".join(self.counts)
                raise RecordingError(f"topic {topic} is not recorded here (only {known})")
            if self.failure is not None or not self._open:
                self.lost[topic] += 1
                raise RecordingError(self.failure or f"{self.directory}: recording is closed")
            try:
                self._writer.add_message(
                    channel, log_time_ns, cdr, publish_time_ns, sequence=self.counts[topic]
                )
            except Exception as error:  # whatever the disk or the library says, the caller goes on
                self.lost[topic] += 1
                raise self._fail(error) from error
            self.counts[topic] += 1
            if self._start_ns is None or log_time_ns < self._start_ns:
                self._start_ns = log_time_ns
            self._end_ns = max(self._end_ns, log_time_ns)

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
            self._open = False
            failure = RecordingError(self.failure) if self.failure is not None else None
            try:
                if failure is None:
                    self._writer.add_metadata("rosbag2", {"serialized_metadata": self._bag_yaml()})
                    self._writer.finish()
            except Exception as error:
                failure = self._fail(error)
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
        return bag_information(
            self._path.name,
            self._topics,
            self._hashes,
            self.counts,
            self._start_ns or 0,
            self._end_ns,
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

    def _fail(self, error: Exception) -> RecordingError:
        reason = getattr(error, "strerror", None) or repr(error)
        self.failure = f"{self._path}: {reason}"
        return RecordingError(self.failure)

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
