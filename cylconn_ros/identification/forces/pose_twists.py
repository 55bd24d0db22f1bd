"""Twists from poses: a local quadratic over groups of samples, whose bandwidth is stated.

The slope of a quadratic fitted to k successive poses at period h is the twist, averaged with a
parabola of width T = k h as its weight. It passes motion up to about 0.58/T (-3 dB). Groups share
no sample, so that white noise of the poses remains white noise of the twists.

Loads and drives are averaged with the same weight: as the same fit of their double integral. So
the equation of motion, which is linear in both, holds for the averages.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.errors import IndeterminateError
from cylconn_ros.recording.samples import SampleArrays

Array = NDArray[np.float64]
Index = NDArray[np.intp]

BANDWIDTH = 50.0  # Hz, by default
HALF_POWER = 0.577  # bandwidth times width of the parabola
FEWEST = 5  # samples of a group; three determine the quadratic
GAP = 4.5  # times the usual period; a group does not extend across a longer one
STILL = 1e-9  # m, 1: poses that change less are at rest

_POSES = (layout.A_POSE, layout.B_POSE)
_TWISTS = (layout.A_TWIST, layout.B_TWIST)


class PoseTwists(NamedTuple):
    """Samples with the twists of their poses."""

    samples: SampleArrays  # one for each group
    drive: Array | None  # (n, 2) over the interval that ends with each sample
    points: int  # samples of a group
    width: float  # s, that of a group
    bandwidth: float  # Hz

    def describe(self) -> str:
        """Say how the twists were found."""
        return (
            f"twists are the slopes of quadratics over {self.points} poses each "
            f"({1e3 * self.width:.3g} ms, bandwidth {self.bandwidth:.3g} Hz)"
        )


def has_no_twists(samples: SampleArrays) -> bool:
    """Whether the poses of a body change but all of its twists are zero."""
    rows = samples.samples
    return any(
        len(rows) > 0
        and not rows[:, twist : twist + 6].any()
        and float(np.ptp(rows[:, pose : pose + 7], axis=0).max()) > STILL
        for pose, twist in zip(_POSES, _TWISTS, strict=True)
    )


def twists_from_poses(
    samples: SampleArrays, bandwidth: float = BANDWIDTH, drive: Array | None = None
) -> PoseTwists:
    """Return one sample for each group of poses, with their twist.

    Args:
        samples: complete samples; their twists are not used.
        bandwidth: that of the twists, Hz. At least FEWEST samples make a group: of a slow recording
            the bandwidth is smaller, see the result.
        drive: (n, 2) force and moment of a known drive over the interval that ends with a sample.

    Raises IndeterminateError if the samples make fewer than two groups.
    """
    if not bandwidth > 0.0:
        raise IndeterminateError(f"bandwidth = {bandwidth:g}: must be > 0 Hz")
    usual = float(np.median(samples.h[1:])) if len(samples) > 1 else 0.0
    points = FEWEST
    if usual > 0.0:
        points = max(2 * round(0.5 * (HALF_POWER / (bandwidth * usual) - 1.0)) + 1, FEWEST)
    groups, begins = _groups(samples, points, usual)
    if len(groups) < 2:
        raise IndeterminateError(
            f"{len(samples)} samples: a twist from poses takes {points} successive ones for a "
            f"bandwidth of {bandwidth:g} Hz, and at least two such groups are needed"
        )
    time = (samples.stamps - samples.stamps[0]) * 1e-9
    middle = groups[:, points // 2]
    value, slope = _quadratics(time[groups] - time[middle][:, None])
    rows = samples.samples[middle].copy()
    for pose, twist in zip(_POSES, _TWISTS, strict=True):
        places = samples.samples[:, pose : pose + 3][groups]
        rows[:, pose : pose + 3] = np.einsum("gk,gkc->gc", value, places)
        rows[:, twist : twist + 3] = np.einsum("gk,gkc->gc", slope, places)
        orientations = samples.samples[:, pose + 3 : pose + 7]
        found = _turning(orientations, groups, value, slope)
        rows[:, pose + 3 : pose + 7], rows[:, twist + 3 : twist + 6] = found
    h = np.diff(time[middle], prepend=time[middle[0]])
    rows[:, layout.LOADS] = _loads(samples, groups, slope, begins, h)
    total = _drives(samples, drive, groups, slope, h) if drive is not None else None
    return PoseTwists(
        SampleArrays(samples.stamps[middle], h, begins, rows, averaged=True), total,
        points, points * usual, HALF_POWER / (points * usual),
    )  # fmt: skip


def _groups(samples: SampleArrays, points: int, usual: float) -> tuple[Index, NDArray[np.bool_]]:
    """Return the rows (g, points) of groups, and which of them begin a history (g,)."""
    cut = samples.restarted | (samples.h > GAP * usual)
    cut[:1] = True
    edges = [*np.flatnonzero(cut).tolist(), len(samples)]
    parts, begins = [np.zeros((0, points), dtype=np.intp)], []
    for first, last in itertools.pairwise(edges):
        count = (last - first) // points
        if count < 2:
            continue
        start = first + (last - first - count * points) // 2
        parts.append(start + np.arange(count * points, dtype=np.intp).reshape(count, points))
        begins.append(np.arange(count) == 0)
    return np.concatenate(parts), np.concatenate(begins) if begins else np.zeros(0, np.bool_)


def _quadratics(times: Array) -> tuple[Array, Array]:
    """Return rows (g, k) that yield value and slope at time 0 of quadratics fitted at ``times``."""
    half = np.abs(times).max(axis=1, keepdims=True)
    x = times / half
    design = np.stack([np.ones_like(x), x, x * x], axis=2)
    transposed = design.transpose(0, 2, 1)
    solve = np.linalg.solve(transposed @ design, transposed)
    return np.asarray(solve[:, 0]), np.asarray(solve[:, 1] / half)


def _turning(orientations: Array, groups: Index, value: Array, slope: Array) -> tuple[Array, Array]:
    """Return orientations (g, 4) and angular velocities (g, 3), world axes, at the middles."""
    from scipy.spatial.transform import Rotation

    count, points = groups.shape
    middle = Rotation.from_quat(orientations[groups[:, points // 2]])
    every = Rotation.from_quat(orientations[groups.ravel()])
    back = Rotation.from_quat(np.repeat(middle.inv().as_quat(), points, axis=0))
    turned = (back * every).as_rotvec().reshape(count, points, 3)
    there = middle * Rotation.from_rotvec(np.einsum("gk,gkc->gc", value, turned))
    rate = there.apply(np.einsum("gk,gkc->gc", slope, turned))
    quaternions = there.as_quat()
    signs = np.sign((quaternions * orientations[groups[:, points // 2]]).sum(axis=1))
    return quaternions * signs[:, None], np.asarray(rate)


def _loads(
    samples: SampleArrays, groups: Index, slope: Array, begins: NDArray[np.bool_], h: Array
) -> Array:
    """Return the mean loads (g, 12) over the interval that begins with each group."""
    loads = samples.samples[:, layout.LOADS]
    held = np.vstack([np.zeros(12), loads[:-1] * samples.h[1:, None]])
    mean = _mean(samples, held, groups, slope, h)
    found = np.vstack([mean[1:], loads[groups[-1:, -1]]])
    last = np.r_[begins[1:], True]  # of a history: nothing follows
    found[last] = loads[groups[last, -1]]
    return found


def _drives(samples: SampleArrays, drive: Array, groups: Index, slope: Array, h: Array) -> Array:
    """Return the mean drives (g, 2) over the interval that ends with each group."""
    return _mean(samples, drive * samples.h[:, None], groups, slope, h)


def _mean(samples: SampleArrays, steps: Array, groups: Index, slope: Array, h: Array) -> Array:
    """Return the averages (g, c) of a force between a group and the one before.

    ``steps`` (n, c): its impulse over the interval that ends with each sample.
    """
    impulse = np.cumsum(steps, axis=0)
    twice = np.zeros_like(impulse)
    twice[1:] = np.cumsum(0.5 * samples.h[1:, None] * (impulse[1:] + impulse[:-1]), axis=0)
    averaged = np.einsum("gk,gkc->gc", slope, twice[groups])
    found = np.zeros_like(averaged)
    found[1:] = np.diff(averaged, axis=0) / np.maximum(h[1:, None], 1e-12)
    return found
