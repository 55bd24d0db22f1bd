"""The two benchmarks of reliability, faults and soak, with what their room does not know."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli.progress import Progress
from cylconn_ros.laws import runs_recorded_or_simulated
from cylconn_ros.process.child import private_environment

if TYPE_CHECKING:
    from cylconn_ros.bench.common.results import Findings
    from cylconn_ros.bench.common.settings import Settings
    from cylconn_ros.bench.faults.soak_report import Checked


def soak(settings: Settings) -> Findings:
    """A soak of as many samples as the settings say."""
    from cylconn_ros.bench.faults import soak_report

    samples = settings.samples or (soak_report.QUICK if settings.quick else soak_report.SAMPLES)
    with Progress("soak") as bar:
        return soak_report.measure(samples, private_environment(), check, bar)


def check(run: Path) -> Checked:
    """What the laws say of a recording."""
    from cylconn_ros.bench.faults.soak_report import Checked, Law
    from cylconn_ros.laws.claims import TITLES

    with Progress("laws") as bar:
        _, tally = runs_recorded_or_simulated.checked(run, bar)
    laws = [
        Law(f"{letter} {title}", law.samples, law.value, law.over)
        for letter, title in TITLES.items()
        if (law := tally.laws.get(letter)) is not None and law.samples
    ]
    return Checked(tally.samples, laws, dict(tally.regimes))


def faults(settings: Settings) -> Findings:
    """Every fault, upon real processes and in process."""
    from cylconn_ros.bench.faults import measure

    with Progress("library") as bar:
        return measure.measure(settings, private_environment(), bar)
