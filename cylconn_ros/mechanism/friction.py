"""Friction of a joint inside a mechanism, for a simulator that gives its equations as arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cylconn_ros.connector.outputs import StepResult
from cylconn_ros.core import layout, model
from cylconn_ros.mechanism import step
from cylconn_ros.mechanism.parameters import mechanism_scene
from cylconn_ros.mechanism.reaction import Reaction
from cylconn_ros.scene import behaviour
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]


class Friction:
    """Friction, stops, springs and drives of one slide, hinge or cylindrical joint of a mechanism.

    The simulator keeps the joint. Once per step :meth:`step` takes its mass matrix, free
    acceleration and the joint's reaction, and gives the force on the slide and the moment on the
    spin for this step. Friction is made of the reactions of the same step, the force included.

    The simulator advances semi-implicitly: ``v += h a`` with the acceleration a of this step, then
    the positions with the new v. Contacts and other constraints of the simulator are not seen here;
    include them in ``mass_matrix`` and ``free_acceleration``, if they are linear.

    Attributes
    ----------
        scene: the scene in use. generalised_force: (nv,) of the last step.

    Raises SceneError for a scene that has nothing to act, or a limit of published wrenches.

    Example::

        friction = cr.mechanism.Friction(cr.Friction(coefficient=0.2, radius=0.01, overlap=0.1))
        # A block of 2 kg that slides at 1 m/s on a level guide, gravity along -e3
        result = friction.step(
            h=0.001, velocity=[1.0], mass_matrix=[[2.0]], free_acceleration=[0.0],
            axes=[[1.0], [0.0]], reaction=([0, 0, 19.62, 0, 0, 0], [[2.0]] + 5 * [[0.0]]),
            length=0.0,
        )
        print(result["force_friction"])  # -0.2 * 19.62 N
    """

    def __init__(self, scene: Scene | behaviour.Friction) -> None:
        self.scene = mechanism_scene(scene)
        self.par = pack(self.scene)
        self.memory = np.zeros(model.NMEM)
        self.generalised_force: Array = np.zeros(0)
        self._numbers = np.zeros(step.NSTEP)

    def reset(self) -> None:
        """Forget the history; the next step is the first one, and the reference configuration."""
        self.memory[:] = 0.0

    def step(
        self,
        *,
        h: float,
        velocity: ArrayLike,
        mass_matrix: ArrayLike,
        free_acceleration: ArrayLike,
        axes: ArrayLike,
        reaction: Reaction | tuple[ArrayLike, ArrayLike] | Callable[[Array], ArrayLike],
        length: float,
        angle: float = 0.0,
    ) -> StepResult:
        """Force on the slide and moment on the spin for the step of h seconds that begins now.

        Args:
            h: s.
            velocity: (nv,) generalised velocity v.
            mass_matrix: (nv, nv) M, by which a force changes the acceleration of the step; with
                implicit damping M + h D.
            free_acceleration: (nv,) (v+ - v)/h of the step without the force of this joint.
            axes: (2, nv) J: rate of the slide (m/s) and of the spin (rad/s) for v. A zero row is a
                component that the joint does not have.
            reaction: wrench (f1 f2 f3 m1 m2 m3) that the joint transmits to body B about node b, in
                the axes of node a, for a generalised acceleration a: ``(bias, matrix)`` for
                ``bias + matrix @ a``, or a function of a that is affine, called three times.
            length, angle: of slide (m) and spin (rad, counted on over turns).

        Returns the result; ``generalised_force`` is then the (nv,) force ``J.T @ (f1, m1)``.

        Raises ValueError for arrays whose shapes do not fit.
        """
        v = _array(velocity, "velocity", (-1,))
        nv = len(v)
        mass = _array(mass_matrix, "mass_matrix", (nv, nv))
        free = _array(free_acceleration, "free_acceleration", (nv,))
        j = _array(axes, "axes", (2, nv))
        by: Array = np.asarray(np.linalg.solve(mass, j.T), dtype=np.float64)
        wrenches = _wrenches(reaction, free, by, nv)
        s = self._numbers
        s[step.LENGTH], s[step.ANGLE] = length, angle
        s[step.RATES : step.RATES + 2] = j @ v
        s[step.FREE : step.FREE + 2] = j @ (v + h * free)
        mobility = h * (j @ by)
        s[step.MOBILITY : step.MOBILITY + 3] = mobility[0, 0], mobility[0, 1], mobility[1, 1]
        for k, row in enumerate(j):
            if not row.any():  # absent: at rest, and coupled to nothing
                s[step.MOBILITY + 2 * k] = 1.0
        for at, wrench in zip((step.BASE, step.BY_F1, step.BY_M1), wrenches, strict=True):
            s[at : at + 4] = wrench[1], wrench[2], wrench[4], wrench[5]
        out = np.empty(layout.NOUT)
        step.solve(self.par, self.memory, s, float(h), out)
        self.generalised_force = j.T @ out[[layout.FORCE, layout.MOMENT]]
        return StepResult(out)


def _wrenches(reaction: Any, free: Array, by: Array, nv: int) -> tuple[Array, Array, Array]:
    """The wrench without force, and its change by a unit of f1 and of m1."""
    base: Array
    if callable(reaction):
        # A copy: a simulator may return a view of what its next call overwrites.
        base = np.array(_array(reaction(free), "reaction", (6,)))
        changed = [_array(reaction(free + by[:, k]), "reaction", (6,)) - base for k in range(2)]
        return base, changed[0], changed[1]
    bias: Any = _array(reaction[0], "reaction[0]", (6,))
    matrix = _array(reaction[1], "reaction[1]", (6, nv))
    base = bias + matrix @ free
    return base, matrix @ by[:, 0], matrix @ by[:, 1]


def _array(value: ArrayLike, name: str, shape: tuple[int, ...]) -> Array:
    array: Array = np.asarray(value, dtype=np.float64)
    if array.ndim != len(shape) or any(
        n not in (m, -1) for m, n in zip(array.shape, shape, strict=True)
    ):
        wanted = tuple("nv" if n < 0 else n for n in shape)
        raise ValueError(f"{name}: has the shape {array.shape}, must be {wanted}")
    return array
