"""Elastic stick of the penalty methods, written independently: a spring and a damper on the slip.

phi = -ks d - cs s, with the elastic slip d that integrates s. If |phi| > limit, a radial return
maps phi onto the friction disc, and d = -phi/ks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.sample_state import History, SampleState
from cylconn_ros.laws.step import FREE

Array = NDArray[np.float64]


def slip_of_sample(p: Parameters, o: SampleState) -> tuple[Array, Array]:
    """(n, 2) slip velocity s = (v1, R w1) of the sample, m/s, and its size."""
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    return unit * o.w[:, FREE], unit * o.w_size[:, FREE]


def friction(p: Parameters, out: Array) -> Array:
    """(n, 2) reported friction phi = (f1f, m1f/R), N."""
    phi = out[:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]].copy()
    phi[:, 1] /= p.radius
    return phi


def advanced_slip(p: Parameters, o: SampleState, past: History) -> tuple[Array, Array]:
    """(n, 2) elastic slip d after the step with the sample's slip, m, and its size."""
    s, size = slip_of_sample(p, o)
    last = np.where(past.started, past.period, 0.0)[:, None]
    return past.elastic + last * s, past.elastic_size + last * size


def next_elastic_slip(
    p: Parameters, o: SampleState, past: History, out: Array
) -> tuple[Array, Array]:
    """(n, 2) elastic slip for the history, m, and its size; 0 without a spring."""
    d, size = advanced_slip(p, o, past)
    stiff = p.gains[:, 4][:, None]
    known = ~np.isnan(stiff) & p.on[:, None]
    phi = friction(p, out)
    slips = (out[:, layout.REGIME] == layout.SLIP)[:, None]
    spring = np.where(known, stiff, 1.0)
    d = np.where(slips, -phi / spring, d)
    size = np.where(slips, np.abs(phi) / spring, size)
    return np.where(known, d, 0.0), np.where(known, size, 0.0)
