"""A fixed point sooner than by repetition: Anderson's acceleration.

Of x <- g(x) the last values of g and of f = g(x) - x are kept. The next x is the combination of the
g whose combined f is least (Anderson, J. ACM 1965; Walker and Ni, SIAM J. Numer. Anal. 2011). Where
that does not lead on, repetition goes on from the best so far.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

KEPT = 6  # values
PLAIN = 2  # repetitions first: most problems need no more
FAR = 100.0  # times as large as the first repetitions: no combination to be trusted
WORSE = 10.0  # by this factor than the best: forget what was kept


class Sooner:
    """Propose where to go on; to be told every g and f."""

    def __init__(self) -> None:
        self._gs: list[Array] = []
        self._fs: list[Array] = []
        self._told = 0
        self._usual = 0.0
        self._best: Array = np.zeros(0)
        self._size = np.inf

    def next(self, g: Array, f: Array) -> Array:
        """The next x, from g(x) and g(x) - x."""
        self._told += 1
        size = float(np.abs(f).max())
        if size < self._size:
            self._best, self._size = g.copy(), size
        if self._told <= PLAIN:
            self._usual = max(self._usual, float(np.abs(g).max()))
            return g
        if size > WORSE * self._size:
            self._gs.clear()
            self._fs.clear()
            self._size = size
            return self._best
        self._gs, self._fs = [*self._gs, g.copy()][-KEPT:], [*self._fs, f.copy()][-KEPT:]
        if len(self._fs) < 2:
            return g
        df, dg = np.diff(self._fs, axis=0).T, np.diff(self._gs, axis=0).T
        shares = np.linalg.lstsq(df, f, rcond=1e-12)[0]
        found: Array = g - dg @ shares
        return found if np.abs(found).max() <= FAR * self._usual else g
