"""Renderer of the self-contained HTML page: template, style, scripts and data in one file."""

from __future__ import annotations

import html
import importlib.util
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cylconn_ros.errors import RecordingError

_STATIC = Path(__file__).parent / "static"
_LIBRARY = ("bokeh", "bokeh-api")
_SCRIPTS = ("data", "axis", "chart", "events", "plane", "solid", "scene", "cursor", "main")


def library() -> str:
    """Return the script of BokehJS, core and plotting interface, for a script element.

    It is read from the installed package without importing it, which would take a second.

    Raises
    ------
    RecordingError
        Bokeh is not installed.

    """
    found = importlib.util.find_spec("bokeh")
    if found is None or found.origin is None:
        raise RecordingError("the report page needs the package bokeh: pip install bokeh")
    folder = Path(found.origin).parent / "server" / "static" / "js"
    texts = [(folder / f"{name}.min.js").read_text(encoding="utf-8") for name in _LIBRARY]
    return "\n".join(texts).replace("</script", "<\\/script")


@dataclass(frozen=True)
class Fact:
    """One entry of the summary; ``bad`` highlights a problem."""

    label: str
    value: str
    note: str = ""
    bad: bool = False


def render(
    title: str,
    facts: Sequence[Fact],
    notes: Sequence[str],
    sources: Sequence[tuple[str, str]],
    parameters: str,
    head: dict[str, Any],
    numbers: str,
) -> str:
    """Render a page.

    Parameters
    ----------
    title
        Heading of the page.
    facts, notes
        The summary; remarks for its interpretation.
    sources
        Name and value of the origin of the run: version, method, model, file.
    parameters
        The parameters in force, as a parameter file.
    head, numbers
        From :func:`payload.build_payload`.

    """
    parts = {
        "title": html.escape(title),
        "facts": "\n".join(_fact(fact) for fact in facts),
        "notes": "\n".join(f"<li>{html.escape(note)}</li>" for note in notes),
        "sources": "\n".join(
            f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in sources
        ),
        "parameters": html.escape(parameters or "none were stored with the run"),
        "style": (_STATIC / "page.css").read_text(encoding="utf-8"),
        "script": "\n".join(
            (_STATIC / f"{name}.js").read_text(encoding="utf-8") for name in _SCRIPTS
        ),
        "library": library(),
        # Within a script element only `<` can end the element or start a comment.
        "head": json.dumps(head, allow_nan=False).replace("<", "\\u003c"),
        "numbers": numbers,
    }
    # Split, not replaced one by one, since inserted text may itself contain a placeholder.
    pieces = (_STATIC / "page.html").read_text(encoding="utf-8").split("%%")
    pieces[1::2] = [parts[name] for name in pieces[1::2]]
    return "".join(pieces)


def _fact(fact: Fact) -> str:
    bad = ' class="bad"' if fact.bad else ""
    note = f"<small>{html.escape(fact.note)}</small>" if fact.note else ""
    return (
        f"<div{bad}><span>{html.escape(fact.label)}</span>"
        f"<strong>{html.escape(fact.value)}</strong>{note}</div>"
    )
