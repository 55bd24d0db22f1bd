"""Loads of a MuJoCo model on the bodies of a connector: contacts, further joints, drives.

A connector computes reactions of the same step, so that it needs every force on a body that it
moves. MuJoCo's Newton-Euler recursion gives, for the bodies i of a rigid body (in MuJoCo's terms:
welded together) and the bodies c that hang on them by joints,

    load = sum_i fe_i - sum_c fi_c [+ fi of the rigid body itself] - applied

with fe the wrench of contacts, connect and weld equalities and what is applied, and fi the wrench
that a body gets from its parent. With ``constraint: connector`` the rigid body floats, and its own
fi is what remains of its generalized forces (drives on sites, tendons, compensated gravity). With
``constraint: simulator`` its own fi is the reaction of the joint, which the connector computes; of
it only the drive of the joint belongs to the load. Gravity is no part of the load.

Loads are those at the sample, under the wrench of the last period: what depends on the coming
wrench (a hand that holds the body by a stiff contact) is one period late.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ModelLoads:
    """Loads on one body; ``present`` tells whether the model can have any.

    ``joints``: of the connector, if the simulator keeps them; their child is no load on body A.
    """

    def __init__(self, mujoco: Any, model: Any, body: int, joints: Sequence[int], child: bool):
        """``child``: whether ``body`` is the joints' child (body B)."""
        self._mujoco, self._model, self._body = mujoco, model, body
        weld = model.body_weldid[body]
        self._members = [i for i in range(1, model.nbody) if model.body_weldid[i] == weld]
        self._root, self._joints, self._sign = int(weld), list(joints), 1.0 if child else -1.0
        own = [] if child or not self._joints else [int(model.jnt_bodyid[self._joints[0]])]
        self._hanging = [
            i for i in range(1, model.nbody)
            if model.body_parentid[i] in self._members and i not in self._members and i not in own
        ]  # fmt: skip
        self.present = bool(self._hanging) or self._can_be_touched() or self._is_driven()

    def _can_be_touched(self) -> bool:
        model = self._model
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] in self._members]
        if any(model.geom_contype[g] or model.geom_conaffinity[g] for g in geoms):
            return True
        kinds = self._mujoco.mjtEq
        bodies = (int(kinds.mjEQ_CONNECT), int(kinds.mjEQ_WELD))
        return any(int(kind) in bodies for kind in model.eq_type)

    def _is_driven(self) -> bool:
        """Whether there may be drives beside those of other joints."""
        model, of_joint = self._model, int(self._mujoco.mjtTrn.mjTRN_JOINT)
        count = len(model.actuator_trntype)
        others = [i for i in range(count) if int(model.actuator_trntype[i]) != of_joint]
        own = [
            i for i in range(count)
            if i not in others and int(model.actuator_trnid[i, 0]) in self._joints
        ]  # fmt: skip
        return bool(others or own or model.ntendon or np.any(model.body_gravcomp))

    def read(self, data: Any) -> Array:
        """Force and torque about the body frame's origin in world axes, (6,) N, N m.

        ``data``: after mj_forward and mj_rnePostConstraint.
        """
        total = sum((data.cfrc_ext[i] for i in self._members), np.zeros(6))
        total -= sum((data.cfrc_int[i] for i in self._hanging), np.zeros(6))
        if not self._joints:
            total += data.cfrc_int[self._root]
        centre = data.subtree_com[self._model.body_rootid[self._body]]
        at = data.xpos[self._body]
        force, torque = total[3:], total[:3] + np.cross(centre - at, total[3:])
        for i in self._members:
            applied = data.xfrc_applied[i]
            force = force - applied[:3]
            torque = torque - applied[3:] - np.cross(data.xipos[i] - at, applied[:3])
        for joint in self._joints:
            drive = self._sign * data.qfrc_actuator[self._model.jnt_dofadr[joint]]
            axis = data.xaxis[joint]
            if int(self._model.jnt_type[joint]) == int(self._mujoco.mjtJoint.mjJNT_SLIDE):
                force = force + drive * axis
                torque = torque + np.cross(data.xanchor[joint] - at, drive * axis)
            else:
                torque = torque + drive * axis
        return np.concatenate([force, torque])
