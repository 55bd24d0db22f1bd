"""Text of ``cylconn laws``: residuals of the laws, regimes, selected roots, scenes, orders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from cylconn_ros.laws.guarantees import LAWS, title

if TYPE_CHECKING:
    from cylconn_ros.laws.order import Fit
    from cylconn_ros.laws.selection import SelectionSummary
    from cylconn_ros.laws.summary import LawSummary


def laws(summary: LawSummary, location: str = "scene/chain/index") -> list[str]:
    """Table of the largest residual of each law and the location of its sample."""
    beyond = f"beyond {summary.tolerance:.0e}"
    lines = [f"{'law':<15}{'samples':>10}{'worst':>11}{beyond:>14}  {location}"]
    for name in LAWS:
        law = summary.laws.get(name)
        if law is None or not law.samples:
            continue
        at = law.location if law.worst > 0.0 else ""
        line = f"{title(name):<15}{law.samples:>10}{law.worst:>11.1e}{law.violations:>14}  {at}"
        lines.append(line.rstrip())
    return lines


def regimes(summary: LawSummary) -> list[str]:
    """Table of the samples in each regime."""
    lines = ["", f"{'regime':<15}{'samples':>10}{'share':>11}"]
    for name, count in summary.regimes.items():
        lines.append(f"{name:<15}{count:>10}{summary.share(name):>11.2%}")
    return lines


def selection(found: SelectionSummary | None) -> list[str]:
    """Result of the brute-force solution for all roots."""
    if found is None or not found.samples:
        return []
    lines = [
        "",
        f"all roots by brute force: {found.checked} of {found.samples} samples checked, "
        f"{found.several} with several roots, {found.ambiguous} ambiguous by rounding",
        f"outputs other than the selected root: {found.wrong}; "
        f"wrong flag SEVERAL_ROOTS: {found.flag}; "
        f"restitution not the largest: {found.restitution} of {found.impacts} impacts",
    ]
    return lines + [f"  at {location}" for location in found.locations]


def library(summary: LawSummary, scenes: int, rejected: Mapping[str, str]) -> list[str]:
    """Table for the method's runs of the bundled scenes."""
    lines = []
    if summary.samples:
        lines += ["", f"{scenes} bundled scenes, {summary.samples} samples", ""]
        lines += laws(summary, "scene/sample")
    if rejected:
        lines.append(f"scenes that the method does not accept: {', '.join(rejected)}")
    return lines


def pointwise(summary: LawSummary | None, momentum: float) -> list[str]:
    """Table for the instants of the motions that minimal computes."""
    if summary is None:
        return []
    lines = ["", f"motions of the bundled scenes, {summary.samples} instants", ""]
    lines += laws(summary, "scene/instant")
    lines.append(f"relative change of momentum of two free bodies: {momentum:.1e}")
    return lines


def orders(fits: list[Fit]) -> list[str]:
    """Table of the fitted orders of convergence."""
    if not fits:
        return []
    from cylconn_ros.laws.order import PERIODS, STATED

    heads = "".join(f"{1e3 * period:>9.4g}" for period in PERIODS)
    lines = ["", f"{'order, error at h/ms':<46}{heads}   order  stated"]
    for fit in fits:
        errors = "".join(f"{error:>9.1e}" for error in fit.errors)
        mark = "" if fit.holds else "  TOO LOW"
        name = f"{fit.scene}: {fit.quantity}"
        lines.append(f"{name:<46}{errors}{fit.order:>8.2f}{STATED[fit.quantity]:>8.0f}{mark}")
    return lines
