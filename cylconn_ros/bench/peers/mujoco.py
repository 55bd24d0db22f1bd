"""MuJoCo: slide and hinge on one axis, with the friction that each of its users would have.

- constant: ``frictionloss`` of the start's normal force, set once; steps in one call.
- calibrated: one constant, fitted at a step of 1 ms to the answer of this scene at four fifths of
  its speed.
- loop: from Python, ``frictionloss`` of the last step's reaction, shared by slide and hinge as the
  slip is. MuJoCo's solver then holds or brakes implicitly.

``solimpfriction`` and ``solreffriction`` are as hard as the solver takes them: with the defaults a
held joint creeps. Stops: range with a ``solreflimit`` whose restitution is right; in the loop, the
rate is turned round by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.bench.common.errors import LeftOutError
from cylconn_ros.bench.common.frames import rotation
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, length
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.peers.solver import Array, Contestant, Read, Solve, Task, milder
from cylconn_ros.scene.scene import Scene

FITTED_AT = 1e-3  # s
SMALL = 1e-9  # m/s: at rest


class Peer(MujocoScene):
    """A task in MuJoCo."""

    def __init__(self, task: Task, integrator: str, friction: float, limits: bool) -> None:
        scene = task.scene
        super().__init__(scene, friction, integrator, task.value, _slide(scene, task.value, limits))
        if scene.friction.on:  # after the model is made: both joints alike
            self.model.dof_solimp[-2:, :2] = 0.9999
            self.model.dof_solref[-2:] = 2.0 * task.value, 1.0
        self.task, self.joint, self.law = task, Joint(scene), Coulomb(scene)
        self.stops = Stops(scene, length(scene))
        self.first = self.friction_now() if self.law.on else 0.0

    def looped(self) -> Read:
        """All steps, each with the friction of the last one's reaction."""
        self.reset()
        mujoco, model, data, law = self.mujoco, self.model, self.data, self.law
        mj_step, reaction = mujoco.mj_step, mujoco.mj_rnePostConstraint
        loss, qvel, qpos = model.dof_frictionloss, data.qvel, data.qpos
        body, at = model.body("b").id, data.subtree_com[model.body("a").id]
        limit = self.first
        for _ in range(self.task.steps):
            if law.on:
                v, w = qvel[-2:].tolist()
                loss[-2:] = law.shares(limit, v, w, SMALL)
            mj_step(model, data)
            if law.on:
                reaction(model, data)
                limit = self.limit(data.cfrc_int[body].tolist(), at.tolist())
            if self.stops.on:
                bounced = self.stops.bounced(float(qpos[-2]), float(qvel[-2]))
                if bounced:
                    qpos[-2], qvel[-2] = bounced
        return self.end

    def friction_now(self) -> float:
        """The limit at the start, friction itself left out."""
        self.model.dof_frictionloss[-2:] = 0.0
        self.mujoco.mj_forward(self.model, self.data)
        self.mujoco.mj_rnePostConstraint(self.model, self.data)
        body = self.model.body("b").id
        at = self.data.subtree_com[self.model.body("a").id]
        return self.limit(self.data.cfrc_int[body].tolist(), at.tolist())

    def limit(self, reaction: list[float], about: list[float]) -> float:
        """Mu FN of a reaction as MuJoCo has it: torque about a tree's mass centre, force."""
        mx, my, mz, fx, fy, fz = reaction
        hx, hy, hz = self.data.xanchor[-1].tolist()
        dx, dy, dz = about[0] - hx, about[1] - hy, about[2] - hz
        moment = (mx + dy * fz - dz * fy, my + dz * fx - dx * fz, mz + dx * fy - dy * fx)
        return self.law.limit((fx, fy, fz), moment, self.data.xaxis[-1].tolist())

    def run_through(self) -> Read:
        """All steps in one call."""
        self.reset()
        self.run(self.task.steps)
        return self.end

    def end(self) -> Array:
        """(26,) at the end."""
        qpos, qvel, joint = self.data.qpos, self.data.qvel, self.joint
        slide, spin = qpos[-2:].tolist()
        if not joint.free:
            return joint.state(joint.pose_a, joint.twist_a, slide, spin, qvel[-2:].tolist())
        w, x, y, z = qpos[3:7]
        pose = np.array([*qpos[:3], x, y, z, w])
        twist = np.array([*qvel[:3], *(rotation(pose[3:]) @ qvel[3:6])])
        return joint.state(pose, twist, slide, spin, qvel[-2:].tolist())


def _slide(scene: Scene, h: float, limits: bool) -> str:
    """The slide's spring and stops."""
    text = []
    start = length(scene)
    spring = Spring(scene)
    if spring.stiffness:
        text.append(f'stiffness="{spring.stiffness!r}" springref="{spring.slack!r}"')
    stops = Stops(scene, start)
    if limits and stops.on:
        # A contact of ten steps whose damping leaves the restitution.
        stiffness = (math.pi / (10.0 * h)) ** 2
        loss = -math.log(max(stops.restitution, 1e-3))
        ratio = loss / math.hypot(math.pi, loss)
        damping = 2.0 * ratio * math.sqrt(stiffness)
        text.append(
            f'limited="true" range="{stops.low!r} {stops.high!r}" '
            f'solreflimit="{-stiffness!r} {-damping!r}" solimplimit="0.9999 0.9999 0.001"'
        )
    return " ".join(text)


def _variant(
    integrator: str, how: Callable[[Task, str], tuple[Peer, Solve]]
) -> Callable[[Task], Solve]:
    return lambda task: how(task, integrator)[1]


def _loop(task: Task, integrator: str) -> tuple[Peer, Solve]:
    peer = Peer(task, integrator, 0.0, limits=False)
    if not peer.law.on and not peer.stops.on:
        raise LeftOutError("nothing to do in a loop: no friction, no stops")
    return peer, peer.looped


def _constant(task: Task, integrator: str) -> tuple[Peer, Solve]:
    peer = Peer(task, integrator, 0.0, limits=True)
    return _set(peer, peer.first), peer.run_through


def _set(peer: Peer, limit: float) -> Peer:
    peer.model.dof_frictionloss[-2:] = limit, limit * peer.law.radius
    return peer


_FITTED: dict[tuple[object, ...], float] = {}


def _calibrated(task: Task, integrator: str) -> tuple[Peer, Solve]:
    if not task.scene.friction.on:
        raise LeftOutError("nothing to calibrate: no friction")
    key = task.name, task.duration, *task.truth.values()
    if key not in _FITTED:
        mild = Task(task.name, milder(task.scene), task.duration, FITTED_AT, task.truth)
        _FITTED[key] = fit(mild)
    fitted = _FITTED[key]
    peer = _set(Peer(task, integrator, 0.0, limits=True), fitted)
    return peer, peer.run_through


def fit(task: Task) -> float:
    """The constant whose slide and spin at the end come nearest to the task's truth.

    A coarse search over three decades about the start's limit, then golden sections.
    """
    peer = Peer(task, "implicitfast", 0.0, limits=True)

    def off(logarithm: float) -> float:
        _set(peer, peer.first * math.exp(logarithm)).run_through()
        slide, spin = peer.slide()
        ways = slide - task.truth.get("slide", slide), spin - task.truth.get("spin", spin)
        return math.hypot(ways[0], peer.law.radius * ways[1])

    grid = np.linspace(-3.5, 3.5, 57)
    best = int(np.argmin([off(x) for x in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(40):
        left, right = high - golden * (high - low), low + golden * (high - low)
        if off(left) <= off(right):
            high = right
        else:
            low = left
    return float(peer.first * math.exp(0.5 * (low + high)))


INTEGRATORS = ("Euler", "implicitfast", "RK4")
SETUPS: tuple[tuple[str, str, Any], ...] = (
    ("constant", "frictionloss of the start's normal force", _constant),
    ("calibrated", "one frictionloss, fitted to the scene at 0.8 of its speed", _calibrated),
    ("loop", "frictionloss of the last step's reaction, from Python", _loop),
)
CONTESTANTS = tuple(
    Contestant(
        f"MuJoCo {integrator}, {name}", "mujoco", "simulator", "step", about,
        _variant(integrator, how),
    )
    for integrator in INTEGRATORS
    for name, about, how in SETUPS
)  # fmt: skip
