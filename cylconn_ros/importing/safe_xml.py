"""XML of models, read without entities, document types or references to other machines."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any
from xml.parsers import expat

from cylconn_ros.errors import ModelError

GREATEST_SIZE = 50_000_000  # bytes
GREATEST_DEPTH = 500  # elements within each other
_REFERENCES = ("file", "filename", "href", "url", "src")
_REMOTE = ("http:", "https:", "ftp:", "//")


def read(path: Path) -> ElementTree.Element:
    """The root element of a file.

    Raises ModelError for a file that cannot be read, is not XML, declares a document type or
    entities, or refers to another machine.
    """
    try:
        size = path.stat().st_size
        if size > GREATEST_SIZE:
            raise ModelError(f"{path}: {size} bytes; a model has at most {GREATEST_SIZE}")
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    return parse(data, str(path))


def parse(data: bytes, name: str) -> ElementTree.Element:
    """The root element of a document; ``name`` begins the text of an error (see :func:`read`)."""
    builder, depth = ElementTree.TreeBuilder(), 0
    parser = expat.ParserCreate()

    def refuse(*_: Any) -> None:
        line = parser.CurrentLineNumber
        raise ModelError(
            f"{name}: line {line}: declares a document type or an entity; a model needs none, and "
            "they can read other files or fill the memory: remove the declaration"
        )

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > GREATEST_DEPTH:
            raise ModelError(f"{name}: more than {GREATEST_DEPTH} elements within each other")
        for key in _REFERENCES:
            if attributes.get(key, "").strip().lower().startswith(_REMOTE):
                raise ModelError(
                    f"{name}: line {parser.CurrentLineNumber}: {tag} refers to "
                    f"{attributes[key]}; only local files are read"
                )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ModelError(f"{name}: is not XML: {error}") from None
    return builder.close()
