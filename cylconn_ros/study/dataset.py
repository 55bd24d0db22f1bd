"""A dataset of a study: a folder with ``study.json`` and Parquet files of whole chunks of rows.

``rows/part-00000012.parquet`` holds the rows of chunk 12. A file appears whole or not at all: a
local one is written beside its place and renamed, an object store shows an upload when it is
complete. What is there is therefore correct, and a study resumes with the chunks that are missing.
The folder is a path or an fsspec address such as ``s3://bucket/folder``.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.errors import StudyError

if TYPE_CHECKING:
    import pyarrow

STUDY = "study.json"
ROWS = "rows"
_PART = re.compile(r"part-(\d{8})\.parquet$")
_NOT_COMPARED = {"chunk", "version"}  # keys of study.json that do not change what rows hold


def filesystem(address: str) -> tuple[Any, str]:
    """File system and path of an fsspec address or a local path. Raises StudyError."""
    try:
        import fsspec
        from fsspec.core import url_to_fs
    except ImportError:
        raise StudyError("datasets need fsspec and pyarrow: pip install '.[scale]'") from None
    del fsspec
    try:
        system, path = url_to_fs(str(address))
    except (ImportError, ValueError) as error:
        raise StudyError(f"{address}: {error}") from None
    return system, path


def is_local(system: Any) -> bool:
    """Whether a file system is that of this machine."""
    protocol = system.protocol
    return "file" in ((protocol,) if isinstance(protocol, str) else protocol)


def open_text(address: str) -> str:
    """Read a text file. Raises StudyError if it cannot be read."""
    try:
        if "://" not in address:
            return Path(address).read_text(encoding="utf-8")
        system, path = filesystem(address)
        return str(system.cat_file(path).decode("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{address}: {getattr(error, 'strerror', None) or error}") from None


class Dataset:
    """A folder of results.

    Attributes
    ----------
        address: of the folder. description: content of study.json; empty before it exists.
    """

    def __init__(self, address: str | Path) -> None:
        """Raises StudyError if the address has no driver."""
        self.address = str(address).rstrip("/")
        self._fs, self._root = filesystem(self.address)
        self.description: dict[str, Any] = {}
        if self._fs.exists(f"{self._root}/{STUDY}"):
            try:
                self.description = json.loads(self._fs.cat_file(f"{self._root}/{STUDY}"))
            except (OSError, ValueError) as error:
                raise StudyError(f"{self.address}/{STUDY}: cannot be read: {error}") from None

    @classmethod
    def existing(cls, address: str | Path) -> Dataset:
        """Open a dataset; raises StudyError if there is none."""
        found = cls(address)
        if not found.description:
            raise StudyError(f"{found.address}: holds no study (there is no {STUDY})")
        return found

    def begin(self, description: Mapping[str, Any]) -> None:
        """Create the dataset, or make sure that the existing one is of the same study.

        The chunk size of an existing one stays. Raises StudyError that names what differs, or if
        the folder holds something else, or cannot be written.
        """
        if self.description:
            for key in description.keys() | self.description.keys():
                before, now = self.description.get(key), description.get(key)
                if key not in _NOT_COMPARED and before != now:
                    raise StudyError(
                        f"{self.address}: holds another study; {key} was {_short(before)} and is "
                        f"{_short(now)}; results are never overwritten: give another folder"
                    )
            return
        if self._fs.exists(self._root) and self._fs.ls(self._root):
            raise StudyError(f"{self.address}: exists and holds no study; give another folder")
        try:
            self._fs.makedirs(f"{self._root}/{ROWS}", exist_ok=True)
            self._write(f"{self._root}/{STUDY}", json.dumps(description, indent=1).encode())
        except OSError as error:
            raise self._failed(error) from None
        self.description = dict(description)

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes of this machine from writing to a local dataset.

        Raises StudyError if one does. The lock ends with its process, however it ends. Processes
        that write to one object store repeat work and write equal files.
        """
        if not is_local(self._fs):
            yield
            return
        import fcntl

        with open(f"{self._root}/.lock", "w") as file:  # noqa: PTH123 (an fsspec path is a str)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise StudyError(
                    f"{self.address}: another process writes to it; wait, or end that process"
                ) from None
            yield

    def done(self) -> set[int]:
        """Numbers of the chunks that are written."""
        try:
            names = self._fs.ls(f"{self._root}/{ROWS}", detail=False)
        except FileNotFoundError:
            return set()
        return {int(found[1]) for name in names if (found := _PART.search(str(name)))}

    def put(self, chunk: int, data: bytes) -> None:
        """Write a chunk's file whole. Raises StudyError, for instance if the disk is full."""
        try:
            self._write(f"{self._root}/{ROWS}/part-{chunk:08d}.parquet", data)
        except OSError as error:
            raise self._failed(error) from None

    def write_page(self, name: str, text: str) -> str:
        """Write a text file beside the rows, over one of that name; returns its address."""
        try:
            self._write(f"{self._root}/{name}", text.encode())
        except OSError as error:
            raise self._failed(error) from None
        return f"{self.address}/{name}"

    def table(self, columns: Sequence[str] | None = None) -> pyarrow.Table:
        """All rows written so far, in order, or some of their columns."""
        from pyarrow import dataset

        names = sorted(self._fs.ls(f"{self._root}/{ROWS}", detail=False))
        files = [name for name in names if _PART.search(str(name))]
        if not files:
            raise StudyError(f"{self.address}: no row is written yet")
        found = dataset.dataset(files, filesystem=self._fs, format="parquet")
        return found.to_table(columns=list(columns) if columns is not None else None)

    def row(self, number: int) -> dict[str, Any]:
        """One row by its number. Raises StudyError if it is not written."""
        from pyarrow import parquet

        chunk = int(self.description["chunk"])
        path = f"{self._root}/{ROWS}/part-{max(number, 0) // chunk:08d}.parquet"
        count = int(self.description["rows"])
        if not 0 <= number < count or not self._fs.exists(path):
            raise StudyError(f"{self.address}: row {number} is not written (of {count} rows)")
        with self._fs.open(path, "rb") as file:
            rows = parquet.read_table(file).to_pylist()
        return dict(next(row for row in rows if row["row"] == number))

    def _write(self, path: str, data: bytes) -> None:
        """Write a file that appears whole."""
        if not is_local(self._fs):
            self._fs.pipe_file(path, data)
            return
        final = Path(path)
        beside = final.with_name(f".{final.name}.{os.getpid()}")
        try:
            with beside.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(final)
        except OSError:
            with contextlib.suppress(OSError):
                beside.unlink()
            raise

    def _failed(self, error: OSError) -> StudyError:
        done = len(self.done()) if self.description else 0
        kept = f"; {done} chunks are written, and the same command resumes" if done else ""
        return StudyError(f"{self.address}: {error.strerror or error}{kept}")


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 120 else f"{text[:117]}…"
