"""Results with their bounds, printed so that a person can judge them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One line of a summary; ``ok`` None means there is nothing to judge."""

    name: str
    value: str
    bound: str = ""
    ok: bool | None = None


def below(name: str, value: float, limit: float, unit: str, note: str = "") -> Check:
    """Judge a size against its limit; NaN is never below."""
    text = f"{value:.3g} {unit}" + (f"  {note}" if note else "")
    return Check(name, text, f"at most {limit:.3g} {unit}", value <= limit)


def against(name: str, value: float, expected: float, limit: float, unit: str) -> Check:
    """Judge a value against an independent one."""
    error = abs(value - expected)
    text = f"{value:.6f} {unit}".rstrip() + f"  (reference {expected:.6f}, off by {error:.1e})"
    return Check(name, text, f"within {limit:.1e} {unit}", error <= limit)


def equal(name: str, value: int, expected: int) -> Check:
    """Judge a count."""
    return Check(name, f"{value}", f"exactly {expected}", value == expected)


def show(checks: Sequence[Check]) -> bool:
    """Print a summary; returns whether everything that was judged is well."""
    names = max(len(check.name) for check in checks)
    values = max((len(check.value) for check in checks if check.bound), default=0)
    for check in checks:
        mark = {True: _mark("✓", "+"), False: _mark("✗", "X"), None: " "}[check.ok]
        line = f"{mark} {check.name:<{names}}  {check.value:<{values}}  {check.bound}"
        print(line.rstrip())
    return all(check.ok is not False for check in checks)


def _mark(sign: str, plain: str) -> str:
    try:
        sign.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return plain
    return sign


def add_connector(parser: argparse.ArgumentParser) -> None:
    """Declare the argument that chooses one of several connectors in a recording."""
    parser.add_argument(
        "--connector", metavar="NAME", default="", help="which, where a run holds several"
    )
