"""Preallocated output messages: an output is a stamp and its numbers written into a template."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function, kernel

OFFSET: Final = 4
"""Offset of a message (mod 8), so that its float64 fields are 8-byte aligned."""
STAMP: Final = 4
"""Offset of the stamp in a message."""
COUNT: Final = 4
"""Output messages of a sample: wrenches on A and B, state, joint state."""
_SECOND: Final = 1_000_000_000

# Indices of MessageTemplates.offsets. The offsets of the fields count in the memory of the
# templates: stamps and flags in words of four bytes, blocks of float64 in words of eight, the small
# integers of the state in bytes.
_STAMP: Final = 0
_WRENCH_A: Final = 4
_WRENCH_B: Final = 5
_STATE: Final = 6
_INTEGERS: Final = 7
_FLAGS: Final = 8
_POSITION: Final = 9
_VELOCITY: Final = 10
_EFFORT: Final = 11
BEGIN: Final = 12  # (COUNT,) begin of each message, bytes
SIZE: Final = BEGIN + COUNT  # (COUNT,) its size, bytes
_NOFFSET: Final = SIZE + COUNT

_INTEGER_FIELDS: Final = (layout.REGIME, layout.STOP, layout.LOCK, layout.STATUS)


@device_function
def write(stamp: int, out: Any, offsets: Any, numbers: Any, words: Any, memory: Any) -> None:
    """Write the outputs (NOUT,) of a sample with a stamp in ns.

    ``offsets``, ``numbers``, ``words``, ``memory``: of :class:`MessageTemplates`.
    """
    seconds = stamp // _SECOND
    for k in range(COUNT):
        at = offsets[_STAMP + k]
        words[at] = seconds
        words[at + 1] = stamp - seconds * _SECOND
    a, b, state = offsets[_WRENCH_A], offsets[_WRENCH_B], offsets[_STATE]
    for k in range(6):
        numbers[a + k] = out[layout.FORCE_A + k]
        numbers[b + k] = out[layout.FORCE_B + k]
    for k in range(layout.NSTATE):
        numbers[state + k] = out[layout.STATE0 + k]
    at = offsets[_INTEGERS]
    for k in range(4):
        memory[at + k] = int(out[_INTEGER_FIELDS[k]])
    words[offsets[_FLAGS]] = int(out[layout.FLAGS])
    position, velocity, effort = offsets[_POSITION], offsets[_VELOCITY], offsets[_EFFORT]
    numbers[position], numbers[position + 1] = out[layout.LENGTH], out[layout.ANGLE]
    numbers[velocity], numbers[velocity + 1] = out[layout.VELOCITY], out[layout.ANGULAR_VELOCITY]
    numbers[effort], numbers[effort + 1] = out[layout.FORCE], out[layout.MOMENT]


@kernel
def _write(stamp: int, out: Any, offsets: Any, numbers: Any, words: Any, memory: Any) -> None:
    write(stamp, out, offsets, numbers, words, memory)


class TemplateBuffer:
    """Serialized messages one after the other in one memory, for compiled code to change and send.

    Attributes
    ----------
        memory: (bytes,) uint8. numbers, words: the same as float64 and as int32.
        begins, sizes: (n,) begin of each message in ``memory`` and its size, bytes.
    """

    def __init__(self, messages: Sequence[bytes]) -> None:
        """Copy ``messages``, which are complete but for their stamps and numbers."""
        room = [(OFFSET + len(message) + 7) // 8 * 8 for message in messages]
        ends = np.cumsum(room)
        self.sizes = np.array([len(message) for message in messages])
        self.numbers = np.zeros(ends[-1] // 8)
        self.words, self.memory = self.numbers.view(np.int32), self.numbers.view(np.uint8)
        self.begins = ends - room + OFFSET
        for begin, message in zip(self.begins.tolist(), messages, strict=True):
            self.memory[begin : begin + len(message)] = np.frombuffer(message, np.uint8)

    @property
    def stamps(self) -> np.ndarray:
        """(n,) offsets of the messages' stamps in ``words``."""
        return (self.begins + STAMP) // 4

    @property
    def addresses(self) -> list[int]:
        """Addresses of the messages."""
        return (self.memory.ctypes.data + self.begins).tolist()


class MessageTemplates(TemplateBuffer):
    """The output messages of a connector: wrenches on A and B, state, joint state.

    Attributes
    ----------
        offsets: (_NOFFSET,) offsets of the fields, begins and sizes, as :func:`write` needs them.
    """

    def __init__(self, messages: Sequence[bytes], blocks: Sequence[Sequence[int]]) -> None:
        """Copy ``messages``.

        ``blocks``: offsets of the blocks of numbers in each message; the second of the state is
        that of its integers.
        """
        super().__init__(messages)
        a, b, state, joints = (
            [begin + at for at in some]
            for begin, some in zip(self.begins.tolist(), blocks, strict=True)
        )
        self.offsets = np.zeros(_NOFFSET, np.int64)
        self.offsets[_STAMP : _STAMP + COUNT] = self.stamps
        self.offsets[[_WRENCH_A, _WRENCH_B, _STATE]] = np.array((a[0], b[0], state[0])) // 8
        self.offsets[[_INTEGERS, _FLAGS]] = state[1], (state[1] + 4) // 4
        self.offsets[[_POSITION, _VELOCITY, _EFFORT]] = np.array(joints) // 8
        self.offsets[BEGIN:_NOFFSET] = *self.begins, *self.sizes
        self._bytes: memoryview = self.memory.data
        self._slices = [
            slice(begin, begin + size)
            for begin, size in zip(self.begins.tolist(), self.sizes.tolist(), strict=True)
        ]

    def write(self, stamp: int, out: np.ndarray) -> None:
        """Write the outputs (NOUT,) of a sample with a stamp in ns."""
        _write(stamp, out, self.offsets, self.numbers, self.words, self.memory)

    def message(self, k: int) -> bytes:
        """A copy of message ``k``."""
        return bytes(self._bytes[self._slices[k]])
