"""Progress bar on standard error; without a terminal, one line per tenth."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TextIO

_WIDTH = 36


class Progress:
    """Progress of a known amount of work; a context manager, called with (done, total).

    With ``unit``, the name of what is counted, rate and time left are shown.
    """

    def __init__(self, label: str, stream: TextIO | None = None, unit: str = "") -> None:
        self._label, self._unit = label, unit
        self._first: tuple[int, float] | None = None
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._start = time.monotonic()
        self._drawn = -1.0
        self._tenths = 0
        self._open_line = False
        self.values = ""  # text beside the bar

    def note(self, text: str) -> None:
        """Show a text until the first progress."""
        if self._terminal:
            self._write(f"\r\033[K{self._label}: {text}")
            self._open_line = True
        else:
            self._write(f"{self._label}: {text}\n")

    def __call__(self, done: int, total: int) -> None:
        """Show the progress; a bar is redrawn at most twenty times a second."""
        now = time.monotonic()
        share = min(max(done / total, 0.0), 1.0) if total > 0 else 1.0
        rate = self._rate(done, total, now)
        if self._terminal:
            if now - self._drawn < 0.05 and share < 1.0:
                return
            self._drawn = now
            filled = round(share * _WIDTH)
            bar = "#" * filled + "." * (_WIDTH - filled)
            elapsed, beside = now - self._start, f"  {self.values}" if self.values else ""
            self._write(
                f"\r\033[K{self._label} [{bar}] {share:4.0%}  {elapsed:.1f} s{rate}{beside}"
            )
            self._open_line = True
        elif int(share * 10.0) > self._tenths:
            self._tenths = int(share * 10.0)
            beside = f"  {self.values}" if self.values else ""
            self._write(f"{self._label}: {10 * self._tenths}%{rate}{beside}\n")

    def _rate(self, done: int, total: int, now: float) -> str:
        """Rate since the first call and time left, if a unit was given; work resumed counts not."""
        if not self._unit:
            return ""
        if self._first is None:
            self._first = (done, now)
        before, since = self._first
        if done <= before or now <= since:
            return ""
        rate = (done - before) / (now - since)
        return f", {rate:.3g} {self._unit}/s, {duration((total - done) / rate)} left"

    def show_values(self) -> None:
        """Show ``values`` alone, where there is no known amount of work."""
        now = time.monotonic()
        if now - self._drawn < (0.05 if self._terminal else 5.0):
            return
        self._drawn = now
        self._write(f"\r\033[K{self._label}: {self.values}" if self._terminal
                    else f"{self._label}: {self.values}\n")  # fmt: skip
        self._open_line = self._terminal

    def close(self) -> None:
        """End the line of the bar."""
        if self._open_line:
            self._write("\n")
            self._open_line = False

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def duration(seconds: float) -> str:
    """Seconds as text: ``8 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
