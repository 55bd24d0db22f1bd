"""The elastic stick of methods without inertia, from outside: a spring on the slip, and its return.

phi = -ks d - cs s                              d the elastic slip, carried along by s
|phi| > limit: phi brought back radially onto the disc, and d = -phi/ks
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.sample_state import History, Observed
from cylconn_ros.laws.step import AVAILABLE

Array = NDArray[np.float64]


def slip_of_sample(p: Parameters, o: Observed) -> tuple[Array, Array]:
    """(n, 2) s = (v1, R w1) of the sample, and its size."""
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    return unit * o.w[:, AVAILABLE], unit * o.w_size[:, AVAILABLE]


def friction(p: Parameters, out: Array) -> Array:
    """(n, 2) phi = (f1f, m1f/R) as answered."""
    phi = out[:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]].copy()
    phi[:, 1] /= p.radius
    return phi


def carried(p: Parameters, o: Observed, past: History) -> tuple[Array, Array]:
    """(n, 2) the elastic slip d that the sample's slip leads to, and its size."""
    s, size = slip_of_sample(p, o)
    last = np.where(past.started, past.period, 0.0)[:, None]
    return past.elastic + last * s, past.elastic_size + last * size


def after(p: Parameters, o: Observed, past: History, out: Array) -> tuple[Array, Array]:
    """(n, 2) the elastic slip after the answer, and its size; zeros where there is no spring."""
    d, size = carried(p, o, past)
    stiff = p.gains[:, 4][:, None]
    known = ~np.isnan(stiff) & p.on[:, None]
    phi = friction(p, out)
    slips = (out[:, layout.REGIME] == layout.SLIP)[:, None]
    spring = np.where(known, stiff, 1.0)
    d = np.where(slips, -phi / spring, d)
    size = np.where(slips, np.abs(phi) / spring, size)
    return np.where(known, d, 0.0), np.where(known, size, 0.0)
