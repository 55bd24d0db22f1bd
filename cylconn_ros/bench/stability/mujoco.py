"""MuJoCo as a peer solver of the stability map: slide and hinge on one axis, two kinds of friction.

- Constant friction: ``frictionloss`` from the normal force at the start.
- Friction loop in Python: before each step ``frictionloss`` from the reaction of the last step,
  split between slide and hinge in proportion to the slip components.
"""

from __future__ import annotations

import math

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.peers.common import Coulomb
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.stability.loop import Trace
from cylconn_ros.scene.scene import Scene

AT_REST = 1e-4  # m/s: below it slide and hinge each get the whole limit, else a held joint creeps


def simulate(scene: Scene, integrator: str, friction_loop: bool) -> Trace:
    """Simulate the scene with MuJoCo at the scene's period.

    Raises NotApplicableError for a misaligned joint, NotInstalledError without MuJoCo.
    """
    if scene.node_b.orientation:
        raise NotApplicableError("slide and hinge share one axis: no misalignment")
    if scene.friction.overlap_change != "constant":
        raise NotApplicableError("the friction limit has a constant overlap")
    solver = _Mujoco(scene, integrator)
    if friction_loop and not solver.law.on:
        raise NotApplicableError("no friction: no friction loop")
    return solver.trace(friction_loop)


class _Mujoco(MujocoScene):
    def __init__(self, scene: Scene, integrator: str) -> None:
        super().__init__(scene, integrator=integrator)
        self.mujoco.set_mju_user_warning(_ignore)  # the default writes a file; see `diverged`
        self.harden_friction()
        low, high = scene.stops.l_min, scene.stops.l_max
        if not math.isnan(low + high):
            start = scene.initial_pose(1)[0]
            self.model.jnt_limited[-2] = 1
            self.model.jnt_range[-2] = low - start, high - start
            self.model.jnt_solref[-2] = 2.0 * scene.period, 1.0
            self.model.jnt_solimp[-2, :2] = 0.9999
        self.law = Coulomb(scene)

    def trace(self, friction_loop: bool) -> Trace:
        """Run from the start for the scene's duration."""
        h = self.scene.period
        n = max(20, round(self.scene.plant.duration / h))
        states = np.zeros((n, 26))
        self.mujoco.mj_forward(self.model, self.data)
        limit, done = self.limit(), n
        if self.law.on:
            self.set_friction(limit, limit * self.law.radius)
        for k in range(n):
            states[k] = self.state()
            if friction_loop:
                v, w = self.data.qvel[-2:].tolist()
                self.set_friction(*self.law.split(limit, v, w, AT_REST))
            self.mujoco.mj_step(self.model, self.data)
            limit = self.limit() if friction_loop else limit
            if self.diverged():
                done = k + 1
                break
        return Trace(h * np.arange(done, dtype=np.float64), states[:done], diverged=done < n)

    def limit(self) -> float:
        """Friction limit mu FN of the last step's reaction, N."""
        return self.friction_limit(self.law) if self.law.on else 0.0

    def diverged(self) -> bool:
        """Whether MuJoCo has found a bad state and reset itself."""
        kinds = self.mujoco.mjtWarning
        bad = kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC
        return any(self.data.warning[int(kind)].number for kind in bad)


def _ignore(_text: str) -> None:
    """MuJoCo's warnings are also counted in its data."""
