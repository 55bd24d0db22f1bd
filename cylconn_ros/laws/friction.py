"""The friction law, written independently: contact forces, coefficient, friction limit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws.parameters import Parameters, Table
from cylconn_ros.laws.sample_state import SampleState

Array = NDArray[np.float64]


def contact(
    p: Parameters, force: Array, moment: Array, sizes: bool = False
) -> tuple[Array, Array, Array, Array]:
    """Fr, Mbend, Fbend = 2 Mbend / L and FN = |Fr + Fbend + FCint| of (..., n, 3) force, moment.

    What is not in ``friction.inputs`` is 0 but for Mbend.
    Mbend is about the middle of the contact, p.centre before node b: M + centre e1 x F. sizes:
    force and moment are sizes, which add up, and overlap and centre have theirs.
    """
    radial = np.where(p.radial, np.hypot(force[..., 1], force[..., 2]), 0.0)
    about2 = moment[..., 1] - p.centre * force[..., 2]
    about3 = moment[..., 2] + p.centre * force[..., 1]
    bends = p.bends & (p.overlap > 0.0)
    lever = np.where(bends, 2.0 / np.where(bends, p.overlap, 1.0), 0.0)
    if sizes:
        about2 = moment[..., 1] + p.centre_size * force[..., 2]
        about3 = moment[..., 2] + p.centre_size * force[..., 1]
        lever = lever * p.overlap_size
    bending = np.hypot(about2, about3)
    return radial, bending, lever * bending, np.abs(radial + lever * bending + p.preload)


def at_sample(p: Parameters, o: SampleState) -> Parameters:
    """The parameters with overlap and middle of the contact in the step of a sample."""
    ahead = np.where(p.explicit, 0.0, 0.5 * p.h * o.w[:, 0])
    size = o.position_size[:, 0] + np.where(p.explicit, 0.0, 0.5 * p.h * o.w_size[:, 0])
    return at_contact(p, o.position[:, 0] + ahead, o.start[:, 0], size)


def at_contact(p: Parameters, length: Array, start: Array, size: Array) -> Parameters:
    """The parameters with overlap and middle of the contact at the slide (n,) ``length``, m.

    start: (n,) slide of the reference configuration, m. size: of the terms of ``length``.
    """
    given = np.where(np.isnan(p.overlap_at), start, p.overlap_at)
    moved, terms = length - given, size + np.abs(given)
    change = p.overlap_slope * moved
    varies = p.overlap_slope != 0.0
    clipped = np.clip(p.overlap + change, p.overlap_min, p.overlap_max)
    overlap = np.where(varies, clipped, p.overlap)
    # the middle between both bodies moves as long as the overlap changes
    ends = p.overlap_slope * (overlap - p.overlap)
    bounded = varies & (p.centre_slope == 0.5) & (overlap != p.overlap + change)
    followed = np.where(bounded, ends, moved)
    changes = (p.overlap > 0.0) & p.on & ((p.overlap_slope != 0.0) | (p.centre_slope != 0.0))
    share = (p.overlap + np.abs(p.overlap_slope) * terms) / np.where(changes, overlap, 1.0)
    return dataclasses.replace(
        p,
        overlap=np.where(changes, overlap, p.overlap),
        overlap_size=np.where(changes, np.maximum(share, 1.0), 1.0),
        centre=np.where(changes, p.centre_slope * followed, 0.0),
        centre_size=np.where(changes, p.centre_slope * terms, 0.0),
    )


def coefficient(p: Parameters, tables: Sequence[Table], rate: Array, normal: Array) -> Array:
    """(..., n) coefficient mu at slip rate |s| (m/s), contact force FN (N); mean of directions."""
    with np.errstate(under="ignore"):
        mu = p.kinetic + (p.static - p.kinetic) * np.exp(-p.decay * rate)
    for number in np.unique(p.table[p.table >= 0]):
        rows = p.table == number
        mu[..., rows] = interpolated(tables[number], rate[..., rows], normal[..., rows])
    return mu


def slopes(p: Parameters, tables: Sequence[Table]) -> tuple[Array, Array]:
    """(n,) Lipschitz constants of mu: largest |d mu / d|s|| (s/m) and |d mu / d FN| (1/N)."""
    by_rate, by_force = p.decay * np.abs(p.static - p.kinetic), np.zeros_like(p.decay)
    for number in np.unique(p.table[p.table >= 0]):
        table, rows = tables[number], p.table == number
        steps = np.abs(np.diff(table.values, axis=0)) / np.diff(table.rates)[:, None]
        by_rate[rows] = steps.max(initial=0.0)
        steps = np.abs(np.diff(table.values, axis=1)) / np.diff(table.forces)[None, :]
        by_force[rows] = steps.max(initial=0.0)
    return by_rate, by_force


def interpolated(table: Table, rate: Array, force: Array) -> Array:
    """Bilinear interpolation in the table, constant outside."""
    i, t = _interval(table.rates, rate)
    j, u = _interval(table.forces, force)
    k, m = np.minimum(i + 1, len(table.rates) - 1), np.minimum(j + 1, len(table.forces) - 1)
    low = (1.0 - u) * table.values[i, j] + u * table.values[i, m]
    high = (1.0 - u) * table.values[k, j] + u * table.values[k, m]
    return np.asarray((1.0 - t) * low + t * high)


def _interval(axis: Array, x: Array) -> tuple[NDArray[np.intp], Array]:
    """Index of the interval that contains x, and the position in it, 0 to 1."""
    x = np.clip(x, axis[0], axis[-1])
    i = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, max(len(axis) - 2, 0))
    if len(axis) == 1:
        return i, np.zeros_like(x)
    return i, (x - axis[i]) / (axis[i + 1] - axis[i])


def along(vector: Array) -> Array:
    """(..., n) cosine between (..., n, 2) slip velocities, or forces, and a positive slide."""
    size = np.hypot(vector[..., 0], vector[..., 1])
    return np.asarray(vector[..., 0] / np.where(size > 0.0, size, 1.0))


def limit(
    p: Parameters, tables: Sequence[Table], rate: Array, normal: Array, cosine: Array
) -> Array:
    """(..., n) friction limit min(cap, mu FN), N; cosine: of the slip direction."""
    mu = coefficient(p, tables, rate, normal) * (1.0 + p.direction * cosine)
    return np.minimum(p.cap, mu * normal)
