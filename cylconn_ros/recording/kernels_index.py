"""Where the records of a chunk stand, compiled."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import COMPILED, kernel

__all__ = ["COMPILED", "fill"]

_MESSAGE: Final = 5  # the opcode of a message's record
_HEAD: Final = 31  # bytes of it before the message

Integers = NDArray[np.int64]
Longs = NDArray[np.uint64]


@kernel
def fill(
    codes: NDArray[np.uint8], words: Longs, longs: Longs, places: Integers, others: Integers
) -> tuple[int, int]:
    """Fill channel, log and publish times; start and size; begin and end of other records."""
    at, end, k, j = 0, codes.shape[0], 0, 0
    while at < end:
        if at + 9 > end:
            return -1, 0
        long = words[at + 1]
        if long > end - at - 9:
            return -1, 0
        behind = at + 9 + np.int64(long)
        if codes[at] == _MESSAGE:
            if long < 22:
                return -1, 0
            longs[0, k] = np.uint64(codes[at + 9]) + np.uint64(256) * np.uint64(codes[at + 10])
            longs[1, k] = words[at + 15]
            longs[2, k] = words[at + 23]
            places[0, k] = at + _HEAD
            places[1, k] = behind - at - _HEAD
            k += 1
        else:
            if j < others.shape[1]:
                others[0, j] = at
                others[1, j] = behind
            j += 1
        at = int(behind)
    return k, j
