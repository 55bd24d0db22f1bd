"""MuJoCo on a scene: the same two bodies, and slide and hinge on one axis between them.

MuJoCo has no cylindrical joint; two joints of one body on one axis are what its user would write.
They are generalised coordinates: the constraint cannot drift. Friction of a joint is a constant
(``frictionloss``), each component by itself; it is calibrated on the mean of the true limit. There
are no contacts, sensors or pictures to pay for.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.bench.common.errors import AbsentError
from cylconn_ros.bench.common.frames import inside, inverse, outside, product, rotation
from cylconn_ros.scene.scene import Body, Scene

Array = NDArray[np.float64]
Steps = Callable[[int], None]
"""Does n steps."""


def module() -> Any:
    """MuJoCo itself; raises AbsentError."""
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise AbsentError("mujoco is not installed: pip install '.[bench]' brings it") from None


class MujocoScene:
    """A scene in MuJoCo, at its start.

    Args:
        friction: constant friction force (N) on the slide; times R on the hinge.
        integrator: Euler, RK4 or implicitfast. timestep: s; the scene's period by default.
        slide: more attributes of the slide's joint, as MJCF.

    Raises AbsentError, and ValueError for a scene that is not a free body B on a fixed or free A.
    """

    def __init__(
        self,
        scene: Scene,
        friction: float = 0.0,
        integrator: str = "Euler",
        timestep: float | None = None,
        slide: str = "",
    ) -> None:
        self.mujoco = module()
        self.scene = scene
        self.free = scene.body_a.kind == "free"
        self.model = self.mujoco.MjModel.from_xml_string(
            document(scene, friction, integrator, timestep or scene.period, slide)
        )
        self.data = self.mujoco.MjData(self.model)
        self.start = _velocities(scene)
        self.reset()

    def reset(self) -> None:
        """Back to the start of the scene."""
        self.mujoco.mj_resetData(self.model, self.data)
        self.data.qvel[:] = self.start

    def step(self, n: int) -> None:
        """N steps, one call from Python each."""
        step, model, data = self.mujoco.mj_step, self.model, self.data
        for _ in range(n):
            step(model, data)

    def run(self, n: int) -> None:
        """N steps in one call."""
        self.mujoco.mj_step(self.model, self.data, n)

    def slide(self) -> tuple[float, float]:
        """Slide (m) and spin (rad) since the start."""
        return float(self.data.qpos[-2]), float(self.data.qpos[-1])

    def state(self) -> Array:
        """(26,) poses and twists of both bodies as in a sample."""
        self.mujoco.mj_forward(self.model, self.data)
        state = np.zeros(26)
        state[0:7] = self.scene.initial_pose(0)
        velocity = np.zeros(6)
        for name, at in (("a", 0), ("b", 13)):
            if name == "b" or self.free:
                body = self.model.body(name).id
                state[at : at + 3] = self.data.xpos[body]
                w, x, y, z = self.data.xquat[body]
                state[at + 3 : at + 7] = x, y, z, w
                self.mujoco.mj_objectVelocity(
                    self.model, self.data, self.mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0
                )
                state[at + 7 : at + 10] = velocity[3:]  # MuJoCo has the rotation first
                state[at + 10 : at + 13] = velocity[:3]
        return state


def document(
    scene: Scene, friction: float, integrator: str, timestep: float, slide: str = ""
) -> str:
    """The scene as MJCF; ``slide``: more attributes of the slide's joint.

    Raises ValueError for a scene that this does not cover.
    """
    a, b = scene.body_a, scene.body_b
    if b.kind != "free" or a.kind not in ("free", "fixed"):
        raise ValueError("needs a free body B on a fixed or free body A")
    pose_a, pose_b = scene.initial_pose(0), scene.initial_pose(1)
    turn = product(inverse(pose_b[3:]), pose_a[3:])
    axis = rotation(turn) @ rotation(scene.node_a.orientation)[:, 0]
    place = inside(pose_a, pose_b[:3])
    radius = scene.friction.radius if scene.friction.on else 0.0
    common = f'pos="{_text(scene.node_b.position)}" axis="{_text(axis)}"'
    rotor = f"""<body name="b" pos="{_text(place)}" quat="{_wxyz(inverse(turn))}">{_inertial(b)}
        <joint type="slide" {common} frictionloss="{friction!r}" {slide}/>
        <joint type="hinge" {common} frictionloss="{friction * radius!r}"/></body>"""
    free = f"<freejoint/>{_inertial(a)}" if a.kind == "free" else ""
    return f"""<mujoco>
      <option timestep="{timestep!r}" integrator="{integrator}" gravity="{_text(scene.gravity)}"/>
      <worldbody><body name="a" pos="{_text(pose_a[:3])}" quat="{_wxyz(pose_a[3:])}">{free}
        {rotor}</body></worldbody></mujoco>"""


def _velocities(scene: Scene) -> Array:
    """MuJoCo's qvel at the start: of A where it is free, of slide and spin."""
    pose_a, pose_b = scene.initial_pose(0), scene.initial_pose(1)
    twist_a, twist_b = np.array(scene.initial_twist(0)), np.array(scene.initial_twist(1))
    turn_a = rotation(pose_a[3:])
    axis = turn_a @ rotation(scene.node_a.orientation)[:, 0]
    xb = outside(pose_b, scene.node_b.position)
    if scene.body_a.kind == "fixed":
        twist_a = np.zeros(6)
    at_b = twist_b[:3] + np.cross(twist_b[3:], xb - pose_b[:3])
    of_a = twist_a[:3] + np.cross(twist_a[3:], xb - pose_a[:3])
    relative = [axis @ (at_b - of_a), axis @ (twist_b[3:] - twist_a[3:])]
    if scene.body_a.kind == "fixed":
        return np.array(relative)
    return np.array([*twist_a[:3], *(turn_a.T @ twist_a[3:]), *relative])


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
