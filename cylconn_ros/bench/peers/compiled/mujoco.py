"""The user's loop in compiled code: friction, stops and MuJoCo's own C functions in one call.

The same law as :mod:`cylconn_ros.bench.peers.common`, from arrays of numbers. MuJoCo's functions
are those of the library in its wheel; fields of its model and data are views of arrays that stay
where they are. Nothing of the interpreter runs between the first and the last step.
"""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cylconn_ros.bench.peers.solver import package

REST_SPEED = 1e-9  # m/s: below it, slide and hinge both get the whole limit


def coefficient(law: Any, table: Any, slip: float) -> float:
    """Coulomb.coefficient."""
    n = table.shape[1]
    if n == 0:
        return float(law[0] + (law[1] - law[0]) * math.exp(-law[2] * slip))
    if slip >= table[0, n - 1]:
        return float(table[1, n - 1])
    k = 1
    while table[0, k] < slip:
        k += 1
    share = (slip - table[0, k - 1]) / (table[0, k] - table[0, k - 1])
    return float(table[1, k - 1] + share * (table[1, k] - table[1, k - 1]))


def pressing(law: Any, slide: float, wrench: Any, point: Any, anchor: Any, axis: Any) -> float:
    """Radial force and bending (N) of a wrench: moment, force (6,), at ``point``; about a node.

    All vectors are in the same axes.
    """
    dx, dy, dz = point[0] - anchor[0], point[1] - anchor[1], point[2] - anchor[2]
    fx, fy, fz = wrench[3], wrench[4], wrench[5]
    mx = wrench[0] + dy * fz - dz * fy
    my = wrench[1] + dz * fx - dx * fz
    mz = wrench[2] + dx * fy - dy * fx
    along = fx * axis[0] + fy * axis[1] + fz * axis[2]
    about = mx * axis[0] + my * axis[1] + mz * axis[2]
    radial = math.sqrt(max(fx * fx + fy * fy + fz * fz - along * along, 0.0))
    if law[4] <= 0.0:
        return radial
    bending = math.sqrt(max(mx * mx + my * my + mz * mz - about * about, 0.0))
    return radial + 2.0 / (law[4] + law[5] * slide) * bending


@functools.cache
def mujoco_loop() -> Callable[..., None]:
    """The compiled loop; raises NotInstalledError without numba."""
    numba, mujoco = package("numba"), package("mujoco", "bench")
    step, react = _functions(mujoco, "mj_step", "mj_rnePostConstraint")
    mu_of, pressed_by = numba.njit(coefficient), numba.njit(pressing)

    def loop(
        model: int, data: int, reacts: bool, qpos: Any, qvel: Any, applied: Any, loss: Any,
        reaction: Any, point: Any, anchor: Any, axis: Any, law: Any, table: Any, pressed: float,
        push: Any, preload: Any, stops: Any,
    ) -> None:  # fmt: skip
        at, last = qvel.shape[0] - 2, qpos.shape[0] - 2
        radius = law[3]
        for k in range(push.shape[0]):
            applied[at] = push[k]
            if reacts:
                v, u = qvel[at], radius * qvel[at + 1]
                slip = math.sqrt(v * v + u * u)
                limit = mu_of(law, table, slip) * abs(pressed + preload[k])
                if slip <= REST_SPEED:
                    loss[at], loss[at + 1] = limit, limit * radius
                else:
                    loss[at] = limit * abs(v) / slip
                    loss[at + 1] = limit * radius * abs(u) / slip
            step(model, data)
            if reacts:
                react(model, data)
                pressed = pressed_by(law, qpos[last], reaction, point, anchor, axis)
            if qpos[last] > stops[1] and qvel[at] > 0.0:
                qpos[last], qvel[at] = stops[1], -stops[2] * qvel[at]
            elif qpos[last] < stops[0] and qvel[at] < 0.0:
                qpos[last], qvel[at] = stops[0], -stops[2] * qvel[at]

    compiled: Callable[..., None] = numba.njit(loop)
    return compiled


def _functions(mujoco: Any, *names: str) -> list[Any]:
    """C functions of (model, data) from the library in MuJoCo's wheel."""
    folder = Path(mujoco.__file__).parent
    files = [f for f in folder.iterdir() if f.name.startswith(("libmujoco", "mujoco.dll"))]
    library = ctypes.CDLL(str(files[0]))
    found = []
    for name in names:
        function = getattr(library, name)
        function.argtypes, function.restype = (ctypes.c_ssize_t, ctypes.c_ssize_t), None
        found.append(function)
    return found
