"""A joint of an MJCF or URDF model as a scene."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.errors import ModelError
from cylconn_ros.importing import safe_xml
from cylconn_ros.importing.joints import Array, Lump, Pair, find_pair, lump
from cylconn_ros.importing.model_file import compile_spec, load_spec, mujoco_module
from cylconn_ros.importing.scene_text import Draft


def draft_of(path: Path, joints: Sequence[str]) -> Draft:
    """The scene of a joint, or of a coaxial pair. Raises ModelError."""
    repaired: dict[str, str] = {}
    model = compile_spec(load_spec(path, shapes=False, repaired=repaired), path)
    try:
        draft = draft_of_model(model, joints, path.name, repaired)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    _list_urdf(draft, safe_xml.read(path), joints)
    return draft


def draft_of_model(
    model: Any, joints: Sequence[str], source: str, repaired: Mapping[str, str] | None = None
) -> Draft:
    """The scene of a joint of a compiled model, in its reference configuration.

    ``repaired``: bodies whose inertia is not that of the file, with the reason.
    """
    mujoco = mujoco_module()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pair = find_pair(model, data, joints)
    names = [model.joint(j).name for j in pair.joints]
    draft = Draft(f"{source}, joint {' and '.join(names)}")
    draft.put("period", model.opt.timestep)
    if int(model.opt.integrator) != int(mujoco.mjtIntegrator.mjINT_RK4):
        draft.put("plant_integration", "semi_implicit", "Of the model's integrator: x += h v+.")
    draft.put("gravity", model.opt.gravity)
    _put_bodies(draft, model, data, pair, repaired or {})
    _put_nodes(draft, model, data, pair)
    _put_free_axes(draft, model, pair)
    _put_friction(draft, model, pair)
    _list_rest(draft, model, pair)
    return draft


def _put_bodies(
    draft: Draft, model: Any, data: Any, pair: Pair, repaired: Mapping[str, str]
) -> None:
    _check_inertias(model, data, pair, repaired)
    moving = lump(model, data, pair.body_b, [] if pair.between is None else [pair.between])
    name = model.body(pair.body_b).name
    if moving.mass <= 0.0 or min(np.linalg.eigvalsh(_tensor(moving))) <= 0.0:
        raise ModelError(
            f"body {name}: has no mass or no inertia; a URDF link needs an inertial element"
        )
    root = pair.body_a
    if model.body_weldid[root] == 0:
        kind, comment = "fixed", "welded to the world"
    elif _floats(model, root):
        kind, comment = "free", ""
    else:
        kind = "driven"
        comment = "Part of a mechanism: what it does is measured, the forces of the connector do "
        comment += "not move it in the connector's equations."
    frames = [_frame(model, root, "body_a"), _frame(model, pair.body_b, "body_b")]
    draft.put("body_a.frame", frames[0])
    draft.put("body_a.kind", kind, comment)
    draft.put("body_a.pose", _pose(data, root))
    if kind == "free":
        _put_lump(draft, model, "body_a", lump(model, data, root))
    draft.put("body_b.frame", frames[1])
    draft.put("body_b.kind", "free")
    draft.put("body_b.pose", _pose(data, pair.body_b))
    _put_lump(draft, model, "body_b", moving)
    if pair.between is not None:
        draft.comments["body_b"] = (
            f"Includes the link {model.body(pair.between).name} between the two joints "
            f"({model.body_mass[pair.between]:g} kg), as if it turned with the body."
        )
    beyond = [i for i in range(1, model.nbody)
              if i not in moving.members and _is_below(model, i, pair.body_b)]  # fmt: skip
    if beyond:
        mass = sum(float(model.body_mass[i]) for i in beyond)
        draft.left_out.append(
            f"{len(beyond)} bodies on further joints of {name} ({mass:.6g} kg: "
            f"{', '.join(model.body(i).name for i in beyond[:10])}); send their effect as a load"
        )


def _check_inertias(model: Any, data: Any, pair: Pair, repaired: Mapping[str, str]) -> None:
    """Refuse a body of the connector whose inertia is not that of the file."""
    members = lump(model, data, pair.body_b, [] if pair.between is None else [pair.between]).members
    if _floats(model, pair.body_a):
        members += lump(model, data, pair.body_a).members
    for name in (model.body(i).name for i in members):
        if name in repaired:
            raise ModelError(f"link {name}: {repaired[name]}")


def _put_lump(draft: Draft, model: Any, group: str, one: Lump) -> None:
    if len(one.members) > 1:
        named = ", ".join(model.body(i).name or f"#{i}" for i in one.members)
        draft.comments[f"{group}.mass"] = f"Of the bodies that are welded together: {named}."
    draft.put(f"{group}.mass", one.mass)
    draft.put(f"{group}.com", one.com)
    draft.put(f"{group}.inertia", one.inertia)


def _put_nodes(draft: Draft, model: Any, data: Any, pair: Pair) -> None:
    """Both nodes at the joint's anchor; e1 is the joint's axis."""
    e1 = pair.axis / np.linalg.norm(pair.axis)
    helper = np.eye(3)[int(np.argmin(np.abs(e1)))]
    e2 = np.cross(helper, e1)
    e2 /= np.linalg.norm(e2)
    axes = np.column_stack([e1, e2, np.cross(e1, e2)])
    for group, body in (("node_a", pair.body_a), ("node_b", pair.body_b)):
        rotation = data.xmat[body].reshape(3, 3)
        draft.put(f"{group}.position", rotation.T @ (pair.anchor - data.xpos[body]))
        draft.put(f"{group}.orientation", _quaternion(rotation.T @ axes))
    draft.comments["node_a"] = "The first axis is the axis of the joint."
    draft.comments["node_b"] = "Belongs at the centre of the sleeve: friction's bending moment is "
    draft.comments["node_b"] += "about this point. The model says where the joint is, not where "
    draft.comments["node_b"] += "the bearing is."
    draft.put("reference.offsets", "zero")
    draft.put("reference.misalignment", "zero")


def _put_free_axes(draft: Draft, model: Any, pair: Pair) -> None:
    """Limits, springs and damping. The connector's length and angle are 0 at qpos0."""
    sides = (
        (pair.slide, "slide", "l", "elasticity.k1", "damping.c1", "length", "m"),
        (pair.hinge, "spin", "theta", "elasticity.kr1", "damping.cr1", "angle", "rad"),
    )
    for joint, axis, bound, spring, damper, reference, unit in sides:
        if joint is None:
            draft.put(f"command.{axis}.position", 0.0,
                      f"The model has no joint for the {axis}: it is held. Remove this for a "
                      "cylindrical joint.")  # fmt: skip
            continue
        name, at, dof = model.joint(joint).name, model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        zero = float(model.qpos0[at])
        if model.jnt_limited[joint]:
            low, high = model.jnt_range[joint]
            draft.comments["stops"] = f"Range of the joint, from its reference ({unit})."
            draft.put(f"stops.{bound}_min", low - zero)
            draft.put(f"stops.{bound}_max", high - zero)
        stiffness = float(np.ravel(model.jnt_stiffness[joint])[0])
        if stiffness > 0.0:
            draft.put(spring, stiffness)
            rest = float(model.qpos_spring[at]) - zero
            low, high = (draft.values.get(f"stops.{bound}_{end}") for end in ("min", "max"))
            if (low is not None and rest < low) or (high is not None and rest > high):
                draft.left_out.append(
                    f"{name}: the spring's rest at {rest:g} {unit} is beyond a stop; "
                    f"reference.{reference} is left at the reference configuration"
                )
            else:
                draft.put(f"reference.{reference}", rest)
        damping = float(np.ravel(model.dof_damping[dof])[0])
        if damping > 0.0:
            draft.put(damper, damping)
        if model.dof_armature[dof] > 0.0:
            draft.left_out.append(f"{name}: armature {model.dof_armature[dof]:g}")
        if model.jnt_actfrclimited[joint]:
            low, high = model.jnt_actfrcrange[joint]
            force = "N" if axis == "slide" else "N m"
            draft.left_out.append(
                f"{name}: effort limit {min(-low, high):g} {force}: it is of the joint's drive; "
                f"with a motion in command.{axis} it is command.{axis}.max_force"
            )


def _put_friction(draft: Draft, model: Any, pair: Pair) -> None:
    losses = []
    for joint in pair.joints:
        loss = float(model.dof_frictionloss[model.jnt_dofadr[joint]])
        if loss > 0.0:
            unit = "N" if joint == pair.slide else "N m"
            losses.append(f"{model.joint(joint).name} {loss:g} {unit}")
    if losses:
        draft.left_out.append(
            f"joint friction independent of the load ({', '.join(losses)}): with a coefficient mu "
            "the same force is a preload of force/mu"
        )
    draft.friction_blanks()


def _list_rest(draft: Draft, model: Any, pair: Pair) -> None:
    mujoco = mujoco_module()
    joints = set(pair.joints)
    for i in range(len(model.actuator_trntype)):
        joint_target = int(model.actuator_trntype[i]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        if joint_target and model.actuator_trnid[i, 0] in joints:
            draft.left_out.append(f"actuator {model.actuator(i).name or i}: send ~/command instead")
    for i in range(model.neq):
        if int(model.eq_type[i]) == int(mujoco.mjtEq.mjEQ_JOINT) and (
            model.eq_obj1id[i] in joints or model.eq_obj2id[i] in joints
        ):
            draft.left_out.append("a constraint between joints (mimic): the joint is independent")
    if np.any(model.geom_contype | model.geom_conaffinity):
        draft.left_out.append(
            "contacts: a scene has none; mujoco_plant sends their force as a load"
        )


def _list_urdf(draft: Draft, root: ElementTree.Element, names: Sequence[str]) -> None:
    """List what a URDF says of its joints and MuJoCo does not read."""
    for joint in root.iter("joint"):
        if root.tag != "robot" or joint.get("name") not in names:
            continue
        name, axis = joint.get("name"), "slide" if joint.get("type") == "prismatic" else "spin"
        limit = joint.find("limit")
        speed = None if limit is None else limit.get("velocity")
        if speed is not None:
            unit = "m/s" if axis == "slide" else "rad/s"
            draft.left_out.append(
                f"{name}: velocity limit {speed} {unit}: it is of the joint's drive; with a motion "
                f"in command.{axis} it is command.{axis}.approach_speed"
            )
        for tag in ("safety_controller", "calibration"):
            if joint.find(tag) is not None:
                draft.left_out.append(f"{name}: {tag}")


def _frame(model: Any, body: int, otherwise: str) -> str:
    name = model.body(body).name
    return otherwise if name in ("", "world") else name


def _floats(model: Any, body: int) -> bool:
    root = model.body_weldid[body]
    free = int(mujoco_module().mjtJoint.mjJNT_FREE)
    first = model.body_jntadr[root]
    return bool(model.body_jntnum[root] == 1 and int(model.jnt_type[first]) == free)


def _is_below(model: Any, body: int, ancestor: int) -> bool:
    while body:
        if body == ancestor:
            return True
        body = int(model.body_parentid[body])
    return False


def _pose(data: Any, body: int) -> Array:
    w, x, y, z = data.xquat[body]
    return np.array([*data.xpos[body], x, y, z, w])


def _quaternion(rotation: Array) -> Array:
    quaternion = np.zeros(4)
    mujoco_module().mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return np.roll(quaternion, -1)


def _tensor(one: Lump) -> Array:
    xx, xy, xz, yy, yz, zz = one.inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
