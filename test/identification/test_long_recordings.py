"""Long recordings take bounded memory, and nothing of them is left out in silence."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.identification.forces.long_recordings import collect_bounded
from cylconn_ros.recording.samples import RecordedSample

MOST, STRETCH = 4096, 256


def recorded(n: int) -> Iterator[RecordedSample]:
    """At rest, but for one of eight stretches."""
    row = np.zeros(layout.NSAMPLE)
    for k in range(n):
        if k // STRETCH % 8 == 3:
            row[layout.B_POSE] = np.sin(0.1 * k)
        yield RecordedSample(k * 1_000_000, 1e-3 * (k > 0), k == 0, row.copy())


def test_stretches_at_rest_and_in_motion_stay_spread_over_the_recording() -> None:
    n = 100 * STRETCH + 7
    samples, left_out = collect_bounded(recorded(n), MOST, STRETCH)
    assert len(samples) + left_out == n
    assert 0.5 * MOST <= len(samples) <= MOST
    number = samples.stamps // (STRETCH * 1_000_000)
    moving = np.unique(number[number % 8 == 3])
    assert len(moving) >= 6  # of 12
    assert np.ptp(moving) > 60
    assert np.ptp(number) > 80
    jumps = np.flatnonzero(np.diff(samples.stamps) != 1_000_000) + 1
    assert len(jumps)
    assert samples.restarted[jumps].all()
    assert samples.restarted.sum() == len(jumps) + 1


def test_a_short_recording_is_kept_as_it_is() -> None:
    samples, left_out = collect_bounded(recorded(MOST), MOST, STRETCH)
    assert (len(samples), left_out) == (MOST, 0)
    assert collect_bounded(iter(()))[1] == 0


def test_memory_does_not_grow_with_the_recording() -> None:
    peaks = []
    for n in (2 * MOST, 16 * MOST):
        tracemalloc.start()
        collect_bounded(recorded(n), MOST, STRETCH)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
