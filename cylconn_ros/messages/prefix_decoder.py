"""Samples out of a block of recorded messages, as long as these are alike: compiled.

A recorder's messages of a topic differ in stamp and numbers only. Where the messages of every
sample stand together, all with one stamp newer than the last, as nearly all do, the numbers are
copied as they stand. The stretch ends at the first message that is otherwise: what to make of that
one is decided on the ordinary way (matching.py), not here.
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.core.jit import COMPILED, device_function, kernel
from cylconn_ros.messages.prefix import STREAMS

POSSIBLE: Final = COMPILED and sys.byteorder == "little"

NOT_READ: Final = -1  # channels of no input
OTHER: Final = -2  # channels of inputs that are not about motion: a stretch ends there

_AT, _SIZE, _TWIST_AT, _WORDS = 0, 1, 2, 3
_HEAD: Final = 256  # little-endian plain CDR, as a number
_SECOND: Final = 1_000_000_000

Integers = NDArray[np.int64]
Longs = NDArray[np.uint64]
Array = NDArray[np.float64]


@device_function
def _fill(floats: Array, held: Integers, numbers: Integers, needed: int, sample: Array) -> None:
    """Write a sample's numbers as they stand in its messages, which begin at ``held``."""
    for body in range(2):
        if not needed >> 2 * body & 1:
            continue
        of_pose, of_twist, at_twist = 2 * body, 2 * body + 1, _AT
        if held[4 + body] >= 0:
            of_pose = of_twist = 4 + body
            at_twist = _TWIST_AT
        pose, twist = layout.A_POSE, layout.A_TWIST
        if body == 1:
            pose, twist = layout.B_POSE, layout.B_TWIST
        at = held[of_pose] + numbers[of_pose, _AT]
        for j in range(7):
            sample[pose + j] = floats[at + 8 * j]
        at = held[of_twist] + numbers[of_twist, at_twist]
        for j in range(6):
            sample[twist + j] = floats[at + 8 * j]


@kernel
def take(
    longs: Longs, floats: Array, channel: Longs, start: Integers, size: Integers,
    begin: int, end: int, streams: Integers, numbers: Integers, words: Longs, needed: int,
    base: Array, last: int, held: Integers, samples: Array, stamps: Integers,
    since: Array, closing: Integers,
) -> tuple[int, int]:  # fmt: skip
    """Take samples out of messages ``begin`` to ``end`` of a block.

    Args:
        longs, floats: the block's bytes as numbers that begin at every byte.
        channel, start, size: (n,) of its messages.
        streams: by channel, the stream it brings, NOT_READ or OTHER.
        numbers, words: (STREAMS, …) the forms; size -1 where there is none.
        needed: a bit for each of the four poses and twists.
        base: (NSAMPLE,) what is in a sample that no message brings.
        last: stamp of the sample before, ns.
        held: (STREAMS,) to work with.
        samples, stamps, since, closing: where samples go, their stamps, the seconds since the
            sample before, and the message that completed each.

    Returns the number of samples, and the first message that is not part of them.
    """
    n, seen, group, now = 0, 0, begin, last
    together = np.uint64(0)
    for k in range(begin, end):
        stream = NOT_READ
        if channel[k] < np.uint64(streams.shape[0]):
            stream = streams[channel[k]]
        if stream == NOT_READ:
            continue
        here = group if seen else k
        if stream == OTHER or size[k] != numbers[stream, _SIZE]:
            return n, here
        at = start[k]
        stamp = longs[at + 4]
        if longs[at] & np.uint64(0xFFFFFFFF) != np.uint64(_HEAD):
            return n, here
        for i in range(numbers[stream, _WORDS]):
            if longs[at + 12 + 8 * i] != words[stream, i]:
                return n, here
        bits = 1 << stream if stream < 4 else 3 << 2 * (stream - 4)
        if not seen:
            nanoseconds = np.int64(stamp >> np.uint64(32))
            now = int(np.int32(stamp & np.uint64(0xFFFFFFFF))) * _SECOND + int(nanoseconds)
            if nanoseconds >= _SECOND or now <= last:
                return n, here
            together, group = stamp, k
            for j in range(STREAMS):
                held[j] = -1
        elif stamp != together or seen & bits:
            return n, here
        seen |= bits
        held[stream] = at
        if seen == needed:
            sample = samples[n]
            for j in range(layout.NSAMPLE):
                sample[j] = base[j]
            _fill(floats, held, numbers, needed, sample)
            stamps[n] = now
            since[n] = (now - last) * 1e-9
            closing[n] = k
            last, seen = now, 0
            n += 1
            if n == samples.shape[0]:
                return n, k + 1
    return n, group if seen else end
