"""Joints of a MuJoCo model that a connector can stand for, and the bodies on both sides."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import ModelError
from cylconn_ros.importing.model_file import mujoco_module

Array = NDArray[np.float64]

_ANGLE = 1e-6  # rad between the axes of a pair
_DISTANCE = 1e-6  # m between them


@dataclasses.dataclass(frozen=True)
class Lump:
    """Bodies welded together, as one: mass centre and inertia about it, in the frame of ``body``.

    inertia: ixx, ixy, ixz, iyy, iyz, izz in kg m^2.
    """

    body: int
    members: tuple[int, ...]
    mass: float
    com: Array
    inertia: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class Pair:
    """A slide, a hinge, or both on one axis, between body A (the parent's side) and body B.

    anchor, axis: a point of the axis and its direction in the world, at the model's reference
    configuration.
    """

    slide: int | None
    hinge: int | None
    body_a: int
    body_b: int
    between: int | None  # the link between two joints of a chain
    anchor: Array
    axis: Array

    @property
    def joints(self) -> list[int]:
        """Indices of the joints."""
        return [joint for joint in (self.slide, self.hinge) if joint is not None]


def joint_names(model: Any) -> list[str]:
    """Names of the model's joints."""
    return [model.joint(i).name or f"#{i}" for i in range(model.njnt)]


def find_pair(model: Any, data: Any, names: Sequence[str]) -> Pair:
    """The pair that one or two joint names mean; ``data``: after mj_forward at qpos0.

    One name: the joint, and the other one of its body on the same axis. Raises ModelError for an
    unknown name, another kind of joint, axes that differ, or bodies that cannot move.
    """
    kinds = mujoco_module().mjtJoint
    slide, hinge = int(kinds.mjJNT_SLIDE), int(kinds.mjJNT_HINGE)
    kind_of = [int(kind) for kind in model.jnt_type]
    known = joint_names(model)
    found = []
    for name in names:
        if name not in known:
            raise ModelError(f"joint {name}: not in the model; it has {_listed(known)}")
        found.append(known.index(name))
    for joint in found:
        if kind_of[joint] not in (slide, hinge):
            word = "a free joint" if kind_of[joint] == int(kinds.mjJNT_FREE) else "a ball joint"
            raise ModelError(
                f"joint {known[joint]}: is {word}; must be a slide, a hinge, or both on one axis"
            )
    if len(found) == 1:
        body = model.jnt_bodyid[found[0]]
        for other in range(model.njnt):
            both = {kind_of[found[0]], kind_of[other]}
            if other != found[0] and model.jnt_bodyid[other] == body and \
                    both == {slide, hinge} and \
                    _coaxial(data, found[0], other):  # fmt: skip
                found.append(other)
                break
    if len(found) > 2:
        raise ModelError(f"joints {', '.join(names)}: one or two joints make a connector")
    slides = [j for j in found if kind_of[j] == slide]
    hinges = [j for j in found if kind_of[j] == hinge]
    if len(slides) > 1 or len(hinges) > 1:
        raise ModelError(f"joints {', '.join(names)}: must be one slide and one hinge")
    return _checked(model, data, slides, hinges, known)


def _checked(model: Any, data: Any, slides: list[int], hinges: list[int], known: list[str]) -> Pair:
    found = [*slides, *hinges]
    bodies = sorted({int(model.jnt_bodyid[joint]) for joint in found})
    if len(found) == 2 and not _coaxial(data, *found):
        raise ModelError(
            f"joints {known[found[0]]} and {known[found[1]]}: are not on one axis "
            f"(axes {_vector(data.xaxis[found[0]])} and {_vector(data.xaxis[found[1]])}, points "
            f"{_vector(data.xanchor[found[0]])} and {_vector(data.xanchor[found[1]])} in the world)"
        )
    between = None
    if len(bodies) == 2:
        between = bodies[0]
        if model.body_parentid[bodies[1]] != between:
            raise ModelError(
                f"joints {known[found[0]]} and {known[found[1]]}: are not of one body, nor of a "
                "body and its child"
            )
    body = bodies[-1]
    carried = [j for j in range(model.njnt) if model.jnt_bodyid[j] in bodies and j not in found]
    if carried:
        raise ModelError(
            f"joint {known[found[0]]}: body {model.body(body).name} has also the joint "
            f"{_listed([known[j] for j in carried])}; the connector is the only joint of its body"
        )
    parent = int(model.body_parentid[bodies[0]])
    if len(found) == 2 and data.xaxis[found[0]] @ data.xaxis[found[1]] < 0.0:
        raise ModelError(
            f"joints {known[found[0]]} and {known[found[1]]}: their axes are opposite; turn one"
        )
    anchor = data.xanchor[(hinges or slides)[0]].copy()
    return Pair(
        slides[0] if slides else None, hinges[0] if hinges else None, parent, body, between,
        anchor, data.xaxis[found[0]].copy(),
    )  # fmt: skip


def _coaxial(data: Any, one: int, two: int) -> bool:
    """Whether two joints have one axis; the point of a slide does not matter if it is alone."""
    across = np.cross(data.xaxis[one], data.xaxis[two])
    away = data.xanchor[two] - data.xanchor[one]
    off = np.linalg.norm(away - (away @ data.xaxis[one]) * data.xaxis[one])
    return bool(np.linalg.norm(across) < _ANGLE and off < _DISTANCE)


def lump(model: Any, data: Any, body: int, also: Sequence[int] = ()) -> Lump:
    """``body`` and all bodies welded to it (and ``also``), as one rigid body."""
    weld = model.body_weldid[body]
    members = [i for i in range(1, model.nbody) if model.body_weldid[i] == weld and weld != 0]
    members += list(also)
    mass = float(sum(model.body_mass[i] for i in members))
    rotation = data.xmat[body].reshape(3, 3)
    if mass <= 0.0:
        return Lump(body, tuple(members), 0.0, np.zeros(3), ())
    com = sum((model.body_mass[i] * data.xipos[i] for i in members), np.zeros(3)) / mass
    total = np.zeros((3, 3))
    for i in members:
        axes = data.ximat[i].reshape(3, 3)
        r = data.xipos[i] - com
        total += axes @ np.diag(model.body_inertia[i]) @ axes.T
        total += model.body_mass[i] * ((r @ r) * np.eye(3) - np.outer(r, r))
    local = rotation.T @ total @ rotation
    upper = tuple(float(local[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    return Lump(body, tuple(members), mass, rotation.T @ (com - data.xpos[body]), upper)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 20} more" if len(names) > 20 else ""
    return (", ".join(names[:20]) or "none") + more


def _vector(x: Array) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in x) + "]"
