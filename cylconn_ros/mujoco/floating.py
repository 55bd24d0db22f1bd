"""A model in which body B floats: the joint that the connector stands for is removed."""

from __future__ import annotations

from typing import Any

import numpy as np

from cylconn_ros.errors import ModelError


def float_body(mujoco: Any, spec: Any, name: str, pair: Any) -> list[str]:
    """Let the body float in ``spec``, at its place in the reference configuration.

    Below another body it gets three slides and a ball joint, since only a body of the world may
    have a free joint. It stays where it is in the tree: names, equalities and excluded contacts
    remain what they are. Returns what went with the joint: parts that name it, and keyframes.
    """
    if pair.between is not None:
        raise ModelError(
            "the joints are of two bodies; constraint connector needs both on one body"
        )
    body = spec.body(name)
    gone = _naming(mujoco, spec, {joint.name for joint in body.joints})
    named = [f"{word} {part.name}".strip() for word, part in gone]
    for _, part in [*gone, *(("", key) for key in spec.keys)]:
        spec.delete(part)
    for joint in list(body.joints):
        spec.delete(joint)
    if body.parent == spec.worldbody:
        body.add_freejoint()
        return named
    kinds = mujoco.mjtJoint
    added = [body.add_joint(type=kinds.mjJNT_SLIDE, axis=axis) for axis in np.eye(3)]
    for joint in (*added, body.add_joint(type=kinds.mjJNT_BALL)):
        joint.limited = joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        for name in ("stiffness", "damping", "armature", "frictionloss"):  # of the default class
            setattr(joint, name, 0.0 * np.asarray(getattr(joint, name)))
    return named


def _naming(mujoco: Any, spec: Any, joints: set[str]) -> list[tuple[str, Any]]:
    """Tendons, equalities, actuators and sensors that name a joint, with what they are."""
    equal, through, of = mujoco.mjtEq, mujoco.mjtTrn, mujoco.mjtObj
    found = [("tendon", part) for part in spec.tendons if _wraps(part) & joints]
    tendons = {part.name for _, part in found}
    for part in spec.equalities:
        lost = {equal.mjEQ_JOINT: joints, equal.mjEQ_TENDON: tendons}.get(part.type, set())
        if lost & {part.name1, part.name2}:
            found.append(("equality", part))
    of_joints = (through.mjTRN_JOINT, through.mjTRN_JOINTINPARENT)
    actuators = set()
    for part in spec.actuators:
        lost = joints if part.trntype in of_joints else set()
        if part.target in (tendons if part.trntype == through.mjTRN_TENDON else lost):
            actuators.add(part.name)
            found.append(("actuator", part))
    lost_by_kind = {
        of.mjOBJ_JOINT: joints, of.mjOBJ_TENDON: tendons, of.mjOBJ_ACTUATOR: actuators
    }  # fmt: skip
    for part in spec.sensors:
        if part.objname in lost_by_kind.get(part.objtype, set()):
            found.append(("sensor", part))
    return found


def _wraps(tendon: Any) -> set[str]:
    """Names of the joints of a tendon."""
    return {getattr(wrap.target, "name", wrap.target) for wrap in getattr(tendon, "path", ())}


def exclude_contacts(spec: Any, one: list[str], other: list[str]) -> None:
    """Let bodies pass through each other; names of two groups, the unnamed are left out."""
    for first in filter(None, one):
        for second in filter(None, other):
            spec.add_exclude(bodyname1=first, bodyname2=second)
