"""One source, compiled where numba is installed and run as it is where it is not.

``jit`` marks the functions of the physics. They are written with scalars and tuples only, which
numba compiles to machine code and plain Python runs at a useful speed.

Compiled code is cached per state of the sources: numba checks only the file a function stands in,
not those of the functions it calls, so the cache directory carries a digest of all of them. It lies
where an installed package may write: ``$CYLCONN_CACHE_DIR``, else ``$XDG_CACHE_HOME/cylconn_ros``,
else ``~/.cache/cylconn_ros``, else the directory for temporary files.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

try:
    if os.environ.get("CYLCONN_NO_COMPILER"):
        raise ImportError
    import numba
except ImportError:
    numba = None

COMPILED = numba is not None
"""Whether the physics runs compiled; ``CYLCONN_NO_COMPILER=1`` turns it off."""

Function = TypeVar("Function", bound=Callable[..., Any])


def _digest() -> str:
    package = Path(__file__).parent.parent
    digest = hashlib.sha256(f"numba {numba.__version__}".encode())
    for source in sorted((*package.glob("core/*.py"), *package.glob("methods/*.py"))):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _cache_directory() -> str:
    home = os.environ.get("CYLCONN_CACHE_DIR")
    caches = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    temporary = Path(tempfile.gettempdir(), f"cylconn_ros-{os.getuid()}")
    for root in (Path(home) if home else caches / "cylconn_ros", temporary):
        directory = root / _digest()
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK):
            return str(directory)
    return ""  # numba's own choice, beside the source


if COMPILED:
    _DIRECTORY = _cache_directory()

    def jit(function: Function) -> Function:
        """Compile ``function`` at its first call; division by zero gives inf or NaN, as in C."""
        theirs = numba.config.CACHE_DIR  # ours only: another package's cache stays where it was
        numba.config.CACHE_DIR = _DIRECTORY or theirs
        try:
            compiled: Function = numba.njit(cache=True, error_model="numpy")(function)
        finally:
            numba.config.CACHE_DIR = theirs
        return compiled
else:

    def jit(function: Function) -> Function:
        """Leave ``function`` as it is: no compiler is installed."""
        return function
