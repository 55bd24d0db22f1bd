"""Abaqus input decks: keyword blocks, and the units that a deck does not state."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

from cylconn_ros.errors import ModelError

GREATEST_SIZE = 200_000_000  # bytes
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
_MASSES = {"kg": 1.0, "g": 1e-3, "t": 1e3}
_TIMES = {"s": 1.0, "ms": 1e-3}


@dataclasses.dataclass(frozen=True)
class Units:
    """SI values of the units of length (m), mass (kg) and time (s)."""

    length: float
    mass: float
    time: float

    @property
    def force(self) -> float:
        """N."""
        return self.mass * self.length / self.time**2

    @property
    def moment(self) -> float:
        """N m."""
        return self.force * self.length

    @property
    def inertia(self) -> float:
        """Of kg m^2."""
        return self.mass * self.length**2


def units(text: str | None) -> Units:
    """Units written as length-mass-time. Raises ModelError if they are not given or not known."""
    rule = (
        "--units: a deck carries no units; give length-mass-time, such as m-kg-s or mm-t-s "
        f"(lengths {', '.join(_LENGTHS)}; masses {', '.join(_MASSES)}; times {', '.join(_TIMES)})"
    )
    parts = (text or "").split("-")
    try:
        length, mass, time = parts
        return Units(_LENGTHS[length], _MASSES[mass], _TIMES[time])
    except (ValueError, KeyError):
        given = f"{text}: is not known; " if text else ""
        raise ModelError(given + rule) from None


@dataclasses.dataclass
class Block:
    """A keyword with its parameters (upper case names) and data lines; ``line``: from 1."""

    keyword: str
    parameters: dict[str, str]
    data: list[list[str]]
    line: int
    used: bool = False

    def numbers(self, row: int) -> list[float]:
        """Numbers of a data line; empty fields are 0. Raises ModelError."""
        if row >= len(self.data):
            raise ModelError(f"line {self.line}: *{self.keyword}: data line {row + 1} is missing")
        found = []
        for field in self.data[row]:
            try:
                found.append(float(re.sub("[dD]", "e", field)) if field else 0.0)
            except ValueError:
                raise ModelError(
                    f"line {self.line}: *{self.keyword}: {field} is not a number"
                ) from None
        return found

    def name(self, parameter: str) -> str:
        """A parameter in upper case, "" if it is not given."""
        return self.parameters.get(parameter, "").upper()


def read(path: Path) -> list[Block]:
    """The blocks of a deck. Raises ModelError, also for *INCLUDE: other files are not read."""
    try:
        if path.stat().st_size > GREATEST_SIZE:
            raise ModelError(f"{path}: larger than {GREATEST_SIZE} bytes")
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    blocks: list[Block] = []
    pending, started = "", 0
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if pending or line.startswith("*"):
            started = started if pending else number
            pending += line
            if pending.endswith(","):
                continue
            blocks.append(_keyword(pending, started))
            pending = ""
        elif not blocks:
            raise ModelError(f"{path}: line {number}: data before the first keyword")
        else:
            blocks[-1].data.append([field.strip() for field in line.rstrip(",").split(",")])
    if not blocks:
        raise ModelError(f"{path}: holds no keyword")
    for block in blocks:
        if block.keyword == "INCLUDE":
            raise ModelError(
                f"{path}: line {block.line}: *INCLUDE refers to another file, which is not read; "
                "put its text in its place"
            )
    return blocks


def _keyword(text: str, line: int) -> Block:
    first, *rest = [part.strip() for part in text.lstrip("*").split(",")]
    parameters = {}
    for part in rest:
        name, _, value = part.partition("=")
        if name:
            parameters[" ".join(name.upper().split())] = value.strip().strip('"')
    return Block(" ".join(first.upper().split()), parameters, [], line)
