"""Checks of results against their limits, printed one per line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the library imports the compiled physics
    from cylconn_ros.reference.library import Comparison


@dataclass(frozen=True)
class Check:
    """One line of a summary.

    Attributes
    ----------
        name, value: of the quantity, as printed.
        bound: the condition, as printed; empty for information only.
        ok: whether the condition holds; None for information only.
    """

    name: str
    value: str
    bound: str = ""
    ok: bool | None = None


def below(name: str, value: float, limit: float, unit: str, note: str = "") -> Check:
    """Check that a value is at most its limit; NaN fails."""
    text = f"{value:.3g} {unit}" + (f"  {note}" if note else "")
    return Check(name, text, f"at most {limit:.3g} {unit}", value <= limit)


def against(name: str, value: float, expected: float, limit: float, unit: str) -> Check:
    """Check that a value is within ``limit`` of an independent value; NaN fails."""
    error = abs(value - expected)
    text = f"{value:.6f} {unit}".rstrip() + f"  (reference {expected:.6f}, error {error:.1e})"
    return Check(name, text, f"within {limit:.1e} {unit}", error <= limit)


def comparisons(compared: Iterable[Comparison]) -> list[Check]:
    """A check for each quantity of a run that has a reference value."""
    return [
        against(each.name, each.value, each.expected, each.allowed, each.unit) for each in compared
    ]


def not_computed(error: ImportError) -> str:
    """Line in place of reference values that need a package that is not installed."""
    return f"            not computed: needs {error.name} (pip install '.[demo]')"


def equal(name: str, value: int, expected: int) -> Check:
    """Check a count."""
    return Check(name, f"{value}", f"exactly {expected}", value == expected)


def show(checks: Sequence[Check]) -> bool:
    """Print the checks; returns False if one of them fails."""
    names = max(len(check.name) for check in checks)
    values = max((len(check.value) for check in checks if check.bound), default=0)
    for check in checks:
        mark = {True: _mark("✓", "+"), False: _mark("✗", "X"), None: " "}[check.ok]
        line = f"{mark} {check.name:<{names}}  {check.value:<{values}}  {check.bound}"
        print(line.rstrip())
    return all(check.ok is not False for check in checks)


def _mark(sign: str, plain: str) -> str:
    """``sign``, or ``plain`` if the terminal cannot print it."""
    try:
        sign.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return plain
    return sign


def add_connector(parser: argparse.ArgumentParser) -> None:
    """Declare the argument that selects one of several connectors in a recording."""
    parser.add_argument(
        "--connector", metavar="NAME", default="", help="connector, if the run holds several"
    )


def add_recording(parser: argparse.ArgumentParser, name: str, metavar: str) -> None:
    """Declare the argument that names a recording: one or more files or directories."""
    parser.add_argument(
        name, metavar=metavar, type=Path, nargs="+",
        help="recorded directory or file; several are the parts of one recording",
    )  # fmt: skip
