"""MuJoCo keeps the joint, this package computes its friction: :class:`cylconn_ros.mujoco.Friction`.

The same MuJoCo model with its springs as in the other configurations. Friction and stops are those
of the scene. One call from Python per step, as in a user's loop.
"""

from __future__ import annotations

import dataclasses

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.peers.common import Course
from cylconn_ros.bench.peers.mujoco import slide_attributes
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.peers.solver import EndState, Problem, Solve, Solver
from cylconn_ros.errors import SceneError
from cylconn_ros.mujoco.friction import Friction
from cylconn_ros.scene.behaviour import Damping, Elasticity


class InMujoco(MujocoScene):
    """A problem in MuJoCo with this package's friction.

    Raises NotApplicableError if nothing acts on the joint, or if the preload changes over time.
    """

    def __init__(self, problem: Problem) -> None:
        attributes = slide_attributes(problem.scene, problem.value, limits=False)
        super().__init__(problem.scene, 0.0, "implicitfast", problem.value, attributes)
        self.course = Course(problem.scene, problem.value, problem.steps)
        if self.course.moves:
            raise NotApplicableError("Friction has no preload that changes over time")
        scene = dataclasses.replace(problem.scene, elasticity=Elasticity(), damping=Damping())
        try:
            self.friction = Friction(
                self.model, self.data, slide="slide", hinge="spin", scene=scene
            )
        except SceneError as error:
            raise NotApplicableError(str(error)) from None

    def __call__(self) -> EndState:
        """All steps from the start."""
        self.reset()
        self.friction.reset()
        applied, step = self.data.qfrc_applied, self.friction.step
        loaded = self.course.on
        for push in self.course.push.tolist():
            if loaded:
                applied[-2] = push
            step()
        return self.end_state


def _prepare(problem: Problem) -> Solve:
    return InMujoco(problem)


SOLVERS = (
    Solver(
        "MuJoCo with this package's friction", "mujoco", "own", "step",
        "MuJoCo's joint, friction by cylconn_ros.mujoco.Friction, called from Python", _prepare,
    ),
)  # fmt: skip
