"""File of a page of findings: check of its name before the work, and writing."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path

import cylconn_ros
from cylconn_ros.errors import CommandError
from cylconn_ros.report.findings import Findings
from cylconn_ros.report.page import Fact, render_findings


def check_page(path: Path) -> None:
    """Raise CommandError if a page cannot be written to ``path``."""
    if path.suffix not in (".html", ".htm"):
        raise CommandError(f"{path}: the page must end in .html")
    if importlib.util.find_spec("bokeh") is None:
        raise CommandError("--report needs the package bokeh: pip install bokeh")


def write_page(
    path: Path,
    name: str,
    found: Findings,
    facts: Sequence[Fact],
    sources: Sequence[tuple[str, str]],
    parameters: str,
) -> None:
    """Write the page of the identification of the recording ``name``."""
    listed = [*sources, ("made by", f"cylconn_ros {cylconn_ros.__version__}")]
    text = render_findings(f"Friction of {name}", found, facts, listed, parameters)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None
