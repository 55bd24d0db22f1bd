"""A MuJoCo model in place of the two rigid bodies of the plant."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.errors import ModelError, SceneError
from cylconn_ros.importing.joints import find_pair
from cylconn_ros.importing.model_file import compile_spec, load_spec, mujoco_module
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]


class MujocoPlant:
    """Body A and body B of a scene in an MJCF or URDF model, stepped under received wrenches.

    The bodies are the model's with the names ``body_a.frame`` and ``body_b.frame``; a fixed body A
    need not be in the model. With ``constraint: simulator`` the model's joint stays, and its
    own friction, damping, stiffness and range are removed, since the connector sends them. With
    ``constraint: connector`` the joint is removed from a copy of the model and body B floats.
    Other joints, actuators and contacts live on.

    A period is a whole number of the model's time steps, at least one. The wrench is converted
    once to force and torque about the mass centre in world axes, and held over the period.

    Attributes
    ----------
        state: (26,) pose and twist of A, then of B, as in a sample (world axes).
        model, data: MuJoCo's. steps: periods since the start. period_ns: of one period.

    Raises ModelError for a model or joint that cannot be used, SceneError for a scene that cannot.
    """

    def __init__(self, scene: Scene, path: Path, joints: Sequence[str]) -> None:
        if scene.period <= 0.0:
            raise SceneError("period = 0.0: must be > 0 s for a plant, which creates the stamps")
        if scene.wrench.hold == "body":
            raise SceneError(
                "wrench.hold = 'body': must be world; MuJoCo holds a wrench in world axes"
            )
        self.scene, self.mujoco = scene, mujoco_module()
        spec = load_spec(path)
        reference = compile_spec(spec, path)
        data = self.mujoco.MjData(reference)
        self.mujoco.mj_forward(reference, data)
        pair = find_pair(reference, data, joints)
        names = [reference.joint(joint).name for joint in pair.joints]
        if reference.body(pair.body_b).name != scene.body_b.frame:
            raise SceneError(
                f"body_b.frame = {scene.body_b.frame!r}: must be the body of joint "
                f"{' and '.join(names)}, {reference.body(pair.body_b).name}"
            )
        if scene.constraint == "connector":
            self.model = compile_spec(
                _floating(self.mujoco, path, scene.body_b.frame, pair, data), path
            )
        else:
            self.model = reference
            self._strip(names)
        self.model.opt.gravity[:] = scene.gravity
        substeps = max(1, round(scene.period / self.model.opt.timestep))
        self._substeps = substeps
        self.model.opt.timestep = scene.period / substeps
        self.data = self.mujoco.MjData(self.model)
        self._bodies = [self._body(scene.body_a.frame), self._body(scene.body_b.frame)]
        self.par = np.zeros(0)
        self.period_ns, self.steps = round(scene.period * 1e9), 0
        self.over_time = OverTime(scene)
        self.loads = self.over_time.loads(0)
        self.state = np.zeros(26)
        self._read()

    def _strip(self, names: Sequence[str]) -> None:
        """Leave the joint without what the connector sends."""
        for name in names:
            joint = self.model.joint(name).id
            dof = self.model.jnt_dofadr[joint]
            self.model.dof_frictionloss[dof] = self.model.dof_damping[dof] = 0.0
            self.model.jnt_stiffness[joint] = 0.0
            self.model.jnt_limited[joint] = 0

    def _body(self, name: str) -> int | None:
        found = self.mujoco.mj_name2id(self.model, self.mujoco.mjtObj.mjOBJ_BODY, name)
        return None if found < 0 else int(found)

    @property
    def time_ns(self) -> int:
        """Simulated time, ns."""
        return self.steps * self.period_ns

    def command(self, efforts: dict[str, float]) -> list[str]:
        """Set actuators by their name or their joint's name; returns names that are not known."""
        unknown = []
        actuators = {self.model.actuator(i).name: i for i in range(self.model.nu)}
        for i in range(self.model.nu):
            if int(self.model.actuator_trntype[i]) == int(self.mujoco.mjtTrn.mjTRN_JOINT):
                actuators.setdefault(self.model.joint(self.model.actuator_trnid[i, 0]).name, i)
        for name, value in efforts.items():
            if name in actuators and np.isfinite(value):
                self.data.ctrl[actuators[name]] = value
            else:
                unknown.append(name)
        return unknown

    def step(self, wrench_a: Array, wrench_b: Array) -> None:
        """Advance one period under wrenches as published: (6,) force, torque each."""
        for k, wrench in enumerate((wrench_a, wrench_b)):
            body = self._bodies[k]
            if body is not None and self.model.body_weldid[body] != 0:
                load = self.loads[6 * k : 6 * k + 6]
                self.data.xfrc_applied[body] = self._about_com(k, body, wrench) + self._moved(
                    body, load[:3], load[3:]
                )
        self.mujoco.mj_step(self.model, self.data, self._substeps)
        self.steps += 1
        self.loads[:] = self.over_time.loads(self.steps)
        self._read()

    def _about_com(self, k: int, body: int, wrench: Array) -> Array:
        """A published wrench in world axes about the body's mass centre in MuJoCo (xipos)."""
        force, torque = wrench[:3], wrench[3:]
        rotation = self.data.xmat[body].reshape(3, 3)
        if self.scene.wrench.axes == "body":
            force, torque = rotation @ force, rotation @ torque
        if self.scene.wrench.point == "com":
            at = self.data.xpos[body] + rotation @ np.array(self.scene.bodies[k].com)
            torque = torque + np.cross(at - self.data.xpos[body], force)
        return self._moved(body, force, torque)

    def _moved(self, body: int, force: Array, torque: Array) -> Array:
        """Force and torque about the body frame's origin, as about its mass centre."""
        arm = self.data.xpos[body] - self.data.xipos[body]
        return np.concatenate([force, torque + np.cross(arm, force)])

    def _read(self) -> None:
        """State at the present positions and velocities."""
        self.mujoco.mj_kinematics(self.model, self.data)
        self.mujoco.mj_comPos(self.model, self.data)
        self.mujoco.mj_comVel(self.model, self.data)
        velocity = np.zeros(6)
        for k, body in enumerate(self._bodies):
            at = 13 * k
            if body is None or self.model.body_weldid[body] == 0:
                self.state[at : at + 7] = self.scene.bodies[k].pose
                continue
            w, x, y, z = self.data.xquat[body]
            self.state[at : at + 7] = *self.data.xpos[body], x, y, z, w
            kind = self.mujoco.mjtObj.mjOBJ_XBODY
            self.mujoco.mj_objectVelocity(self.model, self.data, kind, body, velocity, 0)
            self.state[at + 7 : at + 10], self.state[at + 10 : at + 13] = velocity[3:], velocity[:3]


def _floating(mujoco: Any, path: Path, name: str, pair: Any, data: Any) -> Any:
    """A copy of the model in which the body floats, at its place in the reference configuration."""
    if pair.between is not None:
        raise ModelError(
            f"{path}: the joints are of two bodies; constraint connector needs both on one body"
        )
    spec = load_spec(path)
    body = spec.body(name)
    for joint in list(body.joints):
        spec.delete(joint)
    for actuator in list(spec.actuators):
        if actuator.target not in [joint.name for joint in spec.joints]:
            spec.delete(actuator)
    if body.parent != spec.worldbody:
        source = spec.copy()
        spec.delete(body)
        frame = spec.worldbody.add_frame(pos=data.body(name).xpos, quat=data.body(name).xquat)
        part = source.body(name)
        part.pos, part.quat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
        frame.attach_body(part, "", "")
        body = spec.body(name)
    body.add_freejoint()
    for key in list(spec.keys):
        spec.delete(key)
    return spec
