"""What a benchmark found, as data: nothing measured is dropped, nothing missing is silent."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from cylconn_ros.bench.common import machine
from cylconn_ros.bench.common.timing import Spread

FORMAT = 1
STEP = "time of a step"

Setting = float | int | str | bool


@dataclass(frozen=True)
class Measurement:
    """One number: of which contestant on which problem, with which settings.

    ``low``, ``high``: quartiles, NaN where the number was found once. ``count``: values behind it.
    """

    problem: str
    contestant: str
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
        problem: str,
        contestant: str,
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
            problem, contestant, quantity, spread.median * scale, unit,
            spread.low * once, spread.high * once, spread.count, settings or {}, note,
        )  # fmt: skip


@dataclass(frozen=True)
class Target:
    """A number and what it should not exceed; NaN where it could not be measured."""

    name: str
    value: float
    limit: float
    unit: str
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether it is; None where there is nothing to judge."""
        return None if math.isnan(self.value) else self.value <= self.limit


@dataclass(frozen=True)
class Gap:
    """What is not in the results: ``absent`` (not installed, not written), ``left out`` or failed.

    Only ``failed`` says that something is wrong.
    """

    problem: str
    contestant: str
    status: Literal["absent", "left out", "failed"]
    reason: str


@dataclass
class Findings:
    """What one part of a benchmark found."""

    targets: list[Target] = field(default_factory=list)
    measurements: list[Measurement] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)

    def add(self, other: Findings) -> None:
        """Append another part's."""
        self.targets += other.targets
        self.measurements += other.measurements
        self.gaps += other.gaps

    def value(self, problem: str, contestant: str, quantity: str) -> float:
        """A number found; NaN where it was not."""
        for m in self.measurements:
            if (m.problem, m.contestant, m.quantity) == (problem, contestant, quantity):
                return m.value
        return math.nan


@dataclass
class Report:
    """A whole benchmark: how, on what, and what came out."""

    command: str
    settings: Mapping[str, Setting]
    findings: Findings = field(default_factory=Findings)
    machine: Mapping[str, str] = field(default_factory=machine.describe)
    started: str = field(default_factory=lambda: time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()))

    @property
    def failed(self) -> list[Gap]:
        """What should have been measured and could not."""
        return [gap for gap in self.findings.gaps if gap.status == "failed"]

    @property
    def missed(self) -> list[Target]:
        """Targets that were measured and not met."""
        return [target for target in self.findings.targets if target.met is False]

    def data(self) -> dict[str, Any]:
        """Everything, for JSON: numbers that are not finite become null."""
        found: dict[str, Any] = {
            "format": FORMAT,
            "command": self.command,
            "started": self.started,
            "settings": dict(self.settings),
            "machine": dict(self.machine),
            "targets": [{**asdict(t), "met": t.met} for t in self.findings.targets],
            "measurements": [asdict(m) for m in self.findings.measurements],
            "gaps": [asdict(gap) for gap in self.findings.gaps],
        }
        return _finite(found)

    def json(self) -> str:
        """The data as text."""
        return json.dumps(self.data(), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return value
