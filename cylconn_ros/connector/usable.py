"""Whether a motion is one that the joint permits: what makes its results worthless, in words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout

_LEAST_OFFSET = 1e-3  # m
_LEAST_ANGLE = 0.1  # rad
_SHARE = 0.5  # of the motion along the joint

Array = NDArray[np.float64]


def contradiction(slide: float, spin: float, offset: float, angle: float) -> str:
    """Describe a motion that leaves the joint; '' for one that does not.

    Args:
        slide, spin: range of slide (m) and rotation (rad) over the motion.
        offset, angle: greatest violation of the constraint, m and rad.
    """
    texts = []
    if offset > max(_LEAST_OFFSET, _SHARE * slide) or np.isnan(offset):
        texts.append(f"{offset:.3g} m off the slot axis while it slides {slide:.3g} m")
    if angle > max(_LEAST_ANGLE, _SHARE * spin):
        texts.append(f"{angle:.3g} rad out of line while it turns {spin:.3g} rad")
    if not texts:
        return ""
    return (
        f"the motion leaves the joint: up to {' and '.join(texts)}; the geometry (node_a, node_b, "
        "frames, reference) does not fit the motion, or the motion ran away"
    )


class MotionCheck:
    """Collects the outputs of the samples of a motion.

    Attributes
    ----------
        samples: number of samples. solved: those with a solution.
    """

    def __init__(self) -> None:
        self.samples = self.solved = 0
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)
        self._worst = np.zeros(2)

    def add(self, outs: Array) -> None:
        """Add outputs (n, NOUT)."""
        self.samples += len(outs)
        good = outs[outs[:, layout.STATUS] == layout.OK]
        self.solved += len(good)
        if len(good):
            motion = good[:, [layout.DISPLACEMENT, layout.ROTATION]]
            self._low = np.minimum(self._low, motion.min(axis=0))
            self._high = np.maximum(self._high, motion.max(axis=0))
            worst = good[:, [layout.OFFSET_VIOLATION, layout.ANGULAR_VIOLATION]].max(axis=0)
            self._worst = np.maximum(self._worst, worst)

    def problem(self) -> str:
        """Return why the samples are worth nothing; '' if they are not."""
        if not self.samples:
            return ""
        if not self.solved:
            return f"no sample could be used: all {self.samples} were refused"
        slide, spin = self._high - self._low
        return contradiction(float(slide), float(spin), *map(float, self._worst))
