"""A MuJoCo model in place of the two rigid bodies of the plant."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.errors import ModelError, SceneError
from cylconn_ros.importing.joints import find_pair, lump
from cylconn_ros.importing.model_file import (
    compile_spec,
    control_addresses,
    is_urdf,
    load_spec,
    mujoco_module,
)
from cylconn_ros.mujoco.floating import exclude_contacts, float_body
from cylconn_ros.mujoco.loads import ModelLoads
from cylconn_ros.mujoco.unyielding import bound_unyielding
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
        notes: what of the model is not as in the file.

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
        self.notes: list[str] = []
        spec, reference = _compiled(path, self.notes)
        data = self.mujoco.MjData(reference)
        self.mujoco.mj_forward(reference, data)
        pair = find_pair(reference, data, joints)
        names = [reference.joint(joint).name for joint in pair.joints]
        for body, frame in ((pair.body_a, scene.body_a.frame), (pair.body_b, scene.body_b.frame)):
            if body and not spec.bodies[body].name:  # a body without a name is the one it must be
                spec.bodies[body].name = frame
        if spec.bodies[pair.body_b].name != scene.body_b.frame:
            raise SceneError(
                f"body_b.frame = {scene.body_b.frame!r}: must be the body of joint "
                f"{' and '.join(names)}, {reference.body(pair.body_b).name}"
            )
        if pair.body_a:  # shaft and sleeve overlap where the connector is
            members = lump(reference, data, pair.body_b).members
            exclude_contacts(spec, [spec.bodies[pair.body_a].name],
                             [spec.bodies[i].name for i in members])  # fmt: skip
        if scene.constraint == "connector":
            try:
                gone = float_body(self.mujoco, spec, scene.body_b.frame, pair)
            except ModelError as error:
                raise ModelError(f"{path}: {error}") from None
            self.notes += [f"removed with the joint: {', '.join(gone)}"] if gone else []
        self.model = compile_spec(spec, path)
        if scene.constraint == "simulator":
            self._strip(names)
        bound_unyielding(self.model)
        self.model.opt.gravity[:] = scene.gravity
        substeps = max(1, round(scene.period / self.model.opt.timestep))
        self._substeps = substeps
        self.model.opt.timestep = scene.period / substeps
        self.data = self.mujoco.MjData(self.model)
        self._bodies = [self._body(scene.body_a.frame), self._body(scene.body_b.frame)]
        kept = pair.joints if scene.constraint == "simulator" else []
        self._sources = [self._source(k, kept) for k in range(2)]
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

    def _source(self, k: int, kept: Sequence[int]) -> ModelLoads | None:
        """What else acts on body A (0) or B (1), if the connector computes its motion."""
        body = self._bodies[k]
        if body is None or self.scene.bodies[k].kind != "free":
            return None
        source = ModelLoads(self.mujoco, self.model, body, kept, child=k == 1)
        return source if source.present else None

    @property
    def varying(self) -> list[int]:
        """Bodies on which other parts of the model may act: 0 for A, 1 for B."""
        return [k for k, source in enumerate(self._sources) if source is not None]

    def load(self, k: int) -> Array:
        """Load on body A (0) or B (1) at the present state, (6,) N, N m: constant and measured.

        About the body frame's origin, world axes.
        """
        source, constant = self._sources[k], self.loads[6 * k : 6 * k + 6]
        return constant if source is None else constant + source.read(self.data)

    @property
    def time_ns(self) -> int:
        """Simulated time, ns."""
        return self.steps * self.period_ns

    def command(self, efforts: dict[str, float]) -> list[str]:
        """Set actuators by their name or their joint's name; returns names that are not known."""
        unknown, addresses = [], control_addresses(self.model)
        actuators = {self.model.actuator(i).name: at for i, at in enumerate(addresses)}
        for i, at in enumerate(addresses):
            if int(self.model.actuator_trntype[i]) == int(self.mujoco.mjtTrn.mjTRN_JOINT):
                actuators.setdefault(self.model.joint(self.model.actuator_trnid[i, 0]).name, at)
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

    def along_axis(self, wrench_b: Array) -> dict[str, float]:
        """Relative motion along and about the connector's axis e1, and the wrench on B there.

        length (m), rate (m/s), force (N), angle (rad), spin (rad/s), moment (N m). The moment is
        about the mass centre of B. ``wrench_b``: as published.
        """
        at, turn, fast, spin = [], [], [], []
        for k, node in enumerate((self.scene.node_a, self.scene.node_b)):
            state = self.state[13 * k : 13 * k + 13]
            rotation = _rotation(self.mujoco, state[3:7])
            arm = rotation @ np.array(node.position)
            orientation = node.orientation or self.scene.node_a.orientation
            at.append(state[:3] + arm)
            turn.append(rotation @ _rotation(self.mujoco, orientation))
            fast.append(state[7:10] + np.cross(state[10:13], arm))
            spin.append(state[10:13])
        e1, relative = turn[0][:, 0], turn[0].T @ turn[1]
        body = self._bodies[1]
        wrench = np.zeros(6) if body is None else self._about_com(1, body, wrench_b)
        return {
            "length": float(e1 @ (at[1] - at[0])),
            "rate": float(e1 @ (fast[1] - fast[0])),
            "force": float(e1 @ wrench[:3]),
            "angle": float(np.arctan2(relative[2, 1], relative[1, 1])),
            "spin": float(e1 @ (spin[1] - spin[0])),
            "moment": float(e1 @ wrench[3:]),
        }

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
        """State at the present positions and velocities, and the forces if they are sent."""
        if self.varying:
            self.mujoco.mj_forward(self.model, self.data)
            self.mujoco.mj_rnePostConstraint(self.model, self.data)
        else:
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


def _compiled(path: Path, notes: list[str]) -> tuple[Any, Any]:
    """The file's spec and its compiled model; without shapes if a URDF's cannot be used.

    Formats of meshes that MuJoCo does not read, or files that are not there, change no inertia.
    """
    found: dict[str, str] = {}
    try:
        spec = load_spec(path, repaired=found)
        model = compile_spec(spec, path)
    except ModelError as error:
        if not is_urdf(path):
            raise
        spec = load_spec(path, shapes=False, repaired=found)
        model = compile_spec(spec, path)
        notes.append(f"without shapes and contacts: {error}")
    notes += [f"link {link}: {text}; the nearest possible is used" for link, text in found.items()]
    return spec, model


def _rotation(mujoco: Any, quaternion: Any) -> Array:
    """Rotation matrix of a quaternion x, y, z, w."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.roll(np.asarray(quaternion, float), 1))
    return matrix.reshape(3, 3)
