"""Picture of an identification: traction vs. normal force, and friction on the friction disc."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cylconn_ros.identification.friction import Identification

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette: distinguishable with any colour vision, and in grey by lightness.
BLUE, RED, INK, SOFT, REST = "#0072B2", "#D55E00", "#222222", "#767676", "#A6A6A6"
_STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}
_MAX_POINTS = 4000  # of a plot; more are thinned out evenly


def draw(found: Identification, name: str) -> Figure:
    """Draw measured traction vs. normal force with the fitted law; ``name`` is the title."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(10.5, 5.2), layout="constrained")
        traction, disc = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
        _traction(traction, found)
        _disc(disc, found)
        mu = found.estimates["coefficient"]
        figure.suptitle(
            f"{name}:  μ = {mu.value:.4g}  (95 %: {mu.low:.4g} to {mu.high:.4g})",
            x=0.01, ha="left", fontsize=13.0, fontweight="bold", color=INK,
        )  # fmt: skip
    return figure


def _traction(axes: Axes, found: Identification) -> None:
    rows = _thinned(len(found.normal))
    mu, rest = found.estimates["coefficient"], found.static
    resting = _thinned(rest.windows)
    if len(resting):
        axes.plot(
            rest.normal[resting], rest.traction[resting], "o", ms=3.5, mfc="none", mec=REST,
            label="rest", zorder=2,
        )  # fmt: skip
    axes.errorbar(
        found.normal[rows], found.traction[rows], yerr=1.96 * found.deviation[rows],
        fmt="o", ms=3.0, lw=0.7, color=BLUE, ecolor="#9CC4E0", zorder=3,
        label="slip, one point per window (95 %)",
    )  # fmt: skip
    right = 1.06 * float(np.concatenate([found.normal, rest.normal]).max())
    line = np.array([0.0, right])
    axes.fill_between(line, mu.low * line, mu.high * line, color=RED, alpha=0.22, lw=0.0, zorder=1)
    axes.plot(line, mu.value * line, color=RED, lw=1.6, label=r"$\mu\,F_N$", zorder=4)
    static = found.estimates["static_coefficient"]
    if len(rest.breakaways):
        at = slice(rest.windows, None)
        axes.plot(
            rest.normal[at], rest.traction[at], "D", ms=6.5, mfc="none", mec=INK, mew=1.4,
            label="break-away", zorder=5,
        )  # fmt: skip
    if math.isfinite(static.value):
        axes.plot(
            line, static.value * line, color=INK, lw=1.0, ls=(0, (5, 4)),
            label=r"$\mu_{static}\,F_N$", zorder=4,
        )  # fmt: skip
    axes.set_xlim(0.0, right)
    axes.set_ylim(bottom=0.0)
    law = found.law
    where = " at $l_L$" if found.contact.sigma else ""
    axes.set_xlabel(
        f"normal force  $F_N = F_r + \\frac{{2}}{{L}}M_{{bend}} + F_C^{{int}}$  [N]"
        f"      (2/L{where} = {law.bending:.4g} /m, $F_C^{{int}}$ = {law.preload:.4g} N)"
    )
    axes.set_ylabel("traction  $P = \\sqrt{f_1^2 + (m_1/R)^2}$  [N]")
    axes.grid(color="#E4E4E4", lw=0.6)
    axes.legend(loc="upper left", frameon=False)


def _disc(axes: Axes, found: Identification) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(np.cos(turn), np.sin(turn), color=RED, lw=1.6, zorder=2)
    rows = _thinned(len(found.disc))
    axes.plot(found.disc[rows, 0], found.disc[rows, 1], "o", ms=3.0, color=BLUE, zorder=3)
    axes.axhline(0.0, color=SOFT, lw=0.6)
    axes.axvline(0.0, color=SOFT, lw=0.6)
    reach = max(1.15, 1.08 * float(np.abs(found.disc[rows]).max()))
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    axes.set_xlabel(r"slide  $f_1 / (\mu F_N)$")
    axes.set_ylabel(f"spin  $m_1 / (R\\,\\mu F_N)$,   R = {found.law.radius:.4g} m")


def _thinned(n: int) -> np.ndarray:
    return np.unique(np.linspace(0, max(n - 1, 0), min(n, _MAX_POINTS)).astype(int))


def save(figure: Figure, path: Path) -> None:
    """Write the picture in the format of the suffix of ``path`` (png, svg, pdf)."""
    figure.savefig(path, dpi=150)
