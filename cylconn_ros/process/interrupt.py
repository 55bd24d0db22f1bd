"""Ctrl-C during compilation, and in child processes.

An exception raised while Numba compiles leaves the compiler's callbacks as a page of traceback, or
is lost. No resource is open yet at that point, so an interrupted program ends at once with one line
of text.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from types import FrameType

INTERRUPTED = 130
"""Exit code of an interrupted program, by the convention of shells."""

_COMPILER = ("numba", "llvmlite")


def compiling(frame: FrameType | None) -> bool:
    """Whether a frame, or one of its callers, belongs to the compiler."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in _COMPILER:
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def interruptible(
    program: str, signals: Sequence[signal.Signals] = (signal.SIGINT,)
) -> Iterator[None]:
    """Make signals raise KeyboardInterrupt, or end ``program`` at once while it compiles.

    A signal that is ignored, or that has the caller's own handler, is left unchanged.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not compiling(frame):
            signal.default_int_handler(number, frame)
        sys.stdout.flush()
        print(f"\n{program}: interrupted while compiling; the next start compiles again",
              file=sys.stderr, flush=True)  # fmt: skip
        os._exit(INTERRUPTED)

    default = (signal.SIG_DFL, signal.default_int_handler)
    previous = {s: signal.getsignal(s) for s in signals}
    replaced = [s for s, handler in previous.items() if handler in default]
    for number in replaced:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in replaced:
            if signal.getsignal(number) is interrupt:
                signal.signal(number, previous[number])


@contextlib.contextmanager
def interruptible_children() -> Iterator[None]:
    """Start processes for which SIGINT has its default action, even if this one ignores it.

    A program inherits that a signal is ignored, but not a handler. Only the main thread can set
    one; on another thread nothing changes.
    """
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    if not ignored or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, lambda *_: None)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
