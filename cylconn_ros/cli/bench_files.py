"""Files of ``cylconn bench``: results, pages and pictures, checked before they are needed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.errors import CommandError

if TYPE_CHECKING:  # importing a benchmark imports the compiler, which --help does not need
    from cylconn_ros.bench.common.results import Report
    from cylconn_ros.cli.benchmarks import Benchmark


def read_results(file: Path, command: str) -> Report:
    """Results of a command, of any form, kept in a file. Raises CommandError if there are none."""
    from cylconn_ros.bench.common import results

    try:
        report = results.read(file)
    except OSError as error:
        raise CommandError(f"{file}: {error.strerror or error}") from None
    except ValueError as error:
        raise CommandError(f"{file}: {error}") from None
    if not f"{report.command} ".startswith(f"{command} "):
        raise CommandError(f"{file}: holds results of {report.command}, not of {command}")
    return report


def check_new(file: Path) -> None:
    """Raise CommandError if results cannot be kept in a file."""
    if file.suffix != ".json":
        raise CommandError(f"{file}: results end in .json")
    if file.exists():
        raise CommandError(f"{file} exists; results are never overwritten")


def check_page(page: Path, command: str) -> None:
    """Raise CommandError if a page has no place for the results of a command."""
    _replaced(page, command, "")


def write_results(file: Path, report: Report) -> None:
    """Keep results in a new file."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("x", encoding="utf-8") as stream:
            stream.write(report.json())
    except OSError as error:
        raise CommandError(f"{error.filename}: {error.strerror or error}") from None


def write_page(page: Path, command: str, text: str) -> None:
    """Replace the results of a command in a page."""
    new = _replaced(page, command, text)
    try:
        page.write_text(new, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{page}: {error.strerror or error}") from None


def draw(bench: Benchmark, folder: Path, report: Report) -> list[Path]:
    """Draw the pictures of a benchmark into a folder and return the files."""
    if bench.draw is None:
        return []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return list(bench.draw(folder, report))
    except OSError as error:
        raise CommandError(f"{error.filename}: {error.strerror or error}") from None
    except ImportError as error:
        raise CommandError(f"--pictures: {error}; install it with pip install '.[demo]'") from None


def _replaced(page: Path, command: str, text: str) -> str:
    from cylconn_ros.bench.common.report import replace_results

    try:
        return replace_results(page.read_text(encoding="utf-8"), command, text)
    except OSError as error:
        raise CommandError(f"{page}: {error.strerror or error}") from None
    except ValueError as error:
        raise CommandError(f"{page}: {error}") from None
