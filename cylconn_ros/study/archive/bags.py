"""The recordings of an archive: in folders, by patterns, or listed in a manifest."""

from __future__ import annotations

import contextlib
import glob
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from cylconn_ros.errors import StudyError
from cylconn_ros.recording.files.finding import METADATA
from cylconn_ros.recording.files.formats import is_recording
from cylconn_ros.study.dataset import filesystem, open_text
from cylconn_ros.study.rows import Rows

BAG, PATH, SIZE = "bag", "path", "bytes"
_SUFFIXES = (".mcap", ".db3", ".mcap.zst", ".db3.zst")


def find_bags(texts: Sequence[str]) -> Rows:
    """Rows of the recordings that the texts name, each once, in order of their names.

    A text is a recording, a folder with recordings at any depth, a pattern (``runs/*/bag``,
    ``**``), a manifest (``@list.txt``, a recording a line, relative to the manifest) or an fsspec
    address of one of these. Columns: ``bag``, the name below the given folder; ``path``; ``bytes``,
    the size of its files. Raises StudyError if a text names no recording.
    """
    found: dict[str, tuple[str, int]] = {}
    for text in texts:
        here = list(_of(text))
        if not here:
            raise StudyError(f"{text}: names no recording")
        for name, path, size in here:
            found.setdefault(path, (name, size))
    names = [name for name, _ in found.values()]
    if len(set(names)) < len(names):  # of two folders: the paths tell them apart
        found = {path: (path, size) for path, (_, size) in found.items()}
    order = sorted(found, key=lambda path: found[path][0])
    columns = {
        BAG: _texts([found[path][0] for path in order]),
        PATH: _texts(order),
        SIZE: np.array([found[path][1] for path in order], dtype=np.int64),
    }
    return Rows(columns, len(order))


def _texts(values: Sequence[str]) -> np.ndarray:
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found


def _of(text: str) -> Iterator[tuple[str, str, int]]:
    """Name, path and size of the recordings that one text names."""
    if text.startswith("@"):
        folder = PurePosixPath(text[1:]).parent if "://" in text else Path(text[1:]).parent
        for line in open_text(text[1:]).splitlines():
            entry = line.strip()
            if entry and not entry.startswith("#"):
                absolute = entry.startswith("/") or "://" in entry
                found = list(_of(entry if absolute else str(folder / entry)))
                if not found:
                    raise StudyError(f"{text}: {entry}: names no recording")
                yield from ((entry if len(found) == 1 else n, p, s) for n, p, s in found)
    elif "://" in text:
        yield from _remote(text)
    elif glob.has_magic(text):
        for match in sorted(glob.glob(text, recursive=True)):  # noqa: PTH207 (patterns with /**/)
            path = Path(match)
            if _is_recording(path):
                yield match, match, _size(path)
            elif path.is_dir():
                for name, inner, size in _below(path):
                    yield f"{match}/{name}", inner, size
    else:
        path = Path(text)
        if not path.exists():
            raise StudyError(f"{text}: does not exist")
        if _is_recording(path):
            yield path.name, str(path), _size(path)
        else:
            yield from _below(path)


def _below(folder: Path) -> Iterator[tuple[str, str, int]]:
    """Recordings below a folder; files within a recorded directory are its parts."""
    for path in sorted(folder.iterdir()):
        if _is_recording(path):
            yield path.name, str(path), _size(path)
        elif path.is_dir() and not path.name.startswith("."):
            for name, inner, size in _below(path):
                yield f"{path.name}/{name}", inner, size


def _is_recording(path: Path) -> bool:
    if path.is_dir():
        return (path / METADATA).is_file()
    return is_recording(path)


def _size(path: Path) -> int:
    files = path.iterdir() if path.is_dir() else (path,)
    return sum(file.stat().st_size for file in files if file.is_file())


def _remote(address: str) -> Iterator[tuple[str, str, int]]:
    """Recordings of an object store: folders with metadata.yaml, else files."""
    system, root = filesystem(address)
    paths = system.glob(root) if glob.has_magic(root) else [root]
    for top in paths:
        files = system.find(top, detail=True)
        folders = {name.rpartition("/")[0] for name in files if name.endswith("/" + METADATA)}
        groups: dict[str, int] = {}
        for name, facts in files.items():
            folder = name.rpartition("/")[0]
            if folder in folders or name.endswith(_SUFFIXES):
                key = folder if folder in folders else name
                groups[key] = groups.get(key, 0) + int(facts.get("size") or 0)
        for path, size in groups.items():
            name = path.removeprefix(top).strip("/") or path.rpartition("/")[2]
            yield name, system.unstrip_protocol(path), size


@contextlib.contextmanager
def local(path: str) -> Iterator[Path]:
    """Return a recording as a local path; one of an object store is copied for the time being."""
    if "://" not in path:
        yield Path(path)
        return
    system, inner = filesystem(path)
    with tempfile.TemporaryDirectory(prefix="cylconn_") as folder:
        target = Path(folder) / PurePosixPath(inner).name
        if system.isdir(inner):
            system.get(f"{inner}/", f"{target}/", recursive=True)
        else:
            system.get_file(inner, str(target))
        yield target
