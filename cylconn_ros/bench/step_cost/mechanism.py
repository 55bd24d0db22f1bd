"""Cost of friction inside a mechanism: ``cr.mujoco.Friction`` over ``mj_step`` on ten joints.

A chain of nine hinges carries a slide. It falls freely, or hangs with its end on the floor, so that
contacts are active. Each loop steps a model of its own for the same time from the same start; the
friction keeps the slide of its model slower. Loops take turns, and start anew after 200 steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cylconn_ros.bench.common.results import STEP, Findings, Measurement, NotMeasured, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread, ratio, time_interleaved, timed
from cylconn_ros.scene.behaviour import Friction as Law

FREE, TOUCHING = "10 joints", "10 joints, active contacts"
MJ_STEP, OVER = "mj_step", "over mj_step"
IN_PLACE, BEFORE = "Friction.step()", "Friction.apply(), mj_step"
LIMIT = 2.0  # target of step() without contacts
STEPS = 200  # from the start


def chain(touching: bool) -> str:
    """MJCF of nine hinges in turn about y and z, and a slide at their end."""
    links, last = "", 'contype="1"' if touching else ""
    for k in range(9):
        links += (
            f'<body pos="{0.1 if k else 0.0} 0 0"><joint type="hinge" axis="0 {k % 2} {1 - k % 2}" '
            'damping="0.1"/><geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02"/>'
        )
    floor = '<geom type="plane" size="3 3 1" pos="0 0 -0.019" contype="1" conaffinity="1"/>'
    return (
        '<mujoco><option timestep="0.001"/><default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{floor if touching else ''}{links}"
        '<body pos="0.1 0 0"><joint name="slide" type="slide" axis="1 0 0"/>'
        f'<geom type="box" size="0.05 0.03 0.02" {last}/></body>{"</body>" * 9}'
        "</worldbody></mujoco>"
    )


class _Loop:
    """A model that is stepped n times; ``make`` returns the step and what resets its history."""

    def __init__(self, mujoco: Any, text: str, make: Callable[..., Any]) -> None:
        self._mujoco = mujoco
        self._model = mujoco.MjModel.from_xml_string(text)
        self._data = mujoco.MjData(self._model)
        self._step, self._reset = make(mujoco, self._model, self._data)

    def __call__(self, n: int) -> None:
        """Take n steps."""
        step = self._step
        while n > 0:
            self._mujoco.mj_resetData(self._model, self._data)
            self._reset()
            for _ in range(min(n, STEPS)):
                step()
            n -= STEPS


def _plain(mujoco: Any, model: Any, data: Any) -> Any:
    return (lambda: mujoco.mj_step(model, data)), lambda: None


def _in_place(_mujoco: Any, model: Any, data: Any) -> Any:
    friction = _friction(model, data)
    return friction.step, friction.reset


def _before(mujoco: Any, model: Any, data: Any) -> Any:
    friction = _friction(model, data)

    def step() -> None:
        friction.apply()
        mujoco.mj_step(model, data)

    return step, friction.reset


def _friction(model: Any, data: Any) -> Any:
    from cylconn_ros.mujoco.friction import Friction

    law = Law(coefficient=0.2, radius=0.01, overlap=0.1)
    return Friction(model, data, slide="slide", scene=law)


def measure(settings: Settings) -> Findings:
    """Both cases; ratios to ``mj_step`` are formed within each round."""
    found = Findings()
    try:
        import mujoco
    except ImportError:
        for case in (FREE, TOUCHING):
            reason = "pip install mujoco"
            found.not_measured.append(NotMeasured(case, IN_PLACE, "not installed", reason))
        return found
    loops = {MJ_STEP: _plain, IN_PLACE: _in_place, BEFORE: _before}
    for case in (FREE, TOUCHING):
        text = chain(case == TOUCHING)
        blocks = {name: timed(_Loop(mujoco, text, make)) for name, make in loops.items()}
        times = time_interleaved(blocks, settings.rounds, settings.block)
        for name, values in times.items():
            if name != MJ_STEP:
                spread = ratio(values, times[MJ_STEP])
                found.measurements.append(Measurement.of(case, name, OVER, spread, "1"))
            spread = Spread.of(values)
            found.measurements.append(Measurement.of(case, name, STEP, spread, "µs", scale=1e6))
        if case == FREE:
            value = ratio(times[IN_PLACE], times[MJ_STEP]).median
            found.targets.append(Target(f"{case}: {IN_PLACE}, {OVER}", value, LIMIT, ""))
    return found
