"""Friction of a joint in the user's own MuJoCo loop, from the reactions of the same step."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.outputs import StepResult
from cylconn_ros.core import layout
from cylconn_ros.core import model as memory_layout
from cylconn_ros.importing.model_file import mujoco_module
from cylconn_ros.mechanism import step
from cylconn_ros.mechanism.parameters import mechanism_scene
from cylconn_ros.mujoco import direct
from cylconn_ros.mujoco import joint_equations as equations
from cylconn_ros.mujoco.joint_of_model import check_no_double, joint_of
from cylconn_ros.mujoco.response import Response
from cylconn_ros.scene import behaviour
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene

if TYPE_CHECKING:
    from cylconn_ros.mujoco.recording import Recorder

Array = NDArray[np.float64]

MOST_RUNS = 12  # of the constraint solver for one step
SETTLED = 1e-9  # difference from what the linear equations said, relative


class Friction:
    """Friction, stops, springs and drives of one joint of a MuJoCo model.

    Call :meth:`apply` before ``mujoco.mj_step``, or :meth:`step` in its place, which costs less.
    The force goes to ``data.qfrc_applied``; forces of your own may be there too, written by ``=``.

    Friction is made of the joint's reactions in the coming step, which contain the friction itself:
    gravity, the motion of the whole mechanism, contacts, equality constraints, actuators, and
    ``xfrc_applied`` press shaft and sleeve together. The model keeps the joint. Friction
    (frictionloss), damping, stiffness and range are refused if model and scene both have them.

    Args:
        model, data: MuJoCo's; the integrator is any but RK4.
        slide, hinge: names of a slide joint, a hinge joint, or both on one axis.
        scene: a :class:`~cylconn_ros.Scene`, whose nodes say where the bearing is, or a
            :class:`~cylconn_ros.Friction` alone, with the bearing's centre at the joint's ``pos``.
            Masses and methods of the scene are not used. The length is that of node b before node
            a, the angle is the hinge's from ``qpos0``.

    Attributes
    ----------
        scene: the scene in use. forces: (f1, m1) of the last step. left_out: forces of the model
        that the reactions do not contain, in words. runs: of the constraint solver in the last
        step; 0: no constraint was active.

    Raises ModelError and SceneError that name the joint or parameter and the rule.

    Example::

        friction = cr.mujoco.Friction(model, data, slide="slide", scene=scene)
        while data.time < 1.0:
            friction.apply()
            mujoco.mj_step(model, data)
        print(friction.result["normal_force"], friction.result.regime)
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        *,
        slide: str | None = None,
        hinge: str | None = None,
        scene: Scene | behaviour.Friction,
    ) -> None:
        self._mujoco = mujoco_module()
        self._model, self._data = model, data
        self.scene = mechanism_scene(scene)
        joint = joint_of(model, slide, hinge, scene if isinstance(scene, Scene) else None)
        check_no_double(model, joint.pair, self.scene)
        self.joint, self.left_out = joint, joint.left_out
        self._par, self._mem = pack(self.scene), np.zeros(memory_layout.NMEM)
        self._out = np.zeros(layout.NOUT)
        self._response = Response(self._mujoco, model, data, joint)
        self._dofs = [int(d) for d in joint.index[equations.DOFS : equations.DOFS + 2] if d >= 0]
        self._sent = np.full(4, np.nan)  # our share of qfrc_applied, and what that had with it
        self.runs = 0
        self._time: float | None = 0.0  # None: that of the step which ended at data.time
        self._numbers = self._response.numbers
        self._option = model.opt
        mujoco = self._mujoco
        self._actuate, self._accelerate = mujoco.mj_fwdActuation, mujoco.mj_fwdAcceleration
        self._react, self._step1 = mujoco.mj_rnePostConstraint, mujoco.mj_step1
        self._solve_compiled: Any = equations.solve_unconstrained
        self._state: Any
        self._arguments: Any
        self._state, self._arguments = self._views()
        self._addresses: Any = None
        if self._arguments is not None:
            subtree = int(joint.index[equations.SUBTREE])
            arguments = (*self._state, *self._arguments)
            self._kept_arrays = direct.arrays_of(model, data, subtree, arguments)
            self._addresses = direct.addresses(mujoco, model, data, self._kept_arrays)
        self._finish: Any = direct.finish

    def _views(self) -> tuple[tuple[Any, ...], tuple[Any, ...] | None]:
        """Arguments of the compiled step: views of MuJoCo's arrays, which stay where they are.

        The second part is None if the integrator is another one.
        """
        model, data, joint = self._model, self._data, self.joint
        if self._response.damping is None:
            return (), None
        flat = [getattr(data, name).reshape(-1) for name in
                ("M", "qfrc_smooth", "qacc", "qpos", "qvel", "xpos", "xmat", "subtree_com", "cdof",
                 "crb", "cfrc_int", "qfrc_applied")]  # fmt: skip
        state = (self._par, self._mem, self._numbers, self._out)
        return (*state, np.zeros(len(flat[0])), np.zeros(3 * model.nv)), (
            joint.index, joint.geometry, model.M_rowadr, model.M_rownnz, model.M_colind,
            self._response.damping, *flat, self._sent,
        )  # fmt: skip

    @property
    def result(self) -> StepResult:
        """Forces, contact forces, regime and flags of the last step, by name."""
        return StepResult(self._out)

    @property
    def forces(self) -> tuple[float, float]:
        """f1 (N) and m1 (N.m) of the last step, on body B along and about the axis."""
        return float(self._out[layout.FORCE]), float(self._out[layout.MOMENT])

    @property
    def time(self) -> float:
        """Time of the state from which the last step began, s."""
        if self._time is None:
            return float(self._data.time - self._option.timestep)
        return self._time

    def reset(self) -> None:
        """Forget the history, after a jump of the state such as mj_resetData."""
        self._mem[:] = 0.0

    def record(self, directory: str | Path) -> Recorder:
        """Open a recorded run for ``cylconn report``; a context manager.

        Call its ``write()`` after each :meth:`apply` or :meth:`step`. Raises RecordingError if the
        directory exists or cannot be written.
        """
        from cylconn_ros.mujoco.recording import Recorder

        return Recorder(self, directory, self._model, self._data)

    def step(self) -> None:
        """One step of the model with friction, in place of ``mujoco.mj_step``."""
        data = self._data
        self._step1(self._model, data)
        if self._addresses is not None and data.nefc == 0:
            self._time, self.runs = None, 0
            option = self._option
            self._finish(self._addresses, option.timestep, option.disableflags, True)
            return
        self._solve()
        self._mujoco.mj_step2(self._model, data)

    def apply(self) -> None:
        """Put the force of the coming step into ``data.qfrc_applied``; mj_step has to follow.

        It runs the first half of the step, with sensors and the control callback, if one is set.
        """
        mujoco = self._mujoco
        if mujoco.get_mjcb_control() is None:
            mujoco.mj_fwdPosition(self._model, self._data)
            mujoco.mj_fwdVelocity(self._model, self._data)
        else:
            mujoco.mj_step1(self._model, self._data)
        self._solve()

    def _solve(self) -> None:
        """Solve the coming step and put its forces in the place of the last step's."""
        data = self._data
        self._time = data.time
        if self._addresses is not None and data.nefc == 0:
            option = self._option
            self._finish(self._addresses, option.timestep, option.disableflags, False)
            self.runs = 0
            return
        self._actuate(self._model, data)
        if self._arguments is not None and data.nefc == 0:
            self._accelerate(self._model, data)
            self._react(self._model, data)
            self._solve_compiled(*self._state, self._option.timestep, *self._arguments)
            self.runs = 0
            return
        index, applied = self.joint.index, data.qfrc_applied
        equations.take_back(index, applied, self._sent)
        self._solve_constrained()
        equations.send(index, applied, self._sent, self._out)

    def _solve_constrained(self) -> None:
        """Solve with the constraint solver's answers, made linear until both agree."""
        applied, h = np.array(self._data.qfrc_applied), self._model.opt.timestep
        kept, s, out = self._mem.copy(), self._numbers, self._out
        force = np.array([self._mem[memory_layout.LAST_FREE_FORCES + k] for k in range(2)])
        response = self._response
        at = response.of(applied, force)
        active = response.active()
        matrix = response.matrix(applied, force, at, 0.05)
        self.runs = 1 + len(self._dofs)
        while True:
            self._write(at - matrix @ force, matrix)
            self._mem[:] = kept
            status = step.solve(self._par, self._mem, s, h, out)
            if status != layout.OK:
                break
            found = out[[layout.FORCE, layout.MOMENT]]
            expected = at + matrix @ (found - force)
            at, force = response.of(applied, found), found
            self.runs += 1
            if _is_close(at, expected):
                break
            if self.runs >= MOST_RUNS:
                out[layout.FLAGS] = int(out[layout.FLAGS]) | layout.NOT_CONVERGED
                break
            changed, active = active != response.active(), response.active()
            if changed:
                matrix = response.matrix(applied, force, at, 1e-3)
                self.runs += len(self._dofs)
        self._data.qfrc_applied[:] = applied

    def _write(self, base: Array, matrix: Array) -> None:
        """The linear equations as the numbers of a step."""
        s = self._numbers
        s[step.FREE : step.FREE + 2] = base[:2]
        s[step.MOBILITY] = matrix[0, 0] or 1.0
        s[step.MOBILITY + 1] = matrix[0, 1]
        s[step.MOBILITY + 2] = matrix[1, 1] or 1.0
        s[step.BASE : step.BASE + 4] = base[2:]
        s[step.BY_F1 : step.BY_F1 + 4] = matrix[2:, 0]
        s[step.BY_M1 : step.BY_M1 + 4] = matrix[2:, 1]


def _is_close(found: Array, expected: Array) -> bool:
    """Whether the answer is the expected one, relative to the greatest rate, force and moment."""
    apart = np.abs(found - expected)
    for part in (slice(0, 2), slice(2, 4), slice(4, 6)):
        if apart[part].max() > SETTLED * (np.abs(found[part]).max() + 1e-6):
            return False
    return True
