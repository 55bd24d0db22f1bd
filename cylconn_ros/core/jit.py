"""Kernels and device functions: one source, compiled by numba if it is installed.

``kernel`` marks the functions that Python calls, ``device_function`` those that kernels call, and
``inline_function`` the small ones among these, which are copied into their callers so that their
tuples stay in registers. All are written with scalars and tuples only, which numba compiles to
machine code and plain Python runs at a useful speed. Arrays enter through kernels and are read and
written number by number.

A kernel is compiled at its first call, with everything that it calls. Only kernels are compiled for
Python callers; a device function called from Python runs uncompiled.

Compiled code is cached per state of the sources. numba checks only the file of the kernel itself,
not the files of the functions it calls, so that the name of the cache directory contains a digest
of those. The cache is in the first writable one of these directories: ``$CYLCONN_CACHE_DIR``, else
``$XDG_CACHE_HOME/cylconn_ros``, else ``~/.cache/cylconn_ros``, else the directory for temporary
files.
"""

import functools
import hashlib
import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

try:
    if os.environ.get("CYLCONN_NO_COMPILER"):
        raise ImportError
    import numba
    from llvmlite import ir
    from numba.extending import intrinsic, register_jitable
except ImportError:
    numba = None

COMPILED = numba is not None
"""Whether the physics runs compiled; ``CYLCONN_NO_COMPILER=1`` turns it off."""

_IMPORT = re.compile(rb"^from cylconn_ros\.([a-z_.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)

Function = TypeVar("Function", bound=Callable[..., Any])


def digested(package: Path) -> list[Path]:
    """Sources whose change makes compiled code stale although the kernel's own file is unchanged.

    They are the modules that define device functions (``device_function``, ``inline_function``),
    whose code becomes part of kernels in other files, and the modules that these import, whose
    constants do.
    """
    found = set()
    for source in package.rglob("*.py"):
        imports = dict(_IMPORT.findall(source.read_bytes()))
        if not re.search(rb"\b(device_function|inline_function)\b", imports.get(b"core.jit", b"")):
            continue
        found.add(source)
        for module, names in imports.items():
            base = package.joinpath(*module.decode().split("."))
            found.add(base.with_suffix(".py"))
            found |= {base / f"{name}.py" for name in re.findall(r"\w+", names.decode())}
    return sorted(source for source in found if source.is_file())


def digest(package: Path) -> str:
    """Digest of the compiled sources and the compiler's version, as a directory name."""
    known = hashlib.sha256(f"numba {numba.__version__}".encode() if COMPILED else b"")
    for source in digested(package):
        known.update(source.read_bytes())
    return known.hexdigest()[:16]


def cache_directory() -> str:
    """The cache directory, created if necessary; '': numba's own, beside the source."""
    home = os.environ.get("CYLCONN_CACHE_DIR")
    caches = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    temporary = Path(tempfile.gettempdir(), f"cylconn_ros-{os.getuid()}")
    for root in (Path(home) if home else caches / "cylconn_ros", temporary):
        directory = root / digest(Path(__file__).parent.parent)
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK):
            return str(directory)
    return ""


if COMPILED:
    _DIRECTORY = cache_directory()
    # No contraction of a b + c (fused multiply-add): 20 % faster, but its rounding depends on
    # inlining, so that two compilations of one source would differ in their last digits.

    def device_function(function: Function) -> Function:
        """Compile ``function`` for the kernels that call it."""
        inner: Function = register_jitable(forceinline=False, no_cfunc_wrapper=True)(function)
        return inner

    def inline_function(function: Function) -> Function:
        """Compile ``function`` into each of its callers: for small functions."""
        inner: Function = register_jitable(forceinline=True, no_cfunc_wrapper=True)(function)
        return inner

    def _kernel(function: Function, allocates: bool = False, nogil: bool = False) -> Function:
        theirs = numba.config.CACHE_DIR  # restored below: other packages keep their cache
        numba.config.CACHE_DIR = _DIRECTORY or theirs
        # 1/0 is inf, as in C
        options = {"cache": True, "error_model": "numpy", "_nrt": allocates, "nogil": nogil}
        try:
            compiled: Function = numba.njit(**options)(function)
        finally:
            numba.config.CACHE_DIR = theirs
        return compiled

    def kernel(function: Function) -> Function:
        """Compile ``function`` at its first call, or load it from the cache.

        It must not allocate arrays: it is compiled without numba's runtime, which would count the
        references of every array at every call.
        """
        return _kernel(function)

    def parallel_kernel(function: Function) -> Function:
        """Compile a kernel that releases the interpreter's lock, so that threads run in parallel.

        For long calls only: the release costs some 100 ns.
        """
        return _kernel(function, nogil=True)

    def allocating_kernel(function: Function) -> Function:
        """Compile a kernel that allocates arrays."""
        return _kernel(function, allocates=True)

    @intrinsic
    def call(
        _context: Any, address: Any, first: Any, second: Any, third: Any, fourth: Any
    ) -> tuple[Any, Any]:
        """Call the C function at ``address`` with integers and pointers; return its int.

        All five arguments are int64. A function with fewer arguments ignores the rest.
        """
        whole = numba.types.int64

        def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            wide = ir.IntType(64)
            kind = ir.FunctionType(ir.IntType(32), [wide] * 4)
            function = builder.inttoptr(values[0], kind.as_pointer())
            return builder.sext(builder.call(function, list(values[1:])), wide)

        return whole(whole, whole, whole, whole, whole), generate

    def close_signatures(function: Callable[..., Any]) -> None:
        """Refuse arguments of other types than those compiled so far: TypeError, no compilation."""
        function.disable_compile()  # type: ignore[attr-defined]

    def is_ready(function: Callable[..., Any]) -> bool:
        """Whether a kernel runs without compilation: it is loaded or in the cache."""
        index = f"{function.__module__.rpartition('.')[2]}.{function.__name__}-*.nbi"
        return bool(getattr(function, "signatures", ())) or any(Path(_DIRECTORY).rglob(index))
else:

    def device_function(function: Function) -> Function:
        """Return ``function`` unchanged: no compiler is installed."""
        return function

    inline_function = device_function

    def _numbers(argument: Any) -> Any:
        vector = isinstance(argument, np.ndarray) and argument.ndim == 1
        return argument.data if vector else argument

    def kernel(function: Function) -> Function:
        """Pass vectors to ``function`` as memoryviews, whose elements are Python floats.

        NumPy floats, the elements of an array, are several times slower in every operation. Arrays
        with more dimensions are passed unchanged; the kernel that receives their rows converts
        them.
        """

        @functools.wraps(function)
        def with_memoryviews(*arguments: Any) -> Any:
            return function(*[_numbers(a) for a in arguments])

        return with_memoryviews  # type: ignore[return-value]

    allocating_kernel = kernel
    parallel_kernel = kernel

    def close_signatures(function: Callable[..., Any]) -> None:
        """Nothing to refuse: nothing is compiled."""

    def call(address: int, first: int, second: int, third: int, fourth: int) -> int:
        """Raise RuntimeError: calls by address need the compiler."""
        raise RuntimeError("numba is not installed: C functions cannot be called by address")

    def is_ready(function: Callable[..., Any]) -> bool:
        """True: nothing is compiled."""
        return True
