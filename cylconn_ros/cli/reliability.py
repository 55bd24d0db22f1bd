"""The two benchmarks of reliability, faults and soak, with what their room does not know."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli import lawful
from cylconn_ros.cli.processes import private_environment
from cylconn_ros.cli.progress import Progress

if TYPE_CHECKING:
    from cylconn_ros.bench.results import Findings
    from cylconn_ros.bench.settings import Settings
    from cylconn_ros.bench.soak import Checked


def soak(settings: Settings) -> Findings:
    """A soak of as many samples as the settings say."""
    from cylconn_ros.bench import soak

    samples = settings.samples or (soak.QUICK if settings.quick else soak.SAMPLES)
    with Progress("soak") as bar:
        return soak.measure(samples, private_environment(), check, bar)


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


def faults(settings: Settings) -> Findings:
    """Every fault, upon real processes and in process."""
    from cylconn_ros.bench.faults import measure

    with Progress("library") as bar:
        return measure.measure(settings, private_environment(), bar)
