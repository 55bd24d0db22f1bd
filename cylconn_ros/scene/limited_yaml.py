"""YAML from any source, within limits: what a file means takes no more memory than it should.

PyYAML resolves aliases without counting them, recurses into nested collections, and raises plain
Python exceptions for values such as ``2020-13-45``. :class:`Loader` refuses all of these with one
sentence and the line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

MAX_BYTES = 1 << 22  # 4 MB: what parses in a few seconds
MAX_VALUES = 200_000
"""Values of a document at most, each use of an alias counted with all that it stands for."""
MAX_DEPTH = 64
_SHOWN = 40  # characters of a value in a message


class Loader(yaml.SafeLoader):
    """PyYAML's safe loader; raises ConstructorError or another YAMLError, and nothing else."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._values = self._depth = 0
        self._open: set[str] = set()  # anchors of the collections around the current value
        self._weights: dict[str, int] = {}  # values below each anchor

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a value; count it, and what an alias stands for."""
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            if event.anchor in self._open:
                raise _error(f"*{event.anchor} stands for a value that contains it", event)
            self._count(self._weights.get(event.anchor or "", 1), event)
            return super().compose_node(parent, index)
        before, anchor = self._values, event.anchor
        self._count(1, event)
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise _error(f"more than {MAX_DEPTH} levels of nesting", event)
        if anchor is not None:
            self._open.add(anchor)
        node = super().compose_node(parent, index)
        if anchor is not None:
            self._open.discard(anchor)
            self._weights[anchor] = self._values - before
        self._depth -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Construct a value; one that Python cannot represent is a YAML error with its line."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, TypeError, OverflowError, AttributeError, LookupError):
            text = node.value if isinstance(node, yaml.ScalarNode) else "this collection"
            kind = node.tag.rpartition(":")[2]
            raise _error(f"{_short(text)} is not a valid {kind}", node) from None

    def _count(self, number: int, event: yaml.Event) -> None:
        self._values += number
        if self._values > MAX_VALUES:
            raise _error(f"more than {MAX_VALUES} values, with those that aliases stand for", event)


def load(text: str, loader: type[Loader] = Loader) -> Any:
    """Parse one document; raise ValueError with the reason, and the line if there is one."""
    if len(text) > MAX_BYTES:
        raise ValueError(f"{len(text)} characters: more than {MAX_BYTES}")
    try:
        return yaml.load(text, Loader=loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        reason = getattr(error, "problem", None) or str(error).partition("\n")[0]
        raise ValueError(f"{where}{reason}") from None
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_text(path: Path) -> str:
    """Read a text file.

    Raises OSError if it cannot be read, and ValueError if it is no regular file (reading a named
    pipe would not end), too large, or not UTF-8.
    """
    status = path.stat()
    if not path.is_file():
        raise ValueError("is not a regular file")
    if status.st_size > MAX_BYTES:
        raise ValueError(f"{status.st_size} bytes: more than {MAX_BYTES}")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"is not UTF-8 text (byte {error.start})") from None


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}… ({len(text)} characters)"


def _error(text: str, place: Any) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(None, None, text, place.start_mark)
