"""MuJoCo as a guest on the map: its own slide and hinge on one axis, with two kinds of friction.

- ``frictionloss`` of the start's normal force, set once.
- A loop in Python: before each step ``frictionloss`` of the last step's reaction, shared by slide
  and hinge as the slip is.
"""

from __future__ import annotations

import math

import numpy as np

from cylconn_ros.bench.common.errors import LeftOutError
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.stability.loop import Trace
from cylconn_ros.scene.scene import Scene

AT_REST = 1e-4  # m/s: below it slide and hinge each get the whole limit, or a held joint creeps


def moved(scene: Scene, integrator: str, looped: bool) -> Trace:
    """The scene's motion by MuJoCo at the scene's period.

    Raises LeftOutError for a misaligned joint, AbsentError without MuJoCo.
    """
    if scene.node_b.orientation:
        raise LeftOutError("slide and hinge share one axis: nothing can be misaligned")
    try:
        peer = _Guest(scene, integrator)
    except ValueError as error:
        raise LeftOutError(str(error)) from None
    if looped and peer.law is None:
        raise LeftOutError("no friction: nothing to do in a loop")
    return peer.trace(looped)


class _Guest(MujocoScene):
    def __init__(self, scene: Scene, integrator: str) -> None:
        super().__init__(scene, integrator=integrator)
        self.mujoco.set_mju_user_warning(_quiet)  # it would write a file; see `lost`
        self.model.dof_solimp[-2:, :2] = 0.9999  # friction as hard as its solver takes it:
        self.model.dof_solref[-2:] = 2.0 * scene.period, 1.0  # the defaults creep
        low, high = scene.stops.l_min, scene.stops.l_max
        if not math.isnan(low + high):
            start = scene.initial_pose(1)[0]
            self.model.jnt_limited[-2] = 1
            self.model.jnt_range[-2] = low - start, high - start
            self.model.jnt_solref[-2] = 2.0 * scene.period, 1.0
            self.model.jnt_solimp[-2, :2] = 0.9999
        f = scene.friction
        self.law = f if f.on else None
        self.body = self.model.body("b").id
        self.root = self.model.body("a").id

    def trace(self, looped: bool) -> Trace:
        """All steps from the start."""
        h = self.scene.period
        n = max(20, round(self.scene.plant.duration / h))
        states = np.zeros((n, 26))
        self.mujoco.mj_forward(self.model, self.data)
        limit, done = self.limit(), n
        self.share(limit, both=True)
        for k in range(n):
            states[k] = self.state()
            if looped:
                self.share(limit, both=False)
            self.mujoco.mj_step(self.model, self.data)
            limit = self.limit() if looped else limit
            if self.lost():
                done = k + 1
                break
        return Trace(h * np.arange(done, dtype=np.float64), states[:done], lost=done < n)

    def lost(self) -> bool:
        """Whether it has found its state to be bad, and begun anew."""
        kinds = self.mujoco.mjtWarning
        bad = kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC
        return any(self.data.warning[int(kind)].number for kind in bad)

    def limit(self) -> float:
        """Mu FN of the last step's reaction, N."""
        if self.law is None:
            return 0.0
        self.mujoco.mj_rnePostConstraint(self.model, self.data)
        reaction = self.data.cfrc_int[self.body]  # torque about the tree's mass centre, force
        force, hinge = reaction[3:], self.data.xanchor[-1]
        moment = reaction[:3] + np.cross(self.data.subtree_com[self.root] - hinge, force)
        axis = self.data.xaxis[-1]
        bend = 2.0 / self.law.overlap if self.law.overlap > 0.0 else 0.0
        across = _across(force, axis) + bend * _across(moment, axis) + self.law.preload
        return float(self.law.coefficient * abs(across))

    def share(self, limit: float, both: bool) -> None:
        """Set the friction of slide and hinge; ``both``: each the whole."""
        if self.law is None:
            return
        r, (v, w) = self.law.radius, self.data.qvel[-2:]
        slip = math.hypot(v, r * w)
        shares = (1.0, 1.0) if both or slip < AT_REST else (abs(v) / slip, abs(r * w) / slip)
        self.model.dof_frictionloss[-2:] = limit * shares[0], limit * r * shares[1]


def _across(vector: Array, axis: Array) -> float:
    return float(np.linalg.norm(vector - (vector @ axis) * axis))


def _quiet(_text: str) -> None:
    """What MuJoCo has to say is in its data, too."""
