"""Sparklines: a quantity over a run as one line of text, for a terminal."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.report import decimate

Array = npt.NDArray[Any]

BLOCKS = "▁▂▃▄▅▆▇█"
PLAIN = "_.-=+*#@"  # for a terminal without block characters
GAP = " "


def sparkline(values: Array, width: int, log: bool = False, levels: str = BLOCKS) -> str:
    """Draw ``values`` (n,) in at most ``width`` characters, scaled to their range.

    A character represents a bucket of samples and shows the sample that is farthest from the middle
    of the range, so that a peak of a single sample is visible. A space is a bucket without finite
    values. ``log``: logarithm of the magnitudes, with zeros at the bottom.
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
    low, high = decimate.extremes(values, decimate.bucket_starts(len(values), width))
    if not np.isfinite(low).any():
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


def regime_strip(states: Array, marks: str, width: int) -> str:
    """Draw discrete states (n,), indices of ``marks``, as one mark per bucket of samples.

    A bucket with several states is drawn as ``/``.
    """
    known = np.clip(np.asarray(states).astype(np.int64), 0, len(marks) - 1)
    bits = decimate.bitwise_or(1 << known, decimate.bucket_starts(len(known), width))
    alone = {1 << index: mark for index, mark in enumerate(marks)}
    return "".join(alone.get(int(each), "/") for each in bits)
