"""What ``cylconn laws`` prints: residuals of the laws, regimes, roots, library runs, orders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cylconn_ros.laws.order import Fit
    from cylconn_ros.laws.selection import Verdict
    from cylconn_ros.laws.summary import Tally


def laws(tally: Tally, place: str = "scene/start/place") -> list[str]:
    """The worst residual of each law and where."""
    from cylconn_ros.laws.claims import TITLES

    lines = [f"{'law':<15}{'samples':>10}{'worst':>11}{'beyond 1e-12':>14}  {place}"]
    for letter, title in TITLES.items():
        law = tally.laws.get(letter)
        if law is None or not law.samples:
            continue
        where = law.where if law.value > 0.0 else ""
        name = f"{letter} {title}"
        lines.append(
            f"{name:<15}{law.samples:>10}{law.value:>11.1e}{law.over:>14}  {where}".rstrip()
        )
    return lines


def regimes(tally: Tally) -> list[str]:
    """Samples in each regime."""
    lines = ["", f"{'regime':<15}{'samples':>10}{'share':>11}"]
    for name, count in tally.regimes.items():
        lines.append(f"{name:<15}{count:>10}{tally.share(name):>11.2%}")
    return lines


def roots(verdict: Verdict | None) -> list[str]:
    """What brute force says."""
    if verdict is None or not verdict.samples:
        return []
    lines = [
        "",
        f"all roots by brute force: {verdict.judged} of {verdict.samples} samples, "
        f"{verdict.several} with several, {verdict.unsure} that hang on rounding",
        f"answers other than the rule names: {verdict.wrong}; "
        f"flag SEVERAL_ROOTS not as the message says: {verdict.flag}; "
        f"restitution of {verdict.impacts} impacts not the greatest: {verdict.restitution}",
    ]
    return lines + [f"  at {where}" for where in verdict.where]


def library(tally: Tally, runs: int, refused: Mapping[str, str]) -> list[str]:
    """The method's own runs of the scene library."""
    if not runs:
        return []
    lines = ["", f"{runs} scenes of the library, {tally.samples} samples", ""]
    lines += laws(tally, "scene/sample")
    if refused:
        lines.append(f"not served by this method: {', '.join(refused)}")
    return lines


def pointwise(tally: Tally | None, momentum: float) -> list[str]:
    """The dense output of minimal offline."""
    if tally is None:
        return []
    lines = ["", f"the motion itself, {tally.samples} instants of the same scenes offline", ""]
    lines += laws(tally, "scene/instant")
    lines.append(f"momentum of two free bodies kept to {momentum:.1e}")
    return lines


def orders(fits: list[Fit]) -> list[str]:
    """Law O."""
    if not fits:
        return []
    from cylconn_ros.laws.order import PERIODS, STATED

    heads = "".join(f"{1e3 * period:>9.4g}" for period in PERIODS)
    lines = ["", f"{'O order, error at h/ms':<46}{heads}   order  stated"]
    for fit in fits:
        errors = "".join(f"{error:>9.1e}" for error in fit.errors)
        sign = "" if fit.holds else "  LESS"
        name = f"{fit.scene}: {fit.what}"
        lines.append(f"{name:<46}{errors}{fit.order:>8.2f}{STATED[fit.what]:>8.0f}{sign}")
    return lines
