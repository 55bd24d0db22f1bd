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
        damping: (nv,) D, if the step's effective mass matrix is M + h D; else None.

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
        self._after_velocity = int(mujoco.mjtStage.mjSTAGE_VEL)
        self.damping = self._constant_damping()
        self._state = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._kept = np.zeros(mujoco.mj_stateSize(model, self._state))

    def _constant_damping(self) -> Array | None:
        """(nv,) D, if the step's effective mass matrix is M + h D; else None.

        It is for the Euler integrator and a constant damping of joints, and for implicitfast if
        no other force of the model depends on the velocity, except servos on joints.
        """
        mujoco, model = self._mujoco, self._model
        flags = mujoco.mjtDisableBit
        varies = any(
            np.any(getattr(model, name, 0.0)) for name in ("dof_dampingpoly", "actuator_damping")
        )
        if varies or not hasattr(self._data, "M"):
            return None
        damping = np.array(model.dof_damping, dtype=np.float64)
        undamped = bool(model.opt.disableflags & getattr(flags, "mjDSBL_DAMPER", 0))
        if self._euler:
            if undamped or model.opt.disableflags & flags.mjDSBL_EULERDAMP:
                damping[:] = 0.0
            return damping
        if model.opt.integrator != mujoco.mjtIntegrator.mjINT_IMPLICITFAST:
            return None
        if np.any(model.tendon_damping) or model.opt.density > 0.0 or model.opt.viscosity > 0.0:
            return None
        if undamped:
            damping[:] = 0.0
        return damping if self._add_servos(damping) else None

    def _add_servos(self, damping: Array) -> bool:
        """Add the damping of servos on slides and hinges; False if an actuator is of another kind.

        A force range clamps the force, and its derivative then vanishes.
        """
        mujoco, model = self._mujoco, self._model
        plain = {int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE)}
        biases = {int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)}
        scalar = {int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)}
        for i in range(model.nu):
            if int(model.actuator_gaintype[i]) not in plain or model.actuator_gainprm[i, 2] != 0.0:
                return False
            if int(model.actuator_biastype[i]) not in biases:
                return False
            if model.actuator_biasprm[i, 2] == 0.0:
                continue
            joint = int(model.actuator_trnid[i, 0])
            on_joint = int(model.actuator_trntype[i]) == int(mujoco.mjtTrn.mjTRN_JOINT)
            clamped = model.actuator_forcelimited[i] or model.jnt_actfrclimited[joint]
            if clamped or not on_joint or int(model.jnt_type[joint]) not in scalar:
                return False
            gear = model.actuator_gear[i, 0]
            damping[model.jnt_dofadr[joint]] -= gear * gear * model.actuator_biasprm[i, 2]
        return True

    def _accelerate(self) -> Array:
        """(nv,) (v+ - v)/h of the step, after mj_fwdConstraint."""
        model, data, h = self._model, self._data, self._model.opt.timestep
        if self._discrete:
            return np.array(data.qacc)
        if self.damping is not None:
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
        if self._discrete:  # its stages are not complete one by one
            self._mujoco.mj_forwardSkip(model, data, self._after_velocity, 1)
        else:
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
        """(6, 2) change of :meth:`of` by the force, by differences from ``at`` = of(force).

        The mobility, its first two rows, is made symmetric, as the solution on the disc needs it;
        it is nearly so with the integrator implicit.
        """
        found = np.zeros((6, 2))
        reach = share * (1.0 + float(np.abs(force).max()))
        for k in self._present:
            moved = np.array(force)
            moved[k] += reach
            found[:, k] = (self.of(applied, moved) - at) / reach
        found[0, 1] = found[1, 0] = 0.5 * (found[0, 1] + found[1, 0])
        return found
