"""An answer's messages, laid out once: writing them is a stamp and the numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function, kernel

FIRST: Final = 4
"""Where a message begins behind a multiple of eight bytes: its numbers are then aligned."""
STAMP: Final = 4  # where it begins in a message
COUNT: Final = 4  # messages of an answer: wrenches on A and B, state, joint state
_SECOND: Final = 1_000_000_000

# Where things are in the memory of the letters: a message's stamp in words of four bytes, numbers
# in words of eight, the state's small numbers in bytes, its flags in words of four.
_STAMP: Final = 0
_WRENCH_A: Final = 4
_WRENCH_B: Final = 5
_STATE: Final = 6
_SMALL: Final = 7
_FLAGS: Final = 8
_POSITION: Final = 9
_VELOCITY: Final = 10
_EFFORT: Final = 11
BEGIN: Final = 12  # where each message begins, in bytes
SIZE: Final = BEGIN + COUNT  # and its size
_PLACES: Final = SIZE + COUNT

_SMALL_NUMBERS: Final = (layout.REGIME, layout.STOP, layout.LOCK, layout.STATUS)


@device_function
def write(stamp: int, out: Any, places: Any, numbers: Any, words: Any, small: Any) -> None:
    """Write an answer (NOUT,) with a stamp in ns.

    ``places``: as :class:`Letters` has them; ``numbers``, ``words``, ``small``: its memory in
    words of eight and four bytes and in bytes.
    """
    seconds = stamp // _SECOND
    for k in range(COUNT):
        at = places[_STAMP + k]
        words[at] = seconds
        words[at + 1] = stamp - seconds * _SECOND
    a, b, state = places[_WRENCH_A], places[_WRENCH_B], places[_STATE]
    for k in range(6):
        numbers[a + k] = out[layout.FORCE_A + k]
        numbers[b + k] = out[layout.FORCE_B + k]
    for k in range(layout.NSTATE):
        numbers[state + k] = out[layout.STATE0 + k]
    at = places[_SMALL]
    for k in range(4):
        small[at + k] = int(out[_SMALL_NUMBERS[k]])
    words[places[_FLAGS]] = int(out[layout.FLAGS])
    position, velocity, effort = places[_POSITION], places[_VELOCITY], places[_EFFORT]
    numbers[position], numbers[position + 1] = out[layout.LENGTH], out[layout.ANGLE]
    numbers[velocity], numbers[velocity + 1] = out[layout.VELOCITY], out[layout.ANGULAR_VELOCITY]
    numbers[effort], numbers[effort + 1] = out[layout.FORCE], out[layout.MOMENT]


@kernel
def _write(stamp: int, out: Any, places: Any, numbers: Any, words: Any, small: Any) -> None:
    write(stamp, out, places, numbers, words, small)


class Laid:
    """Messages laid out one after the other, for compiled code to change and to send.

    Attributes
    ----------
        numbers, words, small: their memory, in words of eight and four bytes and in bytes.
        begins, sizes: (n,) where each message begins in ``small``, and its bytes.
    """

    def __init__(self, blanks: Sequence[bytes]) -> None:
        """Lay out ``blanks``, messages as they always are."""
        room = [(FIRST + len(blank) + 7) // 8 * 8 for blank in blanks]
        ends = np.cumsum(room)
        self.sizes = np.array([len(blank) for blank in blanks])
        self.numbers = np.zeros(ends[-1] // 8)
        self.words, self.small = self.numbers.view(np.int32), self.numbers.view(np.uint8)
        self.begins = ends - room + FIRST
        for begin, blank in zip(self.begins.tolist(), blanks, strict=True):
            self.small[begin : begin + len(blank)] = np.frombuffer(blank, np.uint8)

    @property
    def stamps(self) -> np.ndarray:
        """(n,) where the messages' stamps are in ``words``."""
        return (self.begins + STAMP) // 4

    @property
    def addresses(self) -> list[int]:
        """Where the messages are."""
        return (self.small.ctypes.data + self.begins).tolist()


class Letters(Laid):
    """The messages of an answer: wrenches on A and B, state, joint state.

    Attributes
    ----------
        places: as :func:`write` has them; ``begins`` and ``sizes`` are in them, too.
    """

    def __init__(self, blanks: Sequence[bytes], blocks: Sequence[Sequence[int]]) -> None:
        """Lay out ``blanks``.

        ``blocks``: for each where its blocks of numbers begin; the state's second are the small
        ones.
        """
        super().__init__(blanks)
        a, b, state, joints = (
            [begin + at for at in some]
            for begin, some in zip(self.begins.tolist(), blocks, strict=True)
        )
        self.places = np.zeros(_PLACES, np.int64)
        self.places[_STAMP : _STAMP + COUNT] = self.stamps
        self.places[[_WRENCH_A, _WRENCH_B, _STATE]] = np.array((a[0], b[0], state[0])) // 8
        self.places[[_SMALL, _FLAGS]] = state[1], (state[1] + 4) // 4
        self.places[[_POSITION, _VELOCITY, _EFFORT]] = np.array(joints) // 8
        self.places[BEGIN:_PLACES] = *self.begins, *self.sizes
        self._bytes: memoryview = self.small.data
        self._cuts = [
            slice(begin, begin + size)
            for begin, size in zip(self.begins.tolist(), self.sizes.tolist(), strict=True)
        ]

    def write(self, stamp: int, out: np.ndarray) -> None:
        """Write an answer (NOUT,) with a stamp in ns."""
        _write(stamp, out, self.places, self.numbers, self.words, self.small)

    def message(self, k: int) -> bytes:
        """A copy of one of the messages."""
        return bytes(self._bytes[self._cuts[k]])
