"""The two benchmarks of reliability, faults and soak, with what their room does not know."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli import lawful
from cylconn_ros.cli.processes import private_environment
from cylconn_ros.cli.progress import Progress

if TYPE_CHECKING:
    from cylconn_ros.bench.results import Findings
    from cylconn_ros.bench.settings import Settings
    from cylconn_ros.bench.soak import Checked


def soak(samples: int | None) -> Callable[[Settings], Findings]:
    """The measuring of a soak of so many samples; None: as many as its form says."""

    def measure(settings: Settings) -> Findings:
        from cylconn_ros.bench import soak

        count = samples or (soak.QUICK if settings.quick else soak.SAMPLES)
        with Progress("soak") as bar:
            return soak.measure(count, private_environment(), check, bar)

    return measure


def check(run: Path) -> Checked:
    """What the laws say of a recording."""
    from cylconn_ros.bench.soak import Checked, Law
    from cylconn_ros.laws.claims import TITLES

    with Progress("laws") as bar:
        _, tally = lawful.checked(run, bar)
    laws = [
        Law(f"{letter} {title}", law.samples, law.value, law.over)
        for letter, title in TITLES.items()
        if (law := tally.laws.get(letter)) is not None and law.samples
    ]
    return Checked(tally.samples, laws, dict(tally.regimes))
