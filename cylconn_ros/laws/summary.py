"""Summary of a law check: the largest residual of each law and its sample, samples per regime."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.normalised import TOLERANCE

Array = NDArray[np.float64]

REGIMES = (
    "slip", "stick", "frictionless", "several roots", "jam", "stop", "restitution", "not converged",
)  # fmt: skip
REQUIRED_REGIMES = ("slip", "stick", "several roots", "jam", "stop", "restitution")
LEAST_SHARE = 0.01
"""Share of the random samples that each required regime has to reach."""


@dataclasses.dataclass
class LawResult:
    """Residuals of one law, reduced."""

    worst: float = 0.0
    location: str = ""  # of the sample with the largest residual
    samples: int = 0  # to which the law applies
    violations: int = 0  # samples whose residual exceeds the tolerance

    @property
    def holds(self) -> bool:
        """Whether the residual is within the tolerance for every sample."""
        return self.violations == 0


@dataclasses.dataclass
class LawSummary:
    """Results by law, and samples by regime."""

    laws: dict[str, LawResult] = dataclasses.field(default_factory=dict)
    regimes: dict[str, int] = dataclasses.field(default_factory=lambda: dict.fromkeys(REGIMES, 0))
    samples: int = 0
    tolerance: float = TOLERANCE

    def add(
        self, residuals: Mapping[str, Array], out: Array, columns: Sequence[NDArray[np.intp]]
    ) -> None:
        """Add (n,) residuals by law and (n, NOUT) outputs; columns: numbers that name each row."""
        self.add_residuals(residuals, len(out), columns)
        for name, rows in regimes(out).items():
            self.regimes[name] += int(rows.sum())

    def add_residuals(
        self, residuals: Mapping[str, Array], samples: int, columns: Sequence[NDArray[np.intp]]
    ) -> None:
        """Add (n,) residuals by law of n samples whose regimes are not counted."""
        self.samples += samples
        for name, values in residuals.items():
            law = self.laws.setdefault(name, LawResult())
            applies = ~np.isnan(values)
            law.samples += int(applies.sum())
            law.violations += int((values[applies] > self.tolerance).sum())
            if applies.any() and (not law.location or np.nanmax(values) > law.worst):
                row = int(np.nanargmax(values))
                law.worst = float(values[row])
                law.location = "/".join(str(int(column[row])) for column in columns)

    def with_prefix(self, name: str) -> LawSummary:
        """Put ``name`` in front of every location; returns the summary itself."""
        for law in self.laws.values():
            law.location = f"{name}/{law.location}" if law.location else ""
        return self

    def merge(self, other: LawSummary) -> None:
        """Add the results and counts of another summary."""
        self.samples += other.samples
        for name, count in other.regimes.items():
            self.regimes[name] += count
        for name, theirs in other.laws.items():
            mine = self.laws.setdefault(name, LawResult())
            worst = theirs if not mine.location or theirs.worst > mine.worst else mine
            mine.worst, mine.location = worst.worst, worst.location
            mine.samples += theirs.samples
            mine.violations += theirs.violations

    def rare_regimes(self) -> list[str]:
        """The required regimes with less than LEAST_SHARE of the samples."""
        return [name for name in REQUIRED_REGIMES if self.share(name) < LEAST_SHARE]

    def share(self, regime: str) -> float:
        """The share of the samples that are in a regime."""
        return self.regimes[regime] / max(self.samples, 1)


def regimes(out: Array) -> dict[str, NDArray[np.bool_]]:
    """Membership (n,) of (n, NOUT) outputs in each regime; regimes overlap."""
    flags = out[:, layout.FLAGS].astype(np.int64)
    regime = out[:, layout.REGIME]
    return {
        "slip": regime == layout.SLIP,
        "stick": regime == layout.STICK,
        "frictionless": regime == layout.FRICTIONLESS,
        "several roots": flags & layout.SEVERAL_ROOTS != 0,
        "jam": flags & layout.JAMMED != 0,
        "stop": out[:, layout.STOP] != 0,
        "restitution": out[:, layout.RESTITUTION] > 0.0,
        "not converged": flags & layout.NOT_CONVERGED != 0,
    }
