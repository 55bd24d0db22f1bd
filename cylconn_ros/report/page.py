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
from cylconn_ros.report import findings
from cylconn_ros.report.findings import Findings

_STATIC = Path(__file__).parent / "static"
_LIBRARY = ("bokeh", "bokeh-api")
_RUN = (
    "data", "axis", "start", "chart", "events", "plane", "solid", "scene", "cursor", "main",
)  # fmt: skip
_FINDINGS = ("data", "axis", "start", "points", "findings")


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
        "facts": _facts(facts),
        "notes": "\n".join(f"<li>{html.escape(note)}</li>" for note in notes),
        "sources": _sources(sources),
        "parameters": html.escape(parameters or "none were stored with the run"),
    }
    return _assemble("page", ["page"], _RUN, title, parts, head, numbers)


def render_findings(
    title: str,
    found: Findings,
    facts: Sequence[Fact],
    sources: Sequence[tuple[str, str]],
    parameters: str,
) -> str:
    """Render a page of findings: verdict, facts, and sections with tables and plots.

    Arguments are those of :func:`render`; the data are those of the plots in ``found``.
    """
    head, numbers = findings.build(found)
    parts = {
        "verdict": findings.verdict_html(found),
        "facts": _facts(facts),
        "sections": "\n".join(findings.section_html(one) for one in found.sections),
        "sources": _sources(sources),
        "parameters": html.escape(parameters or "none were given"),
    }
    styles = ["page", "findings"]
    return _assemble("findings", styles, _FINDINGS, title, parts, head, numbers)


def _assemble(
    template: str,
    styles: Sequence[str],
    scripts: Sequence[str],
    title: str,
    parts: dict[str, str],
    head: dict[str, Any],
    numbers: str,
) -> str:
    """Fill a template of static/ with texts, style, scripts, library and data."""
    parts = {
        **parts,
        "title": html.escape(title),
        "style": _files(styles, "css"),
        "script": _files(scripts, "js"),
        "library": library(),
        # Within a script element only `<` can end the element or start a comment.
        "head": json.dumps(head, allow_nan=False).replace("<", "\\u003c"),
        "numbers": numbers,
    }
    # Split, not replaced one by one, since inserted text may itself contain a placeholder.
    pieces = (_STATIC / f"{template}.html").read_text(encoding="utf-8").split("%%")
    pieces[1::2] = [parts[name] for name in pieces[1::2]]
    return "".join(pieces)


def _files(names: Sequence[str], kind: str) -> str:
    return "\n".join((_STATIC / f"{name}.{kind}").read_text(encoding="utf-8") for name in names)


def _facts(facts: Sequence[Fact]) -> str:
    return "\n".join(_fact(fact) for fact in facts)


def _sources(sources: Sequence[tuple[str, str]]) -> str:
    return "\n".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in sources
    )


def _fact(fact: Fact) -> str:
    bad = ' class="bad"' if fact.bad else ""
    note = f"<small>{html.escape(fact.note)}</small>" if fact.note else ""
    return (
        f"<div{bad}><span>{html.escape(fact.label)}</span>"
        f"<strong>{html.escape(fact.value)}</strong>{note}</div>"
    )
