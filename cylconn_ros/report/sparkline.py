"""A curve in one line of text: how a quantity went over a run, for a terminal."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.report import decimate

Array = npt.NDArray[Any]

BLOCKS = "▁▂▃▄▅▆▇█"
PLAIN = "_.-=+*#@"  # where the terminal has no blocks
GAP = " "


def sparkline(values: Array, width: int, log: bool = False, levels: str = BLOCKS) -> str:
    """Draw ``values`` (n,) in at most ``width`` characters, from their smallest to their largest.

    A character stands for a stretch of samples and shows the one that is farthest from the middle
    of the range, so that a peak of one sample is seen; a space has no finite value. ``log``: by the
    powers of ten of the magnitudes, zeros lowest.
    """
    values = np.asarray(values, dtype=np.float64)
    if not len(values):
        return ""
    if log:
        size = np.abs(values)
        with np.errstate(divide="ignore"):
            values = np.log10(size)
        positive = values[np.isfinite(values)]
        least = float(positive.min()) if len(positive) else 0.0
        values = np.where(size == 0.0, least, values)
    low, high = decimate.extremes(values, decimate.starts(len(values), width))
    seen = low[np.isfinite(low)]
    if not len(seen):
        return GAP * len(low)
    bottom, top = float(np.nanmin(low)), float(np.nanmax(high))
    middle = 0.5 * (bottom + top)
    shown = np.where(high - middle >= middle - low, high, low)
    span = top - bottom
    heights = (shown - bottom) / span if span > 0.0 else np.zeros(len(shown))
    steps = np.nan_to_num(heights, nan=0.0) * (len(levels) - 1)
    return "".join(
        levels[round(float(step))] if np.isfinite(value) else GAP
        for step, value in zip(steps, shown, strict=True)
    )


def strip(states: Array, marks: str, width: int) -> str:
    """Draw which state was on, a mark a stretch; ``states`` (n,) whole numbers, indices of marks.

    Where a stretch holds several, ``/``: none is passed over.
    """
    known = np.clip(np.asarray(states).astype(np.int64), 0, len(marks) - 1)
    bits = decimate.union(1 << known, decimate.starts(len(known), width))
    alone = {1 << index: mark for index, mark in enumerate(marks)}
    return "".join(alone.get(int(each), "/") for each in bits)
