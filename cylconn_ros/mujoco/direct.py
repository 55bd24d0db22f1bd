"""The second half of a step as one compiled call that calls MuJoCo's C functions by their address.

Each call of MuJoCo from Python and each array that compiled code gets from Python takes 50 to
250 ns, together as long as ``mj_step`` of ten joints. Here compiled code gets one array of
addresses: of the C functions in the library that the package mujoco has loaded, of mjModel and
mjData, and of their arrays and ours, which stay where they are.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from cylconn_ros.core import jit
from cylconn_ros.core.jit import call, kernel
from cylconn_ros.mujoco import joint_equations as equations

MODEL: Final = 0
DATA: Final = 1
FUNCTIONS: Final = 2  # 4: mj_fwdActuation, mj_fwdAcceleration, mj_rnePostConstraint, mj_step2
WEIGHTLESS: Final = 6  # the flag mjDSBL_GRAVITY
ARRAYS: Final = 7  # address and length of each
_NAMES = ("mj_fwdActuation", "mj_fwdAcceleration", "mj_rnePostConstraint", "mj_step2")

if jit.COMPILED:
    from numba import types
    from numba.extending import intrinsic
    from numba.np.arrayobj import populate_array

    def _array_at(kind: Any) -> Any:
        """A function of the addresses and a number k: the k-th array, of float64 or int64."""

        @intrinsic
        def array_at(_context: Any, addresses: Any, number: Any) -> tuple[Any, Any]:
            def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                c = context.make_array(signature.args[0])(context, builder, values[0])
                at = builder.add(builder.mul(values[1], values[1].type(2)), values[1].type(ARRAYS))
                address = builder.load(builder.gep(c.data, [at]))
                size = builder.load(builder.gep(c.data, [builder.add(at, at.type(1))]))
                made = context.make_array(signature.return_type)(context, builder)
                width = context.get_constant(types.intp, 8)
                pointer = context.get_data_type(kind).as_pointer()
                populate_array(
                    made, data=builder.inttoptr(address, pointer), shape=[size], strides=[width],
                    itemsize=width, meminfo=None,
                )  # fmt: skip
                return made._getvalue()

            return types.Array(kind, 1, "C")(addresses, types.int64), generate

        return array_at

    _f, _i = _array_at(types.float64), _array_at(types.int64)
else:
    _f = _i = None


def arrays_of(model: Any, data: Any, subtree: int, arguments: Sequence[Any]) -> list[Any]:
    """The arrays that :func:`finish` reads: those of ``solve_unconstrained`` in order, and more.

    ``subtree``: the first body that the joint moves.
    """
    bodies, other = {subtree}, int(model.body_parentid[subtree])
    while other > 0:
        bodies.add(other)
        other = int(model.body_parentid[other])
    for body in range(subtree + 1, model.nbody):
        parent = int(model.body_parentid[body])
        if parent in bodies and parent >= subtree:
            bodies.add(body)
    more = [
        np.zeros(model.nv), np.zeros(6 * model.nbody), data.qfrc_passive, data.qfrc_bias,
        data.qfrc_actuator, data.xfrc_applied.reshape(-1), np.array(sorted(bodies), np.int64),
        model.body_parentid, model.body_dofadr, model.body_dofnum, model.opt.gravity,
        data.cinert.reshape(-1), data.cvel.reshape(-1), data.cdof_dot.reshape(-1),
        np.zeros(6 * model.nbody),
    ]  # fmt: skip
    both = (*arguments, *more)
    return [np.asarray(a, np.int64) if a.dtype == np.int32 else a for a in both]


def addresses(mujoco: Any, model: Any, data: Any, arrays: Sequence[Any]) -> Any:
    """The (n,) int64 addresses for :func:`finish`, or None if it cannot be used.

    It needs the compiler, the loaded library, and a model without user-defined actuators and
    sensors, whose callbacks may raise exceptions. ``arrays``: of :func:`arrays_of`, float64 or
    int64; they must outlive the addresses.
    """
    if not jit.COMPILED or not hasattr(data, "_address") or _has_callbacks(mujoco, model):
        return None
    functions = _functions(Path(mujoco.__file__).parent)
    fits = all(a.dtype in (np.float64, np.int64) and a.flags.c_contiguous for a in arrays)
    if functions is None or not fits:
        return None
    weightless = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    found = [model._address, data._address, *functions, weightless]
    for array in arrays:
        found += [array.ctypes.data, array.size]
    return np.array(found, dtype=np.int64)


def _functions(package: Path) -> list[int] | None:
    """Addresses of the C functions in the library of the package, which is loaded already."""
    for library in (*package.glob("libmujoco*"), *package.glob("mujoco.dll")):
        try:
            loaded = ctypes.CDLL(str(library), mode=getattr(os, "RTLD_NOLOAD", 0) | os.RTLD_NOW)
            pointers = [ctypes.cast(getattr(loaded, name), ctypes.c_void_p) for name in _NAMES]
        except (OSError, AttributeError):
            continue
        return [int(pointer.value or 0) for pointer in pointers]
    return None


def _has_callbacks(mujoco: Any, model: Any) -> bool:
    """Whether the model has parts that functions of the user compute."""
    user = (
        (model.actuator_gaintype, mujoco.mjtGain.mjGAIN_USER),
        (model.actuator_biastype, mujoco.mjtBias.mjBIAS_USER),
        (model.actuator_dyntype, mujoco.mjtDyn.mjDYN_USER),
        (model.sensor_type, mujoco.mjtSensor.mjSENS_USER),
    )
    return any(bool(np.any(np.asarray(kinds) == int(kind))) for kinds, kind in user)


@kernel
def smooth_force(
    force: Any, passive: Any, bias: Any, applied: Any, actuator: Any, outside: Any
) -> bool:
    """qfrc_smooth in MuJoCo's order of summation; False if ``outside``, xfrc_applied, acts."""
    for value in outside:
        if value != 0.0:
            return False
    for k in range(len(force)):
        force[k] = passive[k] - bias[k] + applied[k] + actuator[k]
    return True


@kernel
def bias_wrench(
    wrench: Any, subtree: int, bodies: Any, parents: Any, first: Any, count: Any, gravity: Any,
    falls: bool, cinert: Any, cvel: Any, cdof_dot: Any, qvel: Any, work: Any,
) -> None:  # fmt: skip
    """The joint's wrench on its subtree without generalised acceleration, to ``wrench[6 subtree]``.

    Newton and Euler for each body, about the mass centre of the tree: sum I a + v x I v, with
    gravity as an acceleration of the world. The rest is what mj_rnePostConstraint uses.

    Args:
        subtree: first body that the joint moves. bodies: (n,) its ancestors, then the subtree,
            parents first. parents, first, count: mjModel.body_parentid, body_dofadr, body_dofnum.
        falls: whether gravity acts. work: (6 nbody,), accelerations. The rest: mjData, flattened.
    """
    for k in range(6):
        work[k] = -gravity[k - 3] if falls and k >= 3 else 0.0
        wrench[6 * subtree + k] = 0.0
    for body in bodies:
        at = 6 * body
        for k in range(6):
            value = work[6 * parents[body] + k]
            for dof in range(first[body], first[body] + count[body]):
                value += cdof_dot[6 * dof + k] * qvel[dof]
            work[at + k] = value
        if body < subtree:
            continue
        w = (cvel[at], cvel[at + 1], cvel[at + 2])
        v = (cvel[at + 3], cvel[at + 4], cvel[at + 5])
        a = (work[at], work[at + 1], work[at + 2])
        b = (work[at + 3], work[at + 4], work[at + 5])
        (p, q, r), (x, y, z) = equations._momentum(cinert, body, (w, v))
        torque, force = equations._momentum(cinert, body, (a, b))
        to = 6 * subtree
        wrench[to] += torque[0] + w[1] * r - w[2] * q + v[1] * z - v[2] * y
        wrench[to + 1] += torque[1] + w[2] * p - w[0] * r + v[2] * x - v[0] * z
        wrench[to + 2] += torque[2] + w[0] * q - w[1] * p + v[0] * y - v[1] * x
        wrench[to + 3] += force[0] + w[1] * z - w[2] * y
        wrench[to + 4] += force[1] + w[2] * x - w[0] * z
        wrench[to + 5] += force[2] + w[0] * y - w[1] * x


@kernel
def finish(c: Any, h: float, flags: int, advance: bool) -> int:
    """Solve a step without active constraints, after mj_step1; returns the status.

    ``c``: of :func:`addresses`. ``flags``: mjOption.disableflags. ``advance``: end the step by
    mj_step2.
    """
    model, data = c[MODEL], c[DATA]
    call(c[FUNCTIONS], model, data, 0, 0)
    index, qvel = _i(c, 6), _f(c, 16)
    qacc, cfrc = _f(c, 25), _f(c, 26)  # ours: none, and the wrench for none
    if smooth_force(_f(c, 13), _f(c, 27), _f(c, 28), _f(c, 23), _f(c, 29), _f(c, 30)):
        bias_wrench(
            cfrc, index[equations.SUBTREE], _i(c, 31), _i(c, 32), _i(c, 33), _i(c, 34), _f(c, 35),
            flags & c[WEIGHTLESS] == 0, _f(c, 36), _f(c, 37), _f(c, 38), qvel, _f(c, 39),
        )  # fmt: skip
    else:
        call(c[FUNCTIONS + 1], model, data, 0, 0)
        call(c[FUNCTIONS + 2], model, data, 0, 0)
        qacc, cfrc = _f(c, 14), _f(c, 22)
    status = equations.solve_unconstrained(
        _f(c, 0), _f(c, 1), _f(c, 2), _f(c, 3), _f(c, 4), _f(c, 5), h,
        index, _f(c, 7), _i(c, 8), _i(c, 9), _i(c, 10), _f(c, 11),
        _f(c, 12), _f(c, 13), qacc, _f(c, 15), qvel, _f(c, 17),
        _f(c, 18), _f(c, 19), _f(c, 20), _f(c, 21), cfrc, _f(c, 23), _f(c, 24),
    )  # fmt: skip
    if advance:
        call(c[FUNCTIONS + 3], model, data, 0, 0)
    return status
