"""Results of a benchmark as data, and their JSON file.

Every measured number is kept, and every missing one has a reason.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from cylconn_ros.bench.common import machine
from cylconn_ros.bench.common.timing import Spread

FORMAT = 2
STEP = "time of a step"

Setting = float | int | str | bool
Status = Literal["not installed", "not applicable", "skipped", "failed"]
Errors = dict[str, tuple[float, str]]
"""Magnitude of the error of each quantity, with its unit; NaN if there is no value."""


@dataclass(frozen=True)
class Measurement:
    """One number: a quantity of one subject on one benchmark case.

    Attributes
    ----------
        case: benchmark case. subject: what was measured: a solver, a method, a node, a process.
        low, high: quartiles; NaN if the number was measured once. count: number of values.
        settings: of the subject. note: for the reader.
    """

    case: str
    subject: str
    quantity: str
    value: float
    unit: str
    low: float = math.nan
    high: float = math.nan
    count: int = 1
    settings: Mapping[str, Setting] = field(default_factory=dict)
    note: str = ""

    @classmethod
    def of(
        cls,
        case: str,
        subject: str,
        quantity: str,
        spread: Spread,
        unit: str,
        *,
        scale: float = 1.0,
        settings: Mapping[str, Setting] | None = None,
        note: str = "",
    ) -> Measurement:
        """A measurement with its spread, in units of 1/scale."""
        once = math.nan if spread.count == 1 else scale
        return cls(
            case, subject, quantity, spread.median * scale, unit,
            spread.low * once, spread.high * once, spread.count, settings or {}, note,
        )  # fmt: skip


@dataclass(frozen=True)
class Target:
    """A number and its upper limit; NaN if it could not be measured."""

    name: str
    value: float
    limit: float
    unit: str
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the value keeps the limit; None if there is no value."""
        return None if math.isnan(self.value) else self.value <= self.limit


@dataclass(frozen=True)
class NotMeasured:
    """A subject that has no result on a case, and why. Only ``failed`` indicates an error."""

    case: str
    subject: str
    status: Status
    reason: str


@dataclass
class Findings:
    """Everything that a part of a benchmark found."""

    targets: list[Target] = field(default_factory=list)
    measurements: list[Measurement] = field(default_factory=list)
    not_measured: list[NotMeasured] = field(default_factory=list)

    def add(self, other: Findings) -> None:
        """Append the findings of another part."""
        self.targets += other.targets
        self.measurements += other.measurements
        self.not_measured += other.not_measured

    def value(self, case: str, subject: str, quantity: str) -> float:
        """A measured number; NaN if there is none."""
        for m in self.measurements:
            if (m.case, m.subject, m.quantity) == (case, subject, quantity):
                return m.value
        return math.nan


@dataclass
class Report:
    """A whole benchmark: command, settings, findings and the machine."""

    command: str
    settings: Mapping[str, Setting]
    findings: Findings = field(default_factory=Findings)
    machine: Mapping[str, str] = field(default_factory=machine.describe)
    started: str = field(default_factory=lambda: time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()))

    @property
    def failed(self) -> list[NotMeasured]:
        """Measurements that failed with an error."""
        return [one for one in self.findings.not_measured if one.status == "failed"]

    @property
    def missed(self) -> list[Target]:
        """Targets that were measured and not met."""
        return [target for target in self.findings.targets if target.met is False]

    def data(self) -> dict[str, Any]:
        """The whole report for JSON; numbers that are not finite become null."""
        found: dict[str, Any] = {
            "format": FORMAT,
            "command": self.command,
            "started": self.started,
            "settings": dict(self.settings),
            "machine": dict(self.machine),
            "targets": [{**asdict(t), "met": t.met} for t in self.findings.targets],
            "measurements": [asdict(m) for m in self.findings.measurements],
            "not_measured": [asdict(one) for one in self.findings.not_measured],
        }
        return _without_nan(found)

    def json(self) -> str:
        """The data as text."""
        return json.dumps(self.data(), indent=1, allow_nan=False) + "\n"


def read(file: Path) -> Report:
    """The report in a file written by ``cylconn bench -o``.

    Raises ValueError if the file holds no such report, OSError if it cannot be read.
    """
    try:
        data: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if data["format"] != FORMAT:
            raise ValueError(f"format {data['format']}: must be {FORMAT}")
        found = Findings(
            [_target(t) for t in data["targets"]],
            [Measurement(**_with_nan(m, "value", "low", "high")) for m in data["measurements"]],
            [NotMeasured(**one) for one in data["not_measured"]],
        )
        return Report(data["command"], data["settings"], found, data["machine"], data["started"])
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"no results of a benchmark: {error}") from None


def merge_cases(missing: Sequence[NotMeasured], separator: str = ", ") -> list[NotMeasured]:
    """One entry for all cases that a subject is missing on for the same reason."""
    groups: dict[tuple[str, str, str], list[NotMeasured]] = {}
    for one in missing:
        groups.setdefault((one.subject, one.status, one.reason), []).append(one)
    return [
        replace(group[0], case=separator.join(one.case for one in group))
        for group in groups.values()
    ]


def _target(data: dict[str, Any]) -> Target:
    stored = {key: value for key, value in data.items() if key != "met"}
    return Target(**_with_nan(stored, "value", "limit"))


def _with_nan(data: dict[str, Any], *names: str) -> dict[str, Any]:
    """Null back to NaN for the named numbers."""
    return {k: math.nan if k in names and v is None else v for k, v in data.items()}


def _without_nan(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _without_nan(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(one) for one in value]
    return value
