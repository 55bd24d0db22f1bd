"""Ordinary least squares as laboratories identify friction: inverse dynamics, filtered, regressed.

The forces of every interval and the rates are low-pass filtered in both directions, slow slip is
left out, and the rest is decimated to the bandwidth. The traction along the slip direction is
linear in mu, 2 mu/L, mu FCint, c1, cr1 and offset, if R is known; here it is given.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.forces.intervals import measure_intervals
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

CUTOFF = 20.0  # Hz
ORDER = 4
LEAST_RATE = 0.02  # m/s
CHANGES = 0.03  # relative; a cause of friction that changes or counts less is left out


def least_squares(
    scene: Scene, samples: SampleArrays, radius: float
) -> dict[str, tuple[float, float, float]]:
    """Return value and 95 % interval of ``coefficient`` and, if the load changes, ``preload``."""
    from scipy.signal import butter, sosfiltfilt
    from scipy.stats import t

    measured = measure_intervals(scene, samples)
    step = measured.step
    time = np.arange(measured.time[1], measured.time[-1], step)
    both = np.hstack([measured.wrench, measured.rates])[1:]
    middle = measured.time[1:] - 0.5 * measured.dt[1:]
    even = np.stack([np.interp(time, middle, column) for column in both.T], axis=1)
    low = sosfiltfilt(butter(ORDER, CUTOFF, fs=1.0 / step, output="sos"), even, axis=0)
    low = low[:: max(int(0.5 / (CUTOFF * step)), 1)]
    slide, spin = low[:, 6], low[:, 7]
    size = np.hypot(slide, radius * spin)
    low, slide, spin, size = (x[size > LEAST_RATE] for x in (low, slide, spin, size))
    cos, sin = slide / size, radius * spin / size
    traction = -(low[:, 0] * cos + low[:, 3] / radius * sin)
    radial, moment = np.hypot(low[:, 1], low[:, 2]), np.hypot(low[:, 4], low[:, 5])
    varies = radial.std() > CHANGES * radial.mean()
    columns = {
        "radial": radial,
        "constant": np.ones(len(low)) if varies else None,
        "moment": moment if np.median(moment) > CHANGES * radius * np.median(radial) else None,
        "slide": slide * cos,
        "spin": spin * sin / radius if np.abs(sin).max() > CHANGES else None,
        "offset": cos if (cos > 0.0).any() and (cos < 0.0).any() else None,
    }
    design = np.stack([c for c in columns.values() if c is not None], axis=1)
    x, *_ = np.linalg.lstsq(design, traction, rcond=None)
    rest = traction - design @ x
    freedom = len(rest) - len(x)
    covariance = float(rest @ rest) / freedom * np.linalg.inv(design.T @ design)
    half = float(t.isf(0.025, freedom))
    mu, deviation = float(x[0]), float(np.sqrt(covariance[0, 0]))
    found = {"coefficient": (mu, mu - half * deviation, mu + half * deviation)}
    if not varies:
        return found
    ratio = x[1] / x[0]
    slope = np.array([-ratio, 1.0]) / x[0]
    spread = float(np.sqrt(slope @ covariance[:2, :2] @ slope))
    found["preload"] = (ratio, ratio - half * spread, ratio + half * spread)
    return {name: (float(v), float(low), float(high)) for name, (v, low, high) in found.items()}
