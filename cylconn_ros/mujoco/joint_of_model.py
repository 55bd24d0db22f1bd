"""A slide, a hinge or both of a compiled MuJoCo model as a connector: geometry, and what it lacks.

Raises ModelError for a joint or a model, SceneError for a scene, that cannot be used.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import ModelError, SceneError
from cylconn_ros.importing.joints import Pair, find_pair
from cylconn_ros.importing.model_file import mujoco_module
from cylconn_ros.mujoco import joint_equations as equations
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

_ANGLE = 1e-6  # rad between the slot and the axis of the joint
_DISTANCE = 1e-6  # m from node b to the axis of a hinge


@dataclasses.dataclass(frozen=True)
class Joint:
    """The joint as arrays of joint_equations.py, and what its reactions leave out."""

    pair: Pair
    index: Any  # (n,) int64
    geometry: Array
    left_out: tuple[str, ...]


def joint_of(model: Any, slide: str | None, hinge: str | None, scene: Scene | None) -> Joint:
    """The joint with these names. ``scene``: with nodes; None: both at the joint's anchor."""
    mujoco = mujoco_module()
    names = [name for name in (slide, hinge) if name is not None]
    if not names:
        raise ModelError("slide and hinge: give the name of a slide joint, of a hinge, or of both")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pair = find_pair(model, data, names)
    for kind, name, found in (("slide", slide, pair.slide), ("hinge", hinge, pair.hinge)):
        if name is not None and (found is None or model.joint(found).name != name):
            other = "hinge" if kind == "slide" else "slide"
            raise ModelError(f"{kind} = {name!r}: is a {other}; give it as {other}={name!r}")
    geometry = _geometry(model, data, pair, scene)
    return Joint(pair, _index(model, pair), geometry, _left_out(mujoco, model, pair))


def _geometry(model: Any, data: Any, pair: Pair, scene: Scene | None) -> Array:
    """The geometry array: nodes and axes in their bodies, from the scene or from the joint."""
    axis = pair.axis / np.linalg.norm(pair.axis)
    a = data.xmat[pair.body_a].reshape(3, 3)
    b = data.xmat[pair.body_b].reshape(3, 3)
    in_a = a.T @ axis
    if scene is None:
        node_a = a.T @ (pair.anchor - data.xpos[pair.body_a])
        node_b = b.T @ (pair.anchor - data.xpos[pair.body_b])
        helper = np.eye(3)[int(np.argmin(np.abs(in_a)))]
        e2 = np.cross(helper, in_a)
        axes = np.array([in_a, e2 / np.linalg.norm(e2), np.cross(in_a, e2 / np.linalg.norm(e2))])
    else:
        node_a, node_b = np.array(scene.node_a.position), np.array(scene.node_b.position)
        axes = _rows(scene.node_a.orientation)
        if np.linalg.norm(np.cross(axes[0], in_a)) > _ANGLE or axes[0] @ in_a < 0.0:
            raise SceneError(
                f"node_a.orientation: its first axis is {_text(axes[0])} in body "
                f"{model.body(pair.body_a).name}; must be the axis of the joint, {_text(in_a)}"
            )
        if pair.hinge is not None:
            away = data.xpos[pair.body_b] + b @ node_b - pair.anchor
            off = float(np.linalg.norm(np.cross(axis, away)))
            if off > _DISTANCE:
                raise SceneError(
                    f"node_b.position: is {off:.3g} m off the axis of the hinge "
                    f"{model.joint(pair.hinge).name}; must be on it, for example "
                    f"{_text(b.T @ (pair.anchor - data.xpos[pair.body_b]))}"
                )
    geometry = np.zeros(equations.NGEOMETRY)
    for k, joint in enumerate((pair.slide, pair.hinge)):
        if joint is not None:
            geometry[equations.ORIGIN + k] = model.qpos0[model.jnt_qposadr[joint]]
    geometry[equations.NODE_A : equations.NODE_A + 3] = node_a
    geometry[equations.NODE_B : equations.NODE_B + 3] = node_b
    geometry[equations.AXES :] = axes.ravel()
    return geometry


def _rows(quaternion: tuple[float, ...]) -> Array:
    """The axes of an orientation x y z w, one a row."""
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
            [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
            [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _index(model: Any, pair: Pair) -> NDArray[np.int64]:
    """The integers that joint_equations.py reads."""
    subtree = pair.between if pair.between is not None else pair.body_b
    dofs, positions = [-1, -1], [-1, -1]
    for k, joint in enumerate((pair.slide, pair.hinge)):
        if joint is not None:
            dofs[k], positions[k] = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
    chain, dof = [], int(model.body_dofadr[subtree] + model.body_dofnum[subtree] - 1)
    while dof >= 0:
        chain.append(dof)
        dof = int(model.dof_parentid[dof])
    below = _below(model, subtree) - {subtree}
    beyond = [d for d in range(model.nv) if int(model.dof_bodyid[d]) in below]
    bodies = [int(model.dof_bodyid[d]) for d in beyond]
    root = int(model.body_rootid[subtree])
    return np.array(
        [model.nv, *dofs, *positions, pair.body_a, pair.body_b, subtree, root]
        + [len(chain), len(beyond), *chain, *beyond, *bodies],
        dtype=np.int64,
    )


def _below(model: Any, body: int) -> set[int]:
    """The body and all that it carries."""
    found = {body}
    for other in range(body + 1, model.nbody):
        if int(model.body_parentid[other]) in found:
            found.add(other)
    return found


def _left_out(mujoco: Any, model: Any, pair: Pair) -> tuple[str, ...]:
    """Forces of the model on body B and what it carries that the reactions do not include."""
    subtree = pair.between if pair.between is not None else pair.body_b
    below = _below(model, subtree)
    found = []
    if model.opt.density > 0.0 or model.opt.viscosity > 0.0:
        found.append("fluid forces (option density, viscosity)")
    lifted = [model.body(i).name for i in sorted(below) if model.body_gravcomp[i] != 0.0]
    if lifted:
        found.append(f"gravity compensation of {', '.join(lifted)}")
    joint = {int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)}
    others = [model.actuator(i).name for i in range(model.nu)
              if int(model.actuator_trntype[i]) not in joint]  # fmt: skip
    if others:
        found.append(f"actuators that act on no joint ({', '.join(others)})")
    if model.ntendon > 0:
        found.append(f"{model.ntendon} tendons")
    return tuple(found)


def check_no_double(model: Any, pair: Pair, scene: Scene) -> None:
    """Raise ModelError if the model and the scene both have the same force on the joint."""
    stops = scene.stops
    for joint, bounds, spring, damper in (
        (pair.slide, (stops.l_min, stops.l_max), scene.elasticity.k1, scene.damping.c1),
        (pair.hinge, (stops.theta_min, stops.theta_max), scene.elasticity.kr1, scene.damping.cr1),
    ):
        if joint is None:
            continue
        dof, name = int(model.jnt_dofadr[joint]), model.joint(joint).name
        for own, given, where in (
            (_first(model.dof_frictionloss[dof]), scene.friction.on, "dof_frictionloss"),
            (_first(model.dof_damping[dof]), damper != 0.0, "dof_damping"),
        ):
            if own > 0.0 and given:
                raise ModelError(
                    f"joint {name}: {where} = {own:g} in the model, and the scene has it too; it "
                    f"would act twice. Set model.{where}[{dof}] = 0"
                )
        stiffness = _first(model.jnt_stiffness[joint])
        if stiffness > 0.0 and spring != 0.0:
            raise ModelError(
                f"joint {name}: jnt_stiffness = {stiffness:g} in the model, and the scene has it "
                f"too; it would act twice. Set model.jnt_stiffness[{joint}] = 0"
            )
        if model.jnt_limited[joint] and not all(map(math.isnan, bounds)):
            raise ModelError(
                f"joint {name}: has a range in the model, and the scene has stops; both would act. "
                f"Set model.jnt_limited[{joint}] = 0"
            )


def _first(value: Any) -> float:
    return float(np.ravel(value)[0])


def _text(a: Array) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in a) + "]"
