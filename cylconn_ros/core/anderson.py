"""Anderson acceleration of a fixed-point iteration x <- g(x).

The last values of g and of the residual f = g(x) - x are stored. The next iterate is the linear
combination of the stored g whose combined residual is smallest (Anderson, J. ACM 1965; Walker and
Ni, SIAM J. Numer. Anal. 2011). If the residual grows, the iteration restarts from its best iterate.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEMORY = 6  # stored iterates
PLAIN_ITERATIONS = 2  # before acceleration starts: most problems need no more
MAX_GROWTH = 100.0  # of an accelerated iterate over the first ones; larger ones are rejected
RESTART_RATIO = 10.0  # of the residual over the best one: restart


class AndersonAcceleration:
    """State of one accelerated iteration; call :meth:`next` with every g(x) and g(x) - x."""

    def __init__(self) -> None:
        self._gs: list[Array] = []
        self._fs: list[Array] = []
        self._count = 0
        self._scale = 0.0
        self._best: Array = np.zeros(0)
        self._best_residual = np.inf

    def next(self, g: Array, f: Array) -> Array:
        """The next iterate x, (n,), from g = g(x) and f = g(x) - x."""
        self._count += 1
        size = float(np.abs(f).max())
        if size < self._best_residual:
            self._best, self._best_residual = g.copy(), size
        if self._count <= PLAIN_ITERATIONS:
            self._scale = max(self._scale, float(np.abs(g).max()))
            return g
        if size > RESTART_RATIO * self._best_residual:
            self._gs.clear()
            self._fs.clear()
            self._best_residual = size
            return self._best
        self._gs, self._fs = [*self._gs, g.copy()][-MEMORY:], [*self._fs, f.copy()][-MEMORY:]
        if len(self._fs) < 2:
            return g
        df, dg = np.diff(self._fs, axis=0).T, np.diff(self._gs, axis=0).T
        shares = np.linalg.lstsq(df, f, rcond=1e-12)[0]
        found: Array = g - dg @ shares
        return found if np.abs(found).max() <= MAX_GROWTH * self._scale else g
