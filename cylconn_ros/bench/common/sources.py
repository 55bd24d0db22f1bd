"""Digests of source files, over their syntax trees: comments, docstrings and layout do not count.

- :func:`kernel`: the files that the numbers of every table depend on. A table in ``docs`` states
  it, to be compared with that of the package.
- :func:`measured`: everything that runs while a benchmark measures, the benchmarks included.
  Results are taken up again by an interrupted run only if it is the same.

A syntax tree is written out node by node. Fields that are absent or empty are left out, since the
versions of Python differ in them; positions are left out too.
"""

from __future__ import annotations

import ast
import functools
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import cylconn_ros

KERNEL = (
    "core", "methods", "scene/packing.py", "scene/elements.py", "scene/amplitude.py",
    "scene/initial.py", "connector/batch.py", "connector/connector.py", "connector/group.py",
    "connector/over_time.py", "simulation",
)  # fmt: skip
"""Physics, methods, packed parameters, the connector's step, the compiled loop and the plant."""
MEASURED = (
    "core", "methods", "scene", "connector", "simulation", "messages", "recording", "replay", "ros",
    "identification", "laws", "reference", "process", "mujoco", "mechanism", "bench",
)  # fmt: skip
"""Packages whose code runs while a benchmark measures."""
DIGITS = 12  # hexadecimal digits of a digest


def kernel(root: Path | None = None) -> str:
    """Digest of the kernel's files (KERNEL) below the package's folder."""
    return digest(KERNEL, root)


def measured(root: Path | None = None) -> str:
    """Digest of all files that run while a benchmark measures (MEASURED)."""
    return digest(MEASURED, root)


def digest(names: Sequence[str], root: Path | None = None) -> str:
    """Digest of the Python files and folders ``names``, subfolders included, below ``root``.

    The names of the files count. Raises FileNotFoundError if one of ``names`` does not exist.
    """
    base = root or Path(cylconn_ros.__file__).parent
    total = hashlib.sha256()
    for path in _files(base, names):
        total.update(f"{path.relative_to(base).as_posix()}\n{of_file(path)}\n".encode())
    return total.hexdigest()[:DIGITS]


def of_file(path: Path) -> str:
    """Digest of one file's syntax tree."""
    status = path.stat()
    return _cached(path, status.st_mtime_ns, status.st_size)


@functools.lru_cache(maxsize=1024)
def _cached(path: Path, _changed: int, _size: int) -> str:
    return of_source(path.read_text(encoding="utf-8"))


def of_source(source: str) -> str:
    """Digest of the syntax tree of a Python source, without docstrings."""
    parts: list[str] = []
    _write(ast.parse(source), parts)
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def _files(base: Path, names: Iterable[str]) -> Iterator[Path]:
    for name in names:
        path = base / name
        if not path.exists():
            raise FileNotFoundError(f"{path}: belongs to the digest and does not exist")
        yield from [path] if path.is_file() else sorted(path.rglob("*.py"))


def _write(node: ast.AST, parts: list[str]) -> None:
    """Append the tree as text: class of each node, its fields that are not empty, in order."""
    parts.append(f"({type(node).__name__}")
    for name in node._fields:
        value = getattr(node, name, None)
        if value is None or name in ("kind", "type_comment", "ctx"):
            continue
        values = value if isinstance(value, list) else [value]
        if name == "body":
            values = [one for one in values if not _is_text(one)]
        if not values:
            continue
        parts.append(f" {name}=")
        for one in values:
            if isinstance(one, ast.AST):
                _write(one, parts)
            else:
                parts.append(f" {type(one).__name__}:{one!r}")
    parts.append(")")


def _is_text(statement: object) -> bool:
    """Whether a statement is a text that stands alone: a docstring, also that of a constant."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
