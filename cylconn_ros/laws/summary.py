"""What a check amounts to: the worst residual of each law and where, samples in each regime."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.normalised import TOLERANCE

Array = NDArray[np.float64]

REGIMES = ("slip", "stick", "frictionless", "several roots", "jam", "stop", "restitution")
STEERED = ("slip", "stick", "several roots", "jam", "stop", "restitution")
LEAST_SHARE = 0.01
"""Of the samples, in each of the regimes that the draw is steered to."""


@dataclasses.dataclass
class Worst:
    """The worst residual of a law."""

    value: float = 0.0
    where: str = ""
    samples: int = 0  # that the law speaks of
    over: int = 0  # beyond the tolerance

    @property
    def holds(self) -> bool:
        """Whether the law was within its tolerance on every sample."""
        return self.over == 0


@dataclasses.dataclass
class Tally:
    """Worst residuals by letter, samples by regime."""

    laws: dict[str, Worst] = dataclasses.field(default_factory=dict)
    regimes: dict[str, int] = dataclasses.field(default_factory=lambda: dict.fromkeys(REGIMES, 0))
    samples: int = 0

    def add(
        self, residuals: Mapping[str, Array], out: Array, where: Sequence[NDArray[np.intp]]
    ) -> None:
        """Count (n,) residuals by letter and (n, NOUT) answers; where: columns that name a row."""
        self.count(residuals, len(out), where)
        for name, rows in regimes(out).items():
            self.regimes[name] += int(rows.sum())

    def count(
        self, residuals: Mapping[str, Array], samples: int, where: Sequence[NDArray[np.intp]]
    ) -> None:
        """Count (n,) residuals by letter of n samples that are in no regime."""
        self.samples += samples
        for letter, values in residuals.items():
            law = self.laws.setdefault(letter, Worst())
            said = ~np.isnan(values)
            law.samples += int(said.sum())
            law.over += int((values[said] > TOLERANCE).sum())
            if said.any() and (not law.where or np.nanmax(values) > law.value):
                row = int(np.nanargmax(values))
                law.value = float(values[row])
                law.where = "/".join(str(int(column[row])) for column in where)

    def named(self, name: str) -> Tally:
        """The tally with ``name`` before every place."""
        for law in self.laws.values():
            law.where = f"{name}/{law.where}" if law.where else ""
        return self

    def merge(self, other: Tally) -> None:
        """Take in another tally."""
        self.samples += other.samples
        for name, count in other.regimes.items():
            self.regimes[name] += count
        for letter, theirs in other.laws.items():
            mine = self.laws.setdefault(letter, Worst())
            worst = theirs if not mine.where or theirs.value > mine.value else mine
            mine.value, mine.where = worst.value, worst.where
            mine.samples += theirs.samples
            mine.over += theirs.over

    @property
    def holds(self) -> bool:
        """Whether every law held."""
        return all(law.holds for law in self.laws.values())

    def scarce(self) -> list[str]:
        """The regimes that the draw is steered to and that were hardly met all the same."""
        return [name for name in STEERED if self.share(name) < LEAST_SHARE]

    def share(self, regime: str) -> float:
        """The part of the samples that were in a regime."""
        return self.regimes[regime] / max(self.samples, 1)


def regimes(out: Array) -> dict[str, NDArray[np.bool_]]:
    """Which of (n, NOUT) answers were in which regime; they overlap."""
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
    }
