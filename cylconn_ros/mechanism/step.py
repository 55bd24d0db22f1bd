"""One step of slide and spin inside a mechanism, for reactions that are affine in (f1, m1).

The simulator's step is linear in the joint forces f = (f1, m1) as long as no constraint of it
becomes active or inactive:

    (v1, w1)+          = free + h A f
    (f2, f3, m2, m3)   = base + by_f1 f1 + by_m1 m1

These are the equations of method impulse after elimination of its constrained components
(methods/free_axes/complementarity.py), so that friction, stops, locks, springs and drives are
solved by the same functions. Positions follow the end velocity: the plant is semi-implicit.
"""

import math
from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function, kernel
from cylconn_ros.core.kinematics import Frame, Twist
from cylconn_ros.core.overlap import set_contact_range
from cylconn_ros.core.passivity import add_work
from cylconn_ros.core.relative_state import RelativeState, spring_energy_of
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.methods.free_axes.complementarity import ReducedStep
from cylconn_ros.methods.free_axes.step import solve_free_axes, write_state

# Indices of the numbers that describe a step.
LENGTH: Final = 0  # of the slide, m
ANGLE: Final = 1  # of the spin, rad
RATES: Final = 2  # 2: v1 (m/s), w1 (rad/s)
FREE: Final = 4  # 2: rates at the end of the step for f = 0
MOBILITY: Final = 6  # 3: h A, elements 11, 12, 22
BASE: Final = 9  # 4: f2, f3, m2, m3 for f = 0, about node b in the axes of node a
BY_F1: Final = 13  # 4
BY_M1: Final = 17  # 4
NSTEP: Final = 21

_ZERO: Final = (0.0, 0.0, 0.0)
_NO_TURN: Final = (0.0, 0.0, 0.0, 1.0)
_UNIT: Final = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@inline_function
def _four(a: Array, at: int) -> tuple[float, float, float, float]:
    return (a[at], a[at + 1], a[at + 2], a[at + 3])


@inline_function
def _begin(par: Array, mem: Array, s: Array) -> None:
    """Reference configuration at the first step; work of the last step."""
    length, angle = s[LENGTH], s[ANGLE]
    if mem[model.HAS_REFERENCE] == 0.0:
        mem[model.HAS_REFERENCE] = 1.0
        mem[model.LENGTH0] = mem[model.STICK_LENGTH] = length
        mem[model.ANGLE0] = mem[model.STICK_ANGLE] = angle
        mem[model.SPRING0] = spring_energy_of(par, mem, length, angle)
    else:
        slid, spun = length - mem[model.LAST_POSITION], angle - mem[model.LAST_ANGLE]
        f1, m1 = mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1]
        add_work(mem, f1 * slid + m1 * spun)
        mem[model.ACTUATION_WORK] += mem[model.LAST_ACTUATION] * slid
        mem[model.ACTUATION_WORK] += mem[model.LAST_ACTUATION + 1] * spun
    mem[model.LAST_POSITION], mem[model.LAST_ANGLE] = length, angle


@inline_function
def _write_motion(par: Array, mem: Array, s: Array, out: Array) -> None:
    length, angle, v1, w1 = s[LENGTH], s[ANGLE], s[RATES], s[RATES + 1]
    out[layout.LENGTH], out[layout.ANGLE] = length, angle
    out[layout.DISPLACEMENT] = length - mem[model.LENGTH0]
    out[layout.ROTATION] = angle - mem[model.ANGLE0]
    at = model.REFERENCE
    out[layout.MATERIAL_DISPLACEMENT] = length - model.value_or(par[at + 2], mem[model.LENGTH0])
    out[layout.MATERIAL_ROTATION] = angle - model.value_or(par[at + 3], mem[model.ANGLE0])
    out[layout.VELOCITY], out[layout.ANGULAR_VELOCITY] = v1, w1
    out[layout.ENERGY_EXCHANGED] = mem[model.WORK_EXCHANGED]
    stored = spring_energy_of(par, mem, length, angle) - mem[model.SPRING0]
    mem[model.SPRING_ENERGY] = stored
    out[layout.PASSIVITY_BALANCE] = mem[model.WORK] + stored - mem[model.ACTUATION_WORK]
    s2 = model.law(par).radius * w1
    out[layout.SLIP_VELOCITY], out[layout.SLIP_VELOCITY + 1] = v1, s2
    out[layout.SLIP_RATE] = math.sqrt(v1 * v1 + s2 * s2)


@device_function
def solve_step(par: Array, mem: Array, s: Array, h: float, out: Array) -> int:
    """Solve one step; returns the status. f1 and m1 are in ``out`` at FORCE and MOMENT.

    par, mem: parameters and memory (core/model.py). s: (NSTEP,). h: s. out: (NOUT,). A step whose
    numbers are not finite gives zero forces and leaves ``mem`` as it is.
    """
    for k in range(layout.NOUT):
        out[k] = 0.0
    for k in range(NSTEP):
        if not math.isfinite(s[k]):
            out[layout.STATUS] = layout.NOT_FINITE
            return layout.NOT_FINITE
    if not h > 0.0:
        out[layout.STATUS] = layout.NO_PERIOD
        return layout.NO_PERIOD
    _begin(par, mem, s)
    flags = 0
    if not set_contact_range(par, mem[model.LENGTH0], s[LENGTH], out):
        flags = layout.DISENGAGED
    _write_motion(par, mem, s, out)
    still = Motion(_ZERO, _NO_TURN, _ZERO, _ZERO)
    o = RelativeState(
        model.body(par, model.BODY_A), model.body(par, model.BODY_B),
        model.nodes(par, _NO_TURN), still, still,
        Frame(_UNIT, _NO_TURN, _ZERO, _ZERO, _ZERO),
        Twist((s[RATES], 0.0, 0.0), (s[RATES + 1], 0.0, 0.0)),
        s[LENGTH], s[ANGLE], (0.0, 0.0, 0.0, 0.0), 0,
    )  # fmt: skip
    r = ReducedStep(
        _four(s, BASE), _four(s, BY_F1), _four(s, BY_M1),
        (s[FREE], s[FREE + 1]), (s[MOBILITY], s[MOBILITY + 1], s[MOBILITY + 2]),
    )  # fmt: skip
    av = solve_free_axes(par, mem, o, r, h, True)
    c = av.constraint
    f1, m1 = mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1]
    flags |= av.solved.flags | av.flags
    write_state(par, mem, out, o, r, av, (f1, c[0], c[1]), (m1, c[2], c[3]), h)
    out[layout.RESIDUAL] = av.solved.residual
    if mem[model.STICK_SAMPLES] >= layout.STOPPED_SAMPLES:
        flags |= layout.STOPPED
    out[layout.FLAGS] = flags
    mem[model.LAST_PERIOD] = h
    for k in range(layout.REGIME):
        if not math.isfinite(out[k]):
            for i in range(layout.NOUT):
                out[i] = 0.0
            for i in range(model.NMEM):
                mem[i] = 0.0
            out[layout.STATUS] = layout.NOT_FINITE
            return layout.NOT_FINITE
    return layout.OK


@kernel
def solve(par: Array, mem: Array, s: Array, h: float, out: Array) -> int:
    """As :func:`solve_step`, called from Python."""
    return solve_step(par, mem, s, h, out)
