"""What MuJoCo's step answers to forces on a joint, with contacts and other constraints active.

For any force (f1, m1) the constraint solver and the integrator are run as mj_step would, without
advancing. Rates at the end of the step and reactions are linear in the force while the set of
active constraints is the same; the matrix is taken from three such runs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import ModelError
from cylconn_ros.mechanism import step
from cylconn_ros.mujoco import joint_equations as equations
from cylconn_ros.mujoco.joint_of_model import Joint

Array = NDArray[np.float64]


class Response:
    """Runs of one step of a model for forces on the joint, from the present state of ``data``.

    Attributes
    ----------
        numbers: (NSTEP,) place and rates of the joint are written by :meth:`of`.

    Raises ModelError for the integrator RK4, and for sleeping bodies.
    """

    def __init__(self, mujoco: Any, model: Any, data: Any, joint: Joint) -> None:
        self._mujoco, self._model, self._data = mujoco, model, data
        self._index, self._geometry = joint.index, joint.geometry
        self.numbers = np.zeros(step.NSTEP)
        self._dofs = joint.index[equations.DOFS : equations.DOFS + 2]
        self._present = [k for k in range(2) if self._dofs[k] >= 0]
        self._acceleration = np.zeros(model.nv)
        self._work = np.zeros(max(len(np.ravel(getattr(data, "M", ()))), 1))
        kinds = mujoco.mjtIntegrator
        if model.opt.integrator == kinds.mjINT_RK4:
            raise ModelError(
                "option integrator = RK4: evaluates the forces four times a step, while friction "
                "is solved for the whole step; set model.opt.integrator to "
                "mujoco.mjtIntegrator.mjINT_IMPLICITFAST or mjINT_EULER"
            )
        if model.opt.enableflags & getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0):
            raise ModelError(
                "option flag sleep = enable: forces of bodies asleep are not computed; disable it"
            )
        self._discrete = model.opt.integrator == getattr(kinds, "mjINT_DISCRETE", -1)
        self._euler = model.opt.integrator == kinds.mjINT_EULER
        self._state = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._kept = np.zeros(mujoco.mj_stateSize(model, self._state))

    @property
    def is_linear(self) -> bool:
        """Whether the effective mass matrix is M + h D: Euler, and a damping that is constant."""
        poly = getattr(self._model, "dof_dampingpoly", None)
        return self._euler and hasattr(self._data, "M") and (poly is None or not np.any(poly))

    @property
    def damping(self) -> Array:
        """(nv,) the damping that the Euler integrator takes implicitly."""
        disabled = self._mujoco.mjtDisableBit
        off = disabled.mjDSBL_EULERDAMP | getattr(disabled, "mjDSBL_DAMPER", 0)
        if self._model.opt.disableflags & off:
            return np.zeros(self._model.nv)
        return self._model.dof_damping

    def _accelerate(self) -> Array:
        """(nv,) (v+ - v)/h of the step, after mj_fwdConstraint."""
        model, data, h = self._model, self._data, self._model.opt.timestep
        if self._discrete:
            return np.array(data.qacc)
        if self.is_linear:
            equations.accelerate(
                self._work, data.qfrc_smooth + data.qfrc_constraint, data.M, self.damping, h,
                model.M_rowadr, model.M_rownnz, model.M_colind, self._acceleration,
            )  # fmt: skip
            return self._acceleration
        mujoco, velocity = self._mujoco, np.array(data.qvel)
        mujoco.mj_getState(model, data, self._kept, self._state)
        (mujoco.mj_Euler if self._euler else mujoco.mj_implicit)(model, data)
        self._acceleration[:] = (data.qvel - velocity) / h
        mujoco.mj_setState(model, data, self._kept, self._state)
        return self._acceleration

    def of(self, applied: Array, force: Array) -> Array:
        """(6,) rates of slide and spin at the end, and f2, f3, m2, m3, for a force (f1, m1).

        applied: (nv,) qfrc_applied without it; is left with it.
        """
        model, data = self._model, self._data
        data.qfrc_applied[:] = applied
        for k in self._present:
            data.qfrc_applied[self._dofs[k]] += force[k]
        self._mujoco.mj_fwdAcceleration(model, data)
        self._mujoco.mj_fwdConstraint(model, data)
        data.qacc[:] = acceleration = self._accelerate()
        self._mujoco.mj_rnePostConstraint(model, data)
        found = np.zeros(6)
        equations.write_response(
            self.numbers, self._index, self._geometry, found, data.xpos.ravel(),
            data.xmat.ravel(), data.subtree_com.ravel(), data.qpos, data.qvel,
            data.cfrc_int.ravel(), 2,
        )  # fmt: skip
        h = model.opt.timestep
        for k in self._present:
            dof = self._dofs[k]
            found[k] = data.qvel[dof] + h * acceleration[dof]
        return found

    def active(self) -> bytes:
        """The states of all constraints in the last run."""
        return bytes(self._data.efc_state)

    def matrix(self, applied: Array, force: Array, at: Array, share: float) -> Array:
        """(6, 2) change of :meth:`of` by the force, by differences from ``at`` = of(force)."""
        found = np.zeros((6, 2))
        reach = share * (1.0 + float(np.abs(force).max()))
        for k in self._present:
            moved = np.array(force)
            moved[k] += reach
            found[:, k] = (self.of(applied, moved) - at) / reach
        return found
