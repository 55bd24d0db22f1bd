"""MuJoCo model of a scene: two bodies with a slide and a hinge on one axis between them.

MuJoCo has no cylindrical joint; a user would write two joints of one body on one axis. They are
generalised coordinates, so the constraint cannot drift. Joint friction in MuJoCo is a constant per
joint (``frictionloss``), for slide and hinge separately. The model has no contacts, sensors or
visuals.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cylconn_ros.bench.common.frames import rotation
from cylconn_ros.bench.peers.common import Coulomb, Joint
from cylconn_ros.bench.peers.solver import Array, package
from cylconn_ros.scene.scene import Body, Scene


class MujocoScene:
    """A scene in MuJoCo, at its initial state.

    Args:
        friction: constant friction force on the slide, N; times R on the hinge.
        integrator: Euler, RK4 or implicitfast. timestep: s; by default the period of the scene.
        slide: additional MJCF attributes of the slide joint.

    Raises NotInstalledError, and NotApplicableError unless body B is free and body A is fixed or
    free.
    """

    def __init__(
        self,
        scene: Scene,
        friction: float = 0.0,
        integrator: str = "Euler",
        timestep: float | None = None,
        slide: str = "",
    ) -> None:
        self.mujoco = package("mujoco", "bench")
        self.scene, self.joint = scene, Joint(scene)
        self.timestep = timestep or scene.period
        self.model = self.mujoco.MjModel.from_xml_string(
            mjcf(self.joint, friction, integrator, self.timestep, slide)
        )
        self.data = self.mujoco.MjData(self.model)
        self._start = _initial_velocities(self.joint)
        body, root = self.model.body("b").id, self.model.body("a").id
        self._reaction = self.data.cfrc_int[body]  # torque, force
        self._reaction_point = self.data.subtree_com[root]
        self._anchor, self._axis = self.data.xanchor[-1], self.data.xaxis[-1]
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self.mujoco.mj_resetData(self.model, self.data)
        self.data.qvel[:] = self._start

    def step(self, n: int) -> None:
        """Run n steps, one call from Python per step."""
        step, model, data = self.mujoco.mj_step, self.model, self.data
        for _ in range(n):
            step(model, data)

    def run(self, n: int) -> None:
        """Run n steps in one call."""
        self.mujoco.mj_step(self.model, self.data, n)

    def slide(self) -> tuple[float, float]:
        """Slide (m) and spin (rad) since the start."""
        return float(self.data.qpos[-2]), float(self.data.qpos[-1])

    def harden_friction(self) -> None:
        """Make joint friction as stiff as the solver accepts; with the defaults stick creeps."""
        self.model.dof_solimp[-2:, :2] = 0.9999
        self.model.dof_solref[-2:] = 2.0 * self.timestep, 1.0

    def set_friction(self, slide: float, hinge: float) -> None:
        """Set the friction of the slide (N) and of the hinge (N.m)."""
        self.model.dof_frictionloss[-2:] = slide, hinge

    def friction_limit(self, law: Coulomb) -> float:
        """Friction limit mu FN (N) of the reaction in the last step."""
        return law.mu * abs(self.pressing(law) + law.preload)

    def pressing(self, law: Coulomb) -> float:
        """Radial force and bending (N) of the reaction in the last step."""
        self.mujoco.mj_rnePostConstraint(self.model, self.data)
        mx, my, mz, fx, fy, fz = self._reaction.tolist()  # torque about the tree's centre of mass
        px, py, pz = self._reaction_point.tolist()
        hx, hy, hz = self._anchor.tolist()
        dx, dy, dz = px - hx, py - hy, pz - hz
        moment = (mx + dy * fz - dz * fy, my + dz * fx - dx * fz, mz + dx * fy - dy * fx)
        return law.pressing((fx, fy, fz), moment, self._axis.tolist(), float(self.data.qpos[-2]))

    def end_state(self) -> Array:
        """(26,) poses and twists after the last step."""
        qpos, qvel, joint = self.data.qpos, self.data.qvel, self.joint
        slide, spin = qpos[-2:].tolist()
        if not joint.free:
            return joint.state(joint.pose_a, joint.twist_a, slide, spin, qvel[-2:].tolist())
        w, x, y, z = qpos[3:7]
        pose = np.array([*qpos[:3], x, y, z, w])
        twist = np.array([*qvel[:3], *(rotation(pose[3:]) @ qvel[3:6])])
        return joint.state(pose, twist, slide, spin, qvel[-2:].tolist())

    def state(self) -> Array:
        """(26,) poses and twists of both bodies as in a sample."""
        self.mujoco.mj_forward(self.model, self.data)
        state = np.zeros(26)
        state[0:7] = self.scene.initial_pose(0)
        velocity = np.zeros(6)
        for name, at in (("a", 0), ("b", 13)):
            if name == "b" or self.joint.free:
                body = self.model.body(name).id
                state[at : at + 3] = self.data.xpos[body]
                w, x, y, z = self.data.xquat[body]
                state[at + 3 : at + 7] = x, y, z, w
                self.mujoco.mj_objectVelocity(
                    self.model, self.data, self.mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0
                )
                state[at + 7 : at + 10] = velocity[3:]  # MuJoCo has the angular velocity first
                state[at + 10 : at + 13] = velocity[:3]
        return state


def mjcf(joint: Joint, friction: float, integrator: str, timestep: float, slide: str = "") -> str:
    """The scene of a joint as MJCF; ``slide``: additional attributes of the slide joint."""
    scene = joint.scene
    radius = scene.friction.radius if scene.friction.on else 0.0
    common = f'pos="{_text(joint.node_b)}" axis="{_text(joint.axis_b)}"'
    pose = f'pos="{_text(joint.position)}" quat="{_wxyz(joint.orientation)}"'
    body_b = f"""<body name="b" {pose}>{_inertial(scene.body_b)}
        <joint name="slide" type="slide" {common} frictionloss="{friction!r}" {slide}/>
        <joint name="spin" type="hinge" {common} frictionloss="{friction * radius!r}"/></body>"""
    free = f"<freejoint/>{_inertial(scene.body_a)}" if joint.free else ""
    a = joint.pose_a
    return f"""<mujoco>
      <option timestep="{timestep!r}" integrator="{integrator}" gravity="{_text(scene.gravity)}"/>
      <worldbody><body name="a" pos="{_text(a[:3])}" quat="{_wxyz(a[3:])}">{free}
        {body_b}</body></worldbody></mujoco>"""


def _initial_velocities(joint: Joint) -> Array:
    """Initial qvel: of A if it is free (angular velocity in body axes), then slide and spin."""
    relative = [joint.slide_rate, joint.spin_rate]
    if not joint.free:
        return np.array(relative)
    angular = rotation(joint.pose_a[3:]).T @ joint.twist_a[3:]
    return np.array([*joint.twist_a[:3], *angular, *relative])


def _inertial(body: Body) -> str:
    ixx, ixy, ixz, iyy, iyz, izz = body.inertia
    return (
        f'<inertial pos="{_text(body.com)}" mass="{body.mass!r}" '
        f'fullinertia="{_text((ixx, iyy, izz, ixy, ixz, iyz))}"/>'
    )


def _text(numbers: Any) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def _wxyz(q: Any) -> str:
    return _text((q[3], *q[:3]))
