"""Ctrl-C while the compiler works.

An exception raised in the midst of compiling comes out of the compiler's callbacks as a page of
traceback, or not at all. Nothing is open yet that would have to be closed, so a program that is
interrupted there ends at once, with one line.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from types import FrameType

INTERRUPTED = 130
"""Exit code of an interrupted program, as shells have it."""

_COMPILER = ("numba", "llvmlite")


def compiling(frame: FrameType | None) -> bool:
    """Whether a frame, or one that called it, is the compiler's."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in _COMPILER:
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def interruptible(
    program: str, signals: Sequence[signal.Signals] = (signal.SIGINT,)
) -> Iterator[None]:
    """Let signals raise KeyboardInterrupt, or end ``program`` where it is compiling.

    A signal that is ignored, or handled by the caller's own function, stays as it is.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not compiling(frame):
            signal.default_int_handler(number, frame)
        sys.stdout.flush()
        print(f"\n{program}: interrupted while compiling; the next start begins anew",
              file=sys.stderr, flush=True)  # fmt: skip
        os._exit(INTERRUPTED)

    usual = (signal.SIG_DFL, signal.default_int_handler)
    previous = {s: signal.getsignal(s) for s in signals}
    taken = [s for s, handler in previous.items() if handler in usual]
    for number in taken:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in taken:
            if signal.getsignal(number) is interrupt:
                signal.signal(number, previous[number])
