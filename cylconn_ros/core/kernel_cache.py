"""Compiled code on disk: one checked file per function, signature and processor.

A file begins with a checksum of the rest. A file that is damaged or cannot be loaded is reported,
removed, and replaced by the next compilation. Files are written under another name and then
renamed, so that processes that compile the same function at once do not disturb each other: each
file is complete, and the last one stays.

If the directory cannot be written, code is compiled in each process; this is reported once.
"""

import contextlib
import contextvars
import hashlib
import inspect
import logging
import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

SUFFIX: Final = ".kernel"
_CHECKSUM: Final = 32  # bytes
_LOG = logging.getLogger("cylconn_ros")

_reported: set[str] = set()
_only_stored: contextvars.ContextVar[bool] = contextvars.ContextVar("only_stored", default=False)


class NotCompiledError(Exception):
    """A kernel is not in the cache, and must not be compiled now (:func:`only_stored`)."""


@contextlib.contextmanager
def only_stored() -> Iterator[None]:
    """Raise NotCompiledError in place of compiling a kernel, on this thread, within the block."""
    token = _only_stored.set(True)
    try:
        yield
    finally:
        _only_stored.reset(token)


def _checksum(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_CHECKSUM).digest()


def read_checked(path: Path) -> bytes | None:
    """Content of a file of the cache; None if there is no such file.

    A damaged file is reported and removed; the result is then None, too.
    """
    try:
        stored = path.read_bytes()
    except OSError:
        return None
    if len(stored) > _CHECKSUM and stored[:_CHECKSUM] == _checksum(stored[_CHECKSUM:]):
        return stored[_CHECKSUM:]
    remove_damaged(path)
    return None


def remove_damaged(path: Path) -> None:
    """Remove a file that is of no use, with one line in the log."""
    _LOG.warning("%s is damaged: removed, its kernel is compiled again", path)
    with contextlib.suppress(OSError):
        path.unlink()


def write_checked(path: Path, content: bytes) -> None:
    """Write a file of the cache under another name, and rename it. Raises OSError."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(_checksum(content) + content)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


def _report_unusable(reason: str) -> None:
    """Log a warning, unless this process has logged it before."""
    if reason not in _reported:
        _reported.add(reason)
        _LOG.warning(
            "%s: compiled code cannot be stored, so that each start compiles it again; "
            "CYLCONN_CACHE_DIR sets another directory",
            reason,
        )


class KernelCache:
    """Cache of one compiled function, in the form that numba's dispatchers use.

    Attributes
    ----------
        cache_path: the directory.
        files: glob pattern of the function's files: all signatures, this state of its source.
    """

    def __init__(self, function: Callable[..., Any], directory: str) -> None:
        """``directory``: '' for none, code is then compiled in each process."""
        self.cache_path = directory
        source = Path(inspect.getfile(function)).read_bytes()
        state = hashlib.sha256(source).hexdigest()[:8]
        module = function.__module__.rpartition(".")[2]
        self._name = f"{module}.{function.__qualname__}-{state}"
        self.files = f"{self._name}-*{SUFFIX}"

    def is_stored(self) -> bool:
        """Whether undamaged code is stored, for any signature."""
        return any(read_checked(path) is not None for path in self._found())

    def _found(self) -> Iterator[Path]:
        if self.cache_path:
            yield from Path(self.cache_path).glob(self.files)

    def _file(self, signature: Any, codegen: Any) -> Path:
        """File of a signature for the processor that ``codegen`` compiles for."""
        key = hashlib.sha256(repr((signature, codegen.magic_tuple())).encode()).hexdigest()[:16]
        return Path(self.cache_path, f"{self._name}-{key}{SUFFIX}")

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Compiled code of a signature, loaded; None if it has to be compiled.

        Raises NotCompiledError in place of None within :func:`only_stored`.
        """
        loaded = self._load(signature, target_context) if self.cache_path else None
        if loaded is None and _only_stored.get():
            raise NotCompiledError(self._name)
        return loaded

    def _load(self, signature: Any, target_context: Any) -> Any:
        from numba.core.compiler import CompileResult

        target_context.refresh()
        path = self._file(signature, target_context.codegen())
        content = read_checked(path)
        if content is None:
            return None
        try:
            return CompileResult._rebuild(target_context, *pickle.loads(content))
        except Exception:  # written by other versions of libraries, or not by this package
            remove_damaged(path)
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Store compiled code; a directory that cannot be written is reported once."""
        from numba.core.serialize import dumps

        if not self.cache_path:
            _report_unusable("no directory with free space can be written")
            return
        path = self._file(signature, compiled.codegen)
        try:
            write_checked(path, dumps(compiled._reduce()))
        except OSError as error:
            _report_unusable(f"{self.cache_path}: {error.strerror or error}")

    def enable(self) -> None:
        """The cache is always in use."""

    def disable(self) -> None:
        """The cache is always in use."""

    def flush(self) -> None:
        """Remove the function's files."""
        for path in self._found():
            path.unlink(missing_ok=True)
