"""Samples of long and of several recordings: within bounded memory, at rest and in motion.

Above MOST_SAMPLES every second stretch of the more numerous kind is left out, again and again, so
that both kinds stay spread over the whole recording. A stretch begins a new history.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.recording.samples import RecordedSample, SampleArrays

Array = NDArray[np.float64]

MOST_SAMPLES = 1 << 18
STRETCH = 1 << 13  # samples
BETWEEN = 1_000_000_000  # ns, between recordings
STILL = 0.02  # of the greatest travel: a stretch that moves less is at rest


class Stretch(NamedTuple):
    """Successive samples."""

    number: int
    samples: SampleArrays
    travel: float  # greatest change of a component of B's pose relative to A's, m or 1


def collect_bounded(
    samples: Iterable[RecordedSample], most: int = MOST_SAMPLES, stretch: int = STRETCH
) -> tuple[SampleArrays, int]:
    """Collect at most ``most`` samples.

    Returns
    -------
        The samples, and how many were left out.
    """
    kept: list[Stretch] = []
    steps, left_out = {True: 1, False: 1}, 0  # every how many-th stretch is kept, moving or still
    rest = iter(samples)
    for number in itertools.count():
        part = SampleArrays.collect(itertools.islice(rest, stretch))
        if not len(part):
            break
        relative = part.samples[:, layout.B_POSE : layout.B_POSE + 7].copy()
        relative -= part.samples[:, layout.A_POSE : layout.A_POSE + 7]
        kept.append(Stretch(number, part, float(np.ptp(relative, axis=0).max())))
        greatest = max(one.travel for one in kept)
        moves = [one.travel > STILL * greatest for one in kept]
        if number % steps[moves[-1]]:
            left_out += len(kept.pop().samples)
            continue
        if sum(len(one.samples) for one in kept) > most:
            more = sum(moves) * 2 >= len(moves)
            steps[more] *= 2
            ours = [one for one, moving in zip(kept, moves, strict=True) if moving == more]
            dropped = {one.number for one in ours[1::2]}
            left_out += sum(len(one.samples) for one in ours[1::2])
            kept = [one for one in kept if one.number not in dropped]
    if not kept:
        return SampleArrays.collect([]), 0
    for before, after in itertools.pairwise(kept):
        if after.number != before.number + 1:
            after.samples.restarted[0] = True
    return _concatenated([one.samples for one in kept]), left_out


def joined(recordings: Sequence[SampleArrays]) -> SampleArrays:
    """Return the samples of several recordings as those of one, each with a history of its own.

    The stamps of every recording are shifted to begin after the end of the one before.
    """
    if len(recordings) == 1:
        return recordings[0]
    parts, begin = [], 0
    for one in recordings:
        if not len(one):
            continue
        restarted = one.restarted.copy()
        restarted[0] = True
        stamps = one.stamps - one.stamps.min() + begin
        parts.append(SampleArrays(stamps, one.h, restarted, one.samples, averaged=one.averaged))
        begin = int(stamps.max()) + BETWEEN
    return _concatenated(parts) if parts else recordings[0]


def _concatenated(parts: Sequence[SampleArrays]) -> SampleArrays:
    return SampleArrays(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("stamps", "h", "restarted", "samples")
        ),
        averaged=any(part.averaged for part in parts),
    )
