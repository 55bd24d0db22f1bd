"""Kernels and device functions: one source, compiled by numba if it is installed.

``kernel`` marks the functions that Python calls, ``device_function`` those that kernels call, and
``inline_function`` the small ones among these, which are copied into their callers so that their
tuples stay in registers. All are written with scalars and tuples only, which numba compiles to
machine code and plain Python runs at a useful speed. Arrays enter through kernels and are read and
written number by number.

A kernel is compiled at its first call, with everything that it calls. Only kernels are compiled for
Python callers; a device function called from Python runs uncompiled. ``c_function`` marks a kernel
that other kernels call by its address (:func:`call_step`): they are compiled without it.

Compiled code is cached (core/kernel_cache.py) per state of the sources: the name of the cache
directory contains a digest of the files whose functions become part of kernels in other files. The
cache is in the first usable one of these directories: ``$CYLCONN_CACHE_DIR``, else
``$XDG_CACHE_HOME/cylconn_ros``, else ``~/.cache/cylconn_ros``, else the directory for temporary
files, else shared memory. Usable: it can be written and has 32 MB of free space.
"""

import contextlib
import functools
import hashlib
import os
import re
import tempfile
import types
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cylconn_ros.core.kernel_cache import KernelCache

try:
    if os.environ.get("CYLCONN_NO_COMPILER"):
        raise ImportError
    import numba
except ImportError:
    numba = None

COMPILED = numba is not None
"""Whether the physics runs compiled; ``CYLCONN_NO_COMPILER=1`` turns it off."""

_IMPORT = re.compile(rb"^from cylconn_ros\.([a-z_.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)

_SHARED_MEMORY = "/dev/shm"
_LEAST_SPACE = 32e6  # bytes

_device_functions: dict[Any, Any] = {}  # with their dispatchers, to which numba refers weakly

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
        if not re.search(
            rb"\b(device|inline|allocating)_function\b", imports.get(b"core.jit", b"")
        ):
            continue
        found.add(source)
        for module, names in imports.items():
            base = package.joinpath(*module.decode().split("."))
            found.add(base.with_suffix(".py"))
            found |= {base / f"{name}.py" for name in re.findall(r"\w+", names.decode())}
    found.add(package / "core" / "device_compiler.py")
    return sorted(source for source in found if source.is_file())


def digest(package: Path) -> str:
    """Digest of the compiled sources and the compiler's version, as a directory name."""
    known = hashlib.sha256(f"numba {numba.__version__}".encode() if COMPILED else b"")
    for source in digested(package):
        known.update(source.read_bytes())
    return known.hexdigest()[:16]


def cache_directory() -> str:
    """The cache directory, created if necessary; '' if none is usable."""
    home = os.environ.get("CYLCONN_CACHE_DIR")
    caches = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    roots = [Path(home) if home else caches / "cylconn_ros"]
    roots += [
        Path(root, f"cylconn_ros-{os.getuid()}") for root in (tempfile.gettempdir(), _SHARED_MEMORY)
    ]
    for root in roots:
        directory = root / digest(Path(__file__).parent.parent)
        with contextlib.suppress(OSError):
            directory.mkdir(parents=True, exist_ok=True)
            disk = os.statvfs(directory)
            if os.access(directory, os.W_OK) and disk.f_bavail * disk.f_frsize > _LEAST_SPACE:
                return str(directory)
    return ""


CACHE_DIRECTORY = cache_directory() if COMPILED else ""
"""The cache directory of this process."""

if COMPILED:
    from llvmlite import ir
    from numba.core import event, sigutils
    from numba.core.ccallback import CFunc
    from numba.core.typing.templates import infer_global
    from numba.extending import intrinsic, models, register_model
    from numba.np.arrayobj import populate_array

    from cylconn_ros.core.device_compiler import device_compiler

    # 1/0 is inf, as in C. No contraction of a b + c (fused multiply-add): 20 % faster, but its
    # rounding depends on inlining, so that two compilations of one source would differ in their
    # last digits.
    _OPTIONS: dict[str, Any] = {"error_model": "numpy"}

    class _DeviceType(numba.types.Dispatcher):
        """Type of a device function: constants as arguments do not compile it anew."""

        def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
            """Type of a call, for the types of its arguments without their values."""
            plain = numba.types.unliteral
            named = {name: plain(kind) for name, kind in kws.items()}
            return super().get_call_type(context, [plain(kind) for kind in args], named)

    register_model(_DeviceType)(models.OpaqueModel)

    def _device(function: Function, inline: bool, allocates: bool = False) -> Function:
        """Let numba compile ``function`` where a kernel calls it; Python calls it as it is.

        All callers share one compilation: the options are stated, not those of the caller.
        """
        compiled = numba.njit(
            **_OPTIONS, _nrt=allocates, forceinline=inline, no_cpython_wrapper=True,
            no_cfunc_wrapper=True, **device_compiler(),
        )(function)  # fmt: skip
        _device_functions[function] = compiled
        infer_global(function, _DeviceType(compiled))
        return function

    def device_function(function: Function) -> Function:
        """Compile ``function`` for the kernels that call it. It must not allocate arrays."""
        return _device(function, False)

    def allocating_function(function: Function) -> Function:
        """Compile a device function that allocates or copies arrays, for allocating kernels."""
        return _device(function, False, allocates=True)

    def inline_function(function: Function) -> Function:
        """Compile ``function`` into each of its callers: for small functions."""
        return _device(function, True)

    def _kernel(function: Function, allocates: bool = False, nogil: bool = False) -> Function:
        compiled: Any = numba.njit(**_OPTIONS, _nrt=allocates, nogil=nogil)(function)
        compiled._cache = KernelCache(function, CACHE_DIRECTORY)
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
    def vector(_context: Any, _pointer: Any, _size: Any) -> tuple[Any, Any]:
        """The ``size`` numbers at a pointer that a C function received, as an array.

        ``numba.carray`` does the same, but needs numba's runtime.
        """
        number, whole = numba.types.float64, numba.types.int64

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            array = context.make_array(signature.return_type)(context, builder)
            width = context.get_constant(numba.types.intp, 8)
            populate_array(
                array, data=values[0], shape=[values[1]], strides=[width], itemsize=width,
                meminfo=None,
            )  # fmt: skip
            return array._getvalue()

        return numba.types.Array(number, 1, "C")(numba.types.CPointer(number), whole), generate

    @intrinsic
    def call_step(
        _context: Any, handle: Any, par: Any, mem: Any, sample: Any, h: Any, out: Any
    ) -> tuple[Any, Any]:
        """Call a C function of the signature of a step (methods/dispatch.py); return its int."""
        whole = numba.types.int64

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            wide, pointer = ir.IntType(64), ir.DoubleType().as_pointer()
            kind = ir.FunctionType(
                wide, [pointer, wide, pointer, pointer, ir.DoubleType(), pointer]
            )
            arrays = {
                k: context.make_array(signature.args[k])(context, builder, values[k])
                for k in (1, 2, 3, 5)
            }
            size = builder.extract_value(arrays[1].shape, 0)
            function = builder.inttoptr(values[0], kind.as_pointer())
            par, mem, sample, out = (arrays[k].data for k in (1, 2, 3, 5))
            return builder.call(function, [par, size, mem, sample, values[4], out])

        return whole(handle, par, mem, sample, numba.types.float64, out), generate

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

    class _Listener(event.Listener):
        """Counts the functions of this package that are compiled."""

        def __init__(self, report: Callable[[int, str], object]) -> None:
            self._report, self._count = report, 0

        def on_start(self, event: Any) -> None:
            """A function begins."""

        def on_end(self, event: Any) -> None:
            """A function, and all that it calls, is done."""
            function = event.data["dispatcher"].py_func
            if function.__module__.startswith("cylconn_ros."):
                self._count += 1
                self._report(self._count, function.__qualname__)

    @contextlib.contextmanager
    def watched(report: Callable[[int, str], object]) -> Iterator[None]:
        """Call ``report`` with number and name of each function compiled within the block."""
        with event.install_listener("numba:compile", _Listener(report)):
            yield

    def close_signatures(function: Callable[..., Any]) -> None:
        """Refuse arguments of other types than those compiled so far: TypeError, no compilation."""
        function.disable_compile()  # type: ignore[attr-defined]

else:

    def device_function(function: Function) -> Function:
        """Return ``function`` unchanged: no compiler is installed."""
        return function

    inline_function = device_function
    allocating_function = device_function

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

    @contextlib.contextmanager
    def watched(report: Callable[[int, str], object]) -> Iterator[None]:
        """Nothing to report: nothing is compiled."""
        yield

    def close_signatures(function: Callable[..., Any]) -> None:
        """Nothing to refuse: nothing is compiled."""

    def vector(pointer: Any, _size: int) -> Any:
        """The array, which is given in place of a pointer."""
        return pointer

    def call_step(handle: Any, par: Any, mem: Any, sample: Any, h: float, out: Any) -> int:
        """Call a step function."""
        status: int = handle(par, len(par), mem, sample, h, out)
        return status

    def call(address: int, first: int, second: int, third: int, fourth: int) -> int:
        """Raise RuntimeError: calls by address need the compiler."""
        raise RuntimeError("numba is not installed: C functions cannot be called by address")


class CFunction:
    """A kernel with a C signature, compiled at the first use of its :attr:`handle`.

    Attributes
    ----------
        function: the function, uncompiled.
    """

    def __init__(self, function: Callable[..., Any], signature: str) -> None:
        self.function, self._signature = function, signature
        self._cache = KernelCache(function, CACHE_DIRECTORY) if COMPILED else None
        self._compiled: Any = None

    @property
    def handle(self) -> Any:
        """For :func:`call_step`: the address, or the function itself if nothing is compiled."""
        if not COMPILED:
            return self.function
        if self._compiled is None:
            signature = sigutils.normalize_signature(self._signature)
            compiled: Any = CFunc(self.function, signature, {}, {**_OPTIONS, "_nrt": False})
            compiled._cache = self._cache
            compiled.compile()
            self._compiled = compiled
        return self._compiled.address

    @property
    def signatures(self) -> list[str]:
        """The signature, if it is loaded."""
        return [] if self._compiled is None else [self._signature]


def reached_from(functions: Iterable[Any]) -> int:
    """Number of functions that are compiled for the given kernels, themselves included."""
    found: set[Any] = set()
    pending = [getattr(one, "py_func", getattr(one, "function", one)) for one in functions]
    while pending:
        function = pending.pop()
        if function in found:
            continue
        found.add(function)
        names = [name for code in _codes(function.__code__) for name in code.co_names]
        known = [function.__globals__.get(name) for name in names]
        known += [
            vars(module).get(name)
            for module in known if isinstance(module, types.ModuleType) for name in names
        ]  # fmt: skip
        pending += [one for one in known if callable(one) and one in _device_functions]
    return len(found)


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """A code object and those within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def is_ready(kernel: Any) -> bool:
    """Whether a kernel runs without compilation: it is loaded, or its code is in the cache."""
    return not COMPILED or bool(kernel.signatures) or bool(kernel._cache.is_stored())


def c_function(signature: str) -> Callable[[Callable[..., Any]], CFunction]:
    """Decorate a function of pointers and numbers that kernels call by its handle.

    ``signature`` is in numba's notation, with ``CPointer(float64)`` for vectors.
    """
    return functools.partial(CFunction, signature=signature)
