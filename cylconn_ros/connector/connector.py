"""Connector: the one public step, for the node, replay, the simulation and benchmarks alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cylconn_ros.connector import batch
from cylconn_ros.connector.description import describe_model
from cylconn_ros.connector.outputs import StepResult
from cylconn_ros.core import layout, model
from cylconn_ros.core.jit import COMPILED, close_signatures
from cylconn_ros.errors import SceneError
from cylconn_ros.methods import passivity_controller
from cylconn_ros.methods.dispatch import STEPS
from cylconn_ros.methods.passivity_controller import section
from cylconn_ros.methods.traits import LIVE, TRAITS
from cylconn_ros.scene.packing import choose_method, latency_is_measurable, pack, pack_preload
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show
from cylconn_ros.scene.validation import check_drive, check_within_stops

Array = NDArray[np.float64]

_IN_FLIGHT = (
    slice(model.SENT_WRENCHES, model.LEAST_BALANCE),
    slice(model.REFUTED, model.CONTRARY + 1),
    slice(model.PERIOD_IN_USE, model.PERIOD_IN_USE + 4),
)
"""Memory of the wrenches that have not acted yet, the estimated latency and the period in use."""
_INPUTS = (
    ("pose_a", layout.A_POSE, 7),
    ("twist_a", layout.A_TWIST, 6),
    ("pose_b", layout.B_POSE, 7),
    ("twist_b", layout.B_TWIST, 6),
    ("load_a", layout.A_LOAD, 6),
    ("load_b", layout.B_LOAD, 6),
)


class Connector:
    """A cylindrical connector between two bodies that processes one sample after the other.

    Two free components: slide along the slot axis ``e1`` of node a, and rotation about it. The
    other four relative motions of node b against node a are constrained. Forces act on body B at
    node b, in the axes of node a; body A receives the opposite wrench.

    Attributes
    ----------
        scene: the scene given.
        method: the method in use; the choice of ``auto``.
        model, not_modelled: one line each, what is modelled and what is not.

    Raises :class:`~cylconn_ros.errors.SceneError` for a scene that the method cannot use.

    Example::

        import cylconn_ros as cr

        connector = cr.Connector(cr.load(cr.shipped("coast")))
        result = connector.step(pose_b=[0, 0, 0, 0, 0, 0, 1], twist_b=[1, 0, 0, 0, 0, 0])
        print(result.force_b, result["normal_force"], result.regime)
    """

    def __init__(self, scene: Scene, check_latency: bool = False) -> None:
        """``check_latency``: whether the latency is measured beside a declared one.

        It replaces one of 1 or more that it refutes; for a motion that follows from the wrenches.
        """
        self.scene = scene
        self.method = choose_method(scene)
        self.model, self.not_modelled = describe_model(scene, self.method)
        if self.method not in LIVE:
            raise SceneError(
                f"method = {show(self.method)}: simulates whole motions offline (cylconn simulate, "
                "cylconn_ros.simulate); a connector that processes samples needs "
                f"{', '.join(LIVE[:-1])} or {LIVE[-1]}"
            )
        self._step = STEPS[self.method]
        self._par: Array = pack(scene)
        if check_latency and scene.latency >= 0 and latency_is_measurable(scene):
            self._par[model.LATENCY_CHECKED] = 1.0
        self._mem: Array = np.zeros(model.NMEM)
        self._period = scene.period
        self._types_known = False

    def reset(self, keep_in_flight: bool = False) -> None:
        """Forget the reference configuration and the history: the next sample is the first.

        ``keep_in_flight`` keeps the wrenches that have been sent and not acted yet (``latency``),
        and the estimate of the latency.
        """
        kept = [(part, self._mem[part].copy()) for part in _IN_FLIGHT if keep_in_flight]
        self._mem[:] = 0.0
        for part, numbers in kept:
            self._mem[part] = numbers

    def impose(
        self,
        component: str,
        position: float = math.nan,
        velocity: float = math.nan,
        force: float = math.nan,
        max_force: float = math.nan,
    ) -> None:
        """Impose a motion or a force on an available component until the next call.

        ``component`` is "slide" (m, m/s, N) or "spin" (rad, rad/s, N.m). NaN leaves a quantity
        free. A motion is a position, which moves on with the velocity if one is given, or a
        velocity alone. ``max_force`` (N, N.m) is its greatest force; NaN: the parameter's. Raises
        ValueError as :meth:`check_imposed` does.
        """
        self.check_imposed(component, position, velocity, force, max_force)
        k = ("slide", "spin").index(component)
        at = model.COMMAND + 3 * k
        # A position that goes on: a spring that holds it (penalty) keeps its place.
        moves_on = not math.isnan(self._par[at])
        self._par[at : at + 3] = position, velocity, force
        given = (self.scene.command.slide, self.scene.command.spin)[k].max_force
        self._par[model.DRIVE + 2 * k] = given if math.isnan(max_force) else max_force
        began = not math.isnan(self._mem[model.IMPOSED_POSITION + k])
        self._mem[model.IMPOSED_POSITION + k] = position if moves_on and began else math.nan

    def set_preload(self, preload: float) -> None:
        """Set the preload FCint (N) from the next sample on, in place of the parameter's.

        Raises ValueError for a number that is not finite, and for a connector without friction.
        """
        if not math.isfinite(preload):
            raise ValueError(f"preload = {preload}: must be finite")
        friction = self.scene.friction
        if not friction.on:
            raise ValueError(
                f"preload = {preload:g}: the scene has no friction on which it acts; give "
                "friction.coefficient"
            )
        for part, numbers in pack_preload(self.scene, preload):
            self._par[part] = numbers

    def check_imposed(
        self, component: str, position: float, velocity: float, force: float, max_force: float
    ) -> None:
        """Raise ValueError for a motion or force that cannot be imposed.

        That is one for another component than slide and spin, an infinite number, a motion together
        with a force, a motion with a method that has none, a greatest force with one that has no
        limited drives or that is not above 0, and a position beyond a stop.
        """
        if component not in ("slide", "spin"):
            raise ValueError(f"component = {component!r}: must be slide or spin")
        for name, value in (("position", position), ("velocity", velocity), ("force", force)):
            if math.isinf(value):
                raise ValueError(f"{component}.{name} = {value}: must be finite, or NaN for none")
        if not math.isnan(force) and not (math.isnan(position) and math.isnan(velocity)):
            raise ValueError(f"{component}.force = {force}: must not be given with a motion")
        moves = not (math.isnan(position) and math.isnan(velocity))
        if moves and not TRAITS[self.method].has_limits:
            raise SceneError(f"{component}: the method {self.method} has no imposed motion")
        if max_force <= 0.0:
            raise ValueError(f"{component}.max_force = {max_force}: must be > 0, or NaN")
        given = getattr(self.scene.command, component).max_force
        most = given if math.isnan(max_force) else max_force
        if moves and math.isfinite(most):
            check_drive(self.method, f"{component}.max_force", most, position)
        check_within_stops(self.scene.stops, component, f"position of {component}", position)

    def correct_load(self, body: int, load: Sequence[float]) -> None:
        """Take up a load of the last sample, which has been processed without it.

        The motion since that sample is then explained by the load, not by a latency or a reaction.
        ``body``: 0 for A, 1 for B; ``load``: (6,) force and torque about its origin, world axes.
        """
        for at in (model.LAST_SAMPLE + layout.A_LOAD, model.LAST_LOADS):
            self._mem[at + 6 * body : at + 6 * body + 6] = load

    @property
    def _handle(self) -> Any:
        """Handle of the step function; compiles it at the first use."""
        return self._step.handle

    @property
    def par(self) -> Array:
        """The parameter array of the scene, with the imposed motion (core/model.py)."""
        return self._par

    def kernel_arguments(self) -> tuple[Any, Array, Array, float]:
        """Handle of the step function, parameters, memory and period for batch.process.

        The arrays are the connector's own and stay the same objects.
        """
        return self._handle, self._par, self._mem, self._period

    def use_arrays(self, par: Array, mem: Array) -> None:
        """Keep parameters and memory in the arrays given from now on, with their present content.

        For a group, which has those of all its connectors in one array.
        """
        par[:], mem[:] = self._par, self._mem
        self._par, self._mem = par, mem

    @property
    def latency(self) -> float:
        """Samples between a sample and the action of its wrench: given, or estimated so far.

        The estimate replaces a given latency that is checked while the motion refutes it.
        """
        if self.scene.latency >= 0 and not self._mem[model.REFUTED]:
            return float(self.scene.latency)
        return float(self._mem[model.MEASURED_LATENCY])

    @property
    def measured_latency(self) -> float | None:
        """Samples between a sample and the action of its wrench, as measured; None if unknown.

        It is unknown until a change of the wrenches has been seen in the motion. A declared
        latency that is not checked is not measured.
        """
        if not (self._mem[model.DELAYED] or self._mem[model.LOCK_STEP] > 0.0):
            return None
        return float(self._mem[model.MEASURED_LATENCY])

    @property
    def gain_shares(self) -> tuple[float, float]:
        """Least shares of stiffness and damping of the penalty methods in use (GAINS_LOWERED)."""
        shares = [passivity_controller.shares(self._mem, section(k)) for k in range(4)]
        return min(share[0] for share in shares), min(share[1] for share in shares)

    @property
    def latency_spread(self) -> float:
        """Standard deviation of the measured latency, samples; 0 if it is unknown."""
        return float(self._mem[model.LATENCY_SPREAD])

    @property
    def memory(self) -> Array:
        """(NMEM,) a copy of the connector's memory; assign a copy to restore it."""
        return self._mem.copy()

    @memory.setter
    def memory(self, memory: Array) -> None:
        self._mem[:] = memory

    @overload
    def step(self, sample: ArrayLike, h: float = 0.0, out: Array | None = None) -> Array: ...

    @overload
    def step(
        self,
        sample: None = None,
        h: float = 0.0,
        out: Array | None = None,
        *,
        pose_a: ArrayLike | None = None,
        twist_a: ArrayLike | None = None,
        pose_b: ArrayLike | None = None,
        twist_b: ArrayLike | None = None,
        load_a: ArrayLike | None = None,
        load_b: ArrayLike | None = None,
    ) -> StepResult: ...

    def step(
        self,
        sample: Any = None,
        h: float = 0.0,
        out: Array | None = None,
        **inputs: ArrayLike | None,
    ) -> Array | StepResult:
        """Process one sample, given by name or as one array.

        Args:
            pose_a, pose_b: (7,) position (m) and quaternion x y z w of the body frame in the world.
            twist_a, twist_b: (6,) velocity of the body frame's origin (m/s) and angular velocity
                (rad/s), world axes.
            load_a, load_b: (6,) known external force (N) and torque about the body frame's origin
                (N.m) besides gravity, world axes; zero by default.
            h: s since the previous sample; 0: one period. It is also the period for which the
                wrench is held if the scene's ``period`` is 0.
            sample: (NSAMPLE,) the same numbers as one array (core/layout.py), for hot loops.
            out: (NOUT,) float64, C-contiguous and writeable: the array to write; by default new.

        Returns
        -------
            A :class:`StepResult` if the sample is given by name; else the (NOUT,) array of the two
            published wrenches, the state and the enums. A sample that cannot be used (NaN, a zero
            quaternion) gives a zero wrench; ``STATUS`` says why.

        Pose and twist of a fixed body may be omitted. Raises ValueError for an argument that is
        missing or has a wrong shape or type. Other array-likes than C-contiguous float64 arrays
        are converted, at a higher cost per call.
        """
        if sample is None:
            return StepResult(self.step(self._sample_of(inputs), h, out))
        if inputs:
            raise ValueError(f"{next(iter(inputs))}: must not be given together with sample")
        if out is None:
            out = np.empty(layout.NOUT)
        if not self._types_known:
            sample, h, out = _checked(sample, h, out)
        try:
            status = batch.step(self._handle, self._par, self._mem, sample, h, self._period, out)
        except TypeError:  # a type for which nothing is compiled
            sample, h, out = _checked(sample, h, out)
            status = batch.step(self._handle, self._par, self._mem, sample, h, self._period, out)
        if status == batch.WRONG_SHAPE:
            _checked(sample, h, out)
        if not self._types_known:
            close_signatures(batch.step)
            self._types_known = COMPILED
        return out

    @property
    def period(self) -> float:
        """The period in use, s: the scene's, or the interval of the samples that refutes it."""
        return float(self._mem[model.PERIOD_IN_USE]) or self._period

    def run(
        self, samples: ArrayLike, since: ArrayLike | None = None, outs: Array | None = None
    ) -> Array:
        """Process samples in order, in one call; the result of as many calls of :meth:`step`.

        Args:
            samples: (N, NSAMPLE). since: (N,) s since the previous sample; by default one period.
            outs: (N, NOUT) float64, C-contiguous: the array to write; by default new.

        Returns ``outs``. Raises ValueError for wrong shapes or types, or if ``since`` is not given
        and the scene's period is 0.
        """
        rows = _converted(samples, "samples", (-1, layout.NSAMPLE))
        if since is None:
            if self._period == 0.0:
                raise ValueError("since: must be given, as the scene's period is 0")
            since = np.zeros(len(rows))
        times = _converted(since, "since", (len(rows),))
        if outs is None:
            outs = np.empty((len(rows), layout.NOUT))
        _check_output(outs, "outs", (len(rows), layout.NOUT))
        batch.run(self._handle, self._par, self._mem, rows, times, self._period, outs)
        return outs

    def _sample_of(self, inputs: dict[str, ArrayLike | None]) -> Array:
        """The sample array of named inputs."""
        unknown = inputs.keys() - {name for name, _, _ in _INPUTS}
        if unknown:
            names = ", ".join(name for name, _, _ in _INPUTS)
            raise ValueError(f"{min(unknown)}: no such input; there are {names}")
        sample = np.zeros(layout.NSAMPLE)
        for name, at, size in _INPUTS:
            value = inputs.get(name)
            body = self.scene.bodies["ab".index(name[-1])]
            if value is not None:
                sample[at : at + size] = _converted(value, name, (size,))
            elif name.startswith("pose") and body.kind == "fixed":
                sample[at : at + size] = body.pose
            elif not name.startswith("load") and body.kind != "fixed":
                raise ValueError(f"{name}: must be given, as body_{name[-1]}.kind = {body.kind!r}")
        return sample


def _checked(sample: Any, h: Any, out: Any) -> tuple[Array, float, Array]:
    """Arguments of the types that the kernel is compiled for. Raises ValueError."""
    _check_output(out, "out", (layout.NOUT,))
    try:
        h = float(h)
    except (TypeError, ValueError):
        raise ValueError(f"h = {h!r}: must be a number of seconds") from None
    return _converted(sample, "sample", (layout.NSAMPLE,)), h, out


def _converted(value: Any, name: str, shape: Sequence[int]) -> Array:
    """``value`` as a C-contiguous writeable float64 array of ``shape`` (-1: any length)."""
    wanted = tuple("N" if n < 0 else n for n in shape)
    try:
        given = np.asarray(value)
        if not np.can_cast(given.dtype, np.float64, "same_kind"):
            raise TypeError
        array = np.require(given, np.float64, ["C", "A", "W"])
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {value!r:.60}: must be an array of {wanted} numbers") from None
    if array.ndim != len(shape) or any(
        m not in (n, -1) for n, m in zip(array.shape, shape, strict=True)
    ):
        raise ValueError(f"{name}: has the shape {array.shape}, must be {wanted}")
    return array


def _check_output(array: Any, name: str, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless compiled code can write ``array``."""
    if not isinstance(array, np.ndarray) or array.dtype != np.float64:
        kind = getattr(array, "dtype", type(array).__name__)
        raise ValueError(f"{name}: is {kind}, must be a float64 array")
    if array.shape != shape:
        raise ValueError(f"{name}: has the shape {array.shape}, must be {shape}")
    if not (array.flags.c_contiguous and array.flags.writeable and array.flags.aligned):
        raise ValueError(f"{name}: must be C-contiguous, aligned and writeable")
