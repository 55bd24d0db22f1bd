"""A linear axis with published parameters (EMPS), simulated with its controller and its encoder.

Parameters: Janot, Gautier, Brunot 2019, "Data set and reference models of EMPS"
(nonlinearbenchmark.org). The recording itself is not used: the motion follows a reference of
trapezoidal rates. Friction that holds the axis at rest is exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.effort import AxisRecording

Array = NDArray[np.float64]

TRUTH = {"mass": 95.1089, "c1": 203.5034, "preload_friction": 20.3935, "offset": -3.1648}
DRIVE = 35.15065  # N/V
KP, KV = 160.18, 243.45  # 1/s, V.s/m
ENCODER = 5e-8  # m
PERIOD = 1e-3  # s
SUBSTEPS = 10
MAX_VOLTAGE = 10.0


def reference(time: Array) -> Array:
    """Return the reference position (n,): to and fro over four strokes with trapezoidal rates."""
    step = float(time[1] - time[0])
    rate = np.zeros(len(time))
    begin, way = 0.3, 1.0
    for stroke in range(1000):
        top, acceleration = ((0.12, 0.6), (0.06, 0.4), (0.2, 1.2), (0.03, 0.2))[stroke // 2 % 4]
        length = 0.2
        ramp, cruise = top / acceleration, length / top - top / acceleration
        x = time - begin
        trapezoid = np.clip(np.minimum(x, 2.0 * ramp + cruise - x) * acceleration, 0.0, top)
        rate += way * trapezoid
        begin += 2.0 * ramp + cruise + 0.2
        way = -way
        if begin > time[-1]:
            break
    return np.cumsum(rate) * step


def simulate(duration: float = 24.8, seed: int = 0, noise: float = 0.0) -> AxisRecording:
    """Simulate the axis under control; ``noise`` is that of the drive's force, N a sample.

    The encoder is quantised, starting at a place that depends on the seed.
    """
    rng = np.random.default_rng(seed)
    time = np.asarray(np.arange(0.0, duration, PERIOD), dtype=np.float64)
    wanted, place = reference(time), float(rng.uniform(0.0, 1e-4))
    disturbance = noise * rng.standard_normal(len(time))
    q, v, before = place, 0.0, place
    positions, efforts = np.zeros(len(time)), np.zeros(len(time))
    m, c1, fc, offset = TRUTH["mass"], TRUTH["c1"], TRUTH["preload_friction"], TRUTH["offset"]
    d = PERIOD / SUBSTEPS
    decay = float(np.exp(-c1 * d / m))
    mean = (1.0 - decay) * m / (c1 * d)  # of the decaying part of the rate over a substep
    for k in range(len(time)):
        seen = round(q / ENCODER) * ENCODER
        rate = (seen - before) / PERIOD
        before = seen
        volts = KV * (KP * (wanted[k] + place - seen) - rate)
        effort = DRIVE * min(max(volts, -MAX_VOLTAGE), MAX_VOLTAGE)
        positions[k], efforts[k] = seen, effort
        push = effort + disturbance[k] - offset
        for _ in range(SUBSTEPS):
            way = float(np.sign(v)) or (float(np.sign(push)) if abs(push) > fc else 0.0)
            if way == 0.0:
                break
            end = (push - way * fc) / c1
            after = end + (v - end) * decay
            q += d * (end + (v - end) * mean)
            v = after if way * after > 0.0 else 0.0
    return AxisRecording(time, positions, efforts)
