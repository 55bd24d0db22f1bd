"""Matplotlib picture of a run: motion, slip velocity, normal force, friction, violation."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = npt.NDArray[Any]

# Okabe and Ito's palette: distinguishable with any colour vision, and in grey by lightness.
BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
INK, SOFT, STICK_SHADE = "#222222", "#767676", "#EDEDED"
STICK = 1  # ConnectorState.STICK

_STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "svg.fonttype": "none",
    "svg.hashsalt": "cylconn_ros",  # the same run gives the same file
}


@dataclass(frozen=True)
class ReferenceCurves:
    """An independent solution to overlay on the run; all arrays (m,)."""

    time: Array  # s
    displacement: Array  # m, since the start
    rotation: Array  # rad, since the start
    normal_force: Array  # N


def draw_run(
    time: Array,
    state: Mapping[str, Array],
    title: str,
    subtitle: str = "",
    reference: ReferenceCurves | None = None,
    stop_time: float = float("nan"),
) -> Figure:
    """Draw a run over time.

    Parameters
    ----------
    time
        (n,) seconds.
    state
        Fields of ConnectorState by name, (n,) or (n, k), in the message's units.
    title, subtitle
        Heading, e.g. the name of the scene; second line, e.g. the method.
    reference
        An independent solution, drawn dashed.
    stop_time
        Time from which the joint stays at rest, s; NaN if it does not.

    Raises
    ------
    ImportError
        matplotlib is not installed.

    """
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    with mpl.rc_context(_STYLE):
        figure = Figure(
            figsize=(9.0, 10.0), layout=ConstrainedLayoutEngine(h_pad=0.035, hspace=0.02)
        )
        axes = figure.subplots(6, 1, sharex=True, height_ratios=[1.25, 1.0, 1.15, 1.25, 1.25, 1.0])
        position, angle, speed, normal, friction, violation = axes
        _motion(position, angle, time, state, reference)
        _speeds(speed, time, state)
        _normal_force(normal, time, state, reference)
        _friction(friction, time, state)
        _violation(violation, time, state)
        _regimes(list(axes), time, np.asarray(state["regime"]), stop_time)
        violation.set_xlabel("time  [s]")
        violation.set_xlim(float(time[0]), float(time[-1]))
        figure.align_ylabels(list(axes))
        position.set_title(title, loc="left", fontsize=13.5, fontweight="bold", color=INK, pad=38)
        _note(position, subtitle, x=0.0, up=22, coordinates="axes fraction", ha="left")
    return figure


def save_run(figure: Figure, path: Path | str) -> None:
    """Write the picture in the format of the suffix of ``path`` (png, svg, pdf).

    A PNG is 1800 px wide, twice the width on a page, with a palette of 128 colours, which takes a
    third of the bytes without a visible difference.
    """
    import matplotlib as mpl
    from PIL import Image

    path = Path(path)
    with mpl.rc_context(_STYLE):
        if path.suffix != ".png":
            figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
            return
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=200)
    with Image.open(buffer) as image:
        image.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)


def _motion(
    position: Axes,
    angle: Axes,
    time: Array,
    state: Mapping[str, Array],
    ref: ReferenceCurves | None,
) -> None:
    position.plot(time, state["displacement"], color=BLUE, lw=2.4)
    position.set_ylabel("slide  $u_1$  [m]")
    angle.plot(time, state["rotation"] / (2.0 * np.pi), color=BLUE, lw=2.4)
    angle.set_ylabel("spin  $u_{r1}$\n[turns]")
    if ref is not None:
        position.plot(ref.time, ref.displacement, **_dashed("independent solution"))
        angle.plot(ref.time, ref.rotation / (2.0 * np.pi), **_dashed("independent solution"))
        position.legend(loc="lower right", frameon=False, handlelength=2.5)


def _speeds(axes: Axes, time: Array, state: Mapping[str, Array]) -> None:
    slip = np.asarray(state["slip_velocity"])
    axes.axhline(0.0, color=SOFT, lw=0.6)
    axes.plot(time, slip[:, 0], color=BLUE, lw=1.5, label="slide  $v_1$")
    axes.plot(time, slip[:, 1], color=ORANGE, lw=1.5, label=r"spin  $R\,\omega_1$")
    axes.set_ylabel("slip velocity\n[m/s]")
    axes.legend(loc="upper right", frameon=False, ncols=2)


def _normal_force(
    axes: Axes, time: Array, state: Mapping[str, Array], ref: ReferenceCurves | None
) -> None:
    axes.plot(time, state["normal_force"], color=GREEN, lw=2.2)
    if ref is not None:
        axes.plot(ref.time, ref.normal_force, **_dashed(None))
    axes.set_ylabel("normal force\n$F_N$  [N]")
    axes.set_ylim(bottom=0.0)


def _friction(axes: Axes, time: Array, state: Mapping[str, Array]) -> None:
    limit, traction = np.asarray(state["friction_limit"]), np.asarray(state["traction"])
    axes.fill_between(time, 0.0, limit, color=RED, alpha=0.10, lw=0.0)
    axes.plot(time, limit, color=RED, lw=2.4, alpha=0.45, label=r"limit  $\mu F_N$")
    axes.plot(time, traction, color=INK, lw=0.9, label="traction  $P$")
    axes.set_ylabel("friction\n[N]")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper right", frameon=False, ncols=2)


def _violation(axes: Axes, time: Array, state: Mapping[str, Array]) -> None:
    floor = 1e-12  # replaces zero on the logarithmic axis
    offset = np.maximum(np.abs(state["offset_violation"]) * 1e3, floor)
    angular = np.maximum(np.abs(state["angular_violation"]) * 1e3, floor)
    axes.semilogy(time, offset, color=BLUE, lw=0.9, label="offset  [mm]")
    axes.semilogy(time, angular, color=ORANGE, lw=0.9, label="misalignment  [mrad]")
    axes.set_ylabel("constraint\nviolation")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.35)  # space for the legend
    axes.legend(loc="upper right", frameon=False, ncols=2)


def _regimes(axes: list[Axes], time: Array, regime: Array, stop_time: float) -> None:
    """Shade stick in all panels, and label the longest intervals of a regime above them."""
    names = {0: "frictionless", STICK: "stick", 2: "slip"}
    changes = np.flatnonzero(np.diff(regime)) + 1
    starts, ends = np.r_[0, changes], np.r_[changes, len(regime)]
    span = float(time[-1] - time[0])
    for start, end in zip(starts, ends, strict=True):
        left, right = float(time[start]), float(time[min(end, len(time) - 1)])
        if regime[start] == STICK:
            for panel in axes:
                panel.axvspan(left, right, color=STICK_SHADE, lw=0.0, zorder=0)
        if right - left > 0.08 * span:
            name = names.get(int(regime[start]), "?")
            if (
                end == len(regime)
                and regime[start] == STICK
                and start > 0
                and np.isfinite(stop_time)
            ):
                name = f"stick: at rest from {stop_time:.3f} s"
            _note(axes[0], name, x=0.5 * (left + right), up=3)


def _note(
    axes: Axes, text: str, x: float, up: float, coordinates: str = "data", ha: str = "center"
) -> None:
    """Write a label above a panel, ``up`` points from its upper edge."""
    note = axes.annotate(
        text,
        xy=(x, 1.0),
        xycoords=(coordinates, "axes fraction"),
        xytext=(0, up),
        textcoords="offset points",
        ha=ha,
        va="bottom",
        color=SOFT,
        fontsize=10,
    )
    note.set_in_layout(False)  # a long text must not narrow the panels


def _dashed(label: str | None) -> dict[str, Any]:
    return {"color": INK, "lw": 0.8, "ls": (0, (5, 4)), "label": label}
