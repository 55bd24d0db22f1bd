"""The connector: one public step for live node, replay, plant loop and benchmark alike."""

import math
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector import batch
from cylconn_ros.core import layout, model
from cylconn_ros.methods import dispatch as methods
from cylconn_ros.scene.description import describe_model
from cylconn_ros.scene.packing import choose_method, pack
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

_ON_THE_WAY = (slice(model.SENT, model.AHEAD), slice(model.MISFIT, model.SEEN))  # and how late


class Connector:
    """A cylindrical connector between two bodies, answering one sample after the other.

    Attributes
    ----------
        method: the method that answers; what ``auto`` picked.
        model: one line saying what is modelled and what is left out.

    Raises :class:`~cylconn_ros.scene.schema.SceneError` for a scene that the method cannot
    serve.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.method = choose_method(scene)
        self.model = describe_model(scene, self.method)
        self._method = methods.NAMES[self.method]
        self._steps = _steps_of(self.method)
        self._par = pack(scene)
        self._mem = np.zeros(model.NMEM)
        self._period = scene.period

    def reset(self) -> None:
        """Forget the reference configuration and all history: the next sample is the first."""
        self._mem[:] = 0.0

    def begin_anew(self) -> None:
        """As :meth:`reset`, where wrenches act late: those on their way, and how late, are kept."""
        kept = [(at, self._mem[at].copy()) for at in _ON_THE_WAY]
        self.reset()
        for at, numbers in kept:
            self._mem[at] = numbers

    def impose(
        self,
        component: str,
        position: float = math.nan,
        velocity: float = math.nan,
        force: float = math.nan,
    ) -> None:
        """Impose a motion or a force on an available component until told otherwise.

        ``component`` is "slide" (m, m/s, N) or "spin" (rad, rad/s, N.m). NaN leaves a quantity
        free. A motion is a position, moving on with the velocity where one is given, or a velocity
        alone. Raises ValueError for another component, an infinite number, a motion with a force,
        or a motion where the method has none.
        """
        if component not in ("slide", "spin"):
            raise ValueError(f"component = {component!r}: must be slide or spin")
        for name, value in (("position", position), ("velocity", velocity), ("force", force)):
            if math.isinf(value):
                raise ValueError(f"{component}.{name} = {value}: must be finite, or NaN for none")
        if not math.isnan(force) and not (math.isnan(position) and math.isnan(velocity)):
            raise ValueError(f"{component}.force = {force}: must not be given with a motion")
        if self.method == "baumgarte" and not (math.isnan(position) and math.isnan(velocity)):
            raise ValueError(f"{component}: the method baumgarte has no imposed motion")
        k = ("slide", "spin").index(component)
        at = model.COMMAND + 3 * k
        self._par[at : at + 3] = position, velocity, force
        self._mem[model.IMPOSED_AT + k] = math.nan

    @property
    def par(self) -> Array:
        """The scene in numbers, with what is imposed (core/model.py)."""
        return self._par

    def lend(self) -> tuple[int, Array, Array, float]:
        """Method, parameters, memory and period, for compiled code that steps (series.answer).

        Not for the method ``minimal``, whose step is compiled apart. The arrays stay the same ones.
        """
        return self._method, self._par, self._mem, self._period

    @property
    def late(self) -> int:
        """Samples by which wrenches act late: as the scene says, or as measured so far."""
        return self.scene.latency if self.scene.latency >= 0 else int(self._mem[model.LATE])

    @property
    def memory(self) -> Array:
        """(NMEM,) a copy of all that is remembered; assign one to go back to it."""
        return self._mem.copy()

    @memory.setter
    def memory(self, memory: Array) -> None:
        self._mem[:] = memory

    def step(self, sample: Array, h: float = 0.0, out: Array | None = None) -> Array:
        """Answer one sample.

        Args:
            sample: (NSAMPLE,) poses, twists and loads, SI units, world axes (core/layout.py).
            h: seconds since the previous sample; 0: a period. It is also the time the wrench will
                be held where the scene's period is 0.
            out: (NOUT,) where to put the answer; a new array by default.

        Returns
        -------
            (NOUT,) the two wrenches as they are published, the state block, and the whole numbers.
            A sample that cannot be used gives a zero wrench and says why in ``STATUS``. Nothing
            raises.
        """
        if out is None:
            out = np.empty(layout.NOUT)
        self._steps.step(self._method, self._par, self._mem, sample, self.begin(h), out)
        return out

    def begin(self, h: float) -> float:
        """The period of the step to come, where the last one has taken ``h`` (0: a period)."""
        if h > 0.0 and self._mem[model.LAST_PERIOD] > 0.0:
            self._mem[model.LAST_PERIOD] = h
        return self._period or h

    def run(self, samples: Array) -> Array:
        """Answer (N, NSAMPLE) samples in order: (N, NOUT). The scene's period must not be 0."""
        outs = np.empty((len(samples), layout.NOUT))
        self._steps.run(self._method, self._par, self._mem, samples, self._period, outs)
        return outs

    def run_each(self, samples: Array, since: Array, outs: Array) -> Array:
        """Answer (N, NSAMPLE) samples in order into (N, NOUT), as N calls of :meth:`step` do.

        ``since``: (N,) seconds since the sample before.
        """
        if self.method == "minimal":  # its step is long: what a call costs is nothing beside it
            for sample, h, out in zip(samples, since.tolist(), outs, strict=True):
                self.step(sample, h, out)
        else:
            batch.run(self._method, self._par, self._mem, samples, since, self._period, outs)
        return outs


def _steps_of(method: str) -> ModuleType:
    """The compiled entries of a method; minimal's, which take long to compile, only when asked."""
    if method != "minimal":
        return methods
    from cylconn_ros.methods.minimal import entry

    return entry
