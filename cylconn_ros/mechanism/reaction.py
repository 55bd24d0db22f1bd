"""The wrench that a joint transmits, as an affine function of the generalised acceleration.

Body B and all that it carries are bodies i with the mass m, the inertia I about the mass centre x,
the Jacobian rows V (of the mass centre's velocity) and W (of the angular velocity w), and the
accelerations at rest of the generalised ones, V' v and W' v. By Newton and Euler the joint's wrench
on B about a point p is

    f = sum m (V a + V'v - g) - known forces
    m = sum (x - p) x m (V a + V'v - g) + I (W a + W'v) + w x I w - known torques about p

which is ``bias + matrix a`` for a the generalised acceleration of the step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Reaction(NamedTuple):
    """Wrench (f, m) on body B at node b in the axes of node a: (6,) bias and (6, nv) matrix."""

    bias: Array
    matrix: Array


class RigidBodies(NamedTuple):
    """Body B and all bodies that it carries, in world axes: arrays over n bodies.

    Attributes
    ----------
        mass: (n,) kg. position: (n, 3) mass centres, m. inertia: (n, 3, 3) about them, kg m^2.
        spin: (n, 3) angular velocities, rad/s.
        jacobian: (n, 6, nv) of the mass centre's velocity, then of the angular velocity.
        bias: (n, 6) accelerations of the mass centre and angular ones for zero generalised ones.
    """

    mass: Array
    position: Array
    inertia: Array
    spin: Array
    jacobian: Array
    bias: Array

    def reaction(
        self,
        point: ArrayLike,
        axes: ArrayLike,
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        known: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ) -> Reaction:
        """The joint's wrench on body B.

        Args:
            point: (3,) node b in the world, m.
            axes: (3, 3) rows e1, e2, e3 of node a in the world; e1 is the axis of the joint.
            gravity: (3,) m/s^2. known: (6,) other forces on the bodies and torques about ``point``.
        """
        f, m = np.array(known, float)[:3] * -1.0, np.array(known, float)[3:] * -1.0
        nv = self.jacobian.shape[2]
        by_f, by_m = np.zeros((3, nv)), np.zeros((3, nv))
        for i, mass in enumerate(self.mass):
            arm = _cross_matrix(self.position[i] - np.asarray(point))
            force = mass * (self.bias[i, :3] - np.asarray(gravity))
            by_force = mass * self.jacobian[i, :3]
            f, by_f = f + force, by_f + by_force
            momentum = self.inertia[i] @ self.spin[i]
            m = m + arm @ force + self.inertia[i] @ self.bias[i, 3:]
            m = m + np.cross(self.spin[i], momentum)
            by_m = by_m + arm @ by_force + self.inertia[i] @ self.jacobian[i, 3:]
        e = np.asarray(axes, float)
        return Reaction(np.concatenate([e @ f, e @ m]), np.vstack([e @ by_f, e @ by_m]))


def _cross_matrix(a: Array) -> Array:
    """The matrix of a x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
