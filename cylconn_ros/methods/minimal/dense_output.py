"""Dense output of the integrated motion: one row of numbers per requested time."""

import math
from typing import Final

import numpy as np

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function, allocating_kernel
from cylconn_ros.core.relative_state import measure
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.vectors import cross, matrix, out_of, sub
from cylconn_ros.methods.minimal import derivatives
from cylconn_ros.methods.minimal.coordinates import PIECES, configuration, reduced_equations
from cylconn_ros.methods.minimal.derivatives import size_of
from cylconn_ros.methods.minimal.forces import compliant_stops, instant_of
from cylconn_ros.methods.minimal.initial import (
    apply_imposed_motion,
    initial_state,
    turn_imposed_motion,
)
from cylconn_ros.methods.minimal.integrate import IntegrationResult, integrate
from cylconn_ros.methods.minimal.one_step import ContactState
from cylconn_ros.methods.minimal.over_time import set_time

# --- a row: poses and twists of both bodies as in a sample, followed by ---
COORDINATES: Final = 26  # length, angle, their rates
FORCES: Final = 30  # f1 f2 f3 m1 m2 m3
FRICTION: Final = 36  # f1f, m1f
REACTION: Final = 38  # of stops and locks in f1, m1
NORMAL: Final = 40
TRACTION: Final = 41
LIMIT: Final = 42
REGIME: Final = 43
INTEGRALS: Final = 44
WIDTH: Final = INTEGRALS + derivatives.INTEGRALS


@allocating_function
def _write_body(row: Array, first: int, body: Body, m: Motion) -> None:
    """Write pose and twist of the body's frame to ``row`` from index ``first``."""
    arm = out_of(matrix(m.orientation), body.com)
    model.write_vector(row, first, sub(m.com, arm))
    for k in range(4):
        row[first + 3 + k] = m.orientation[k]
    model.write_vector(row, first + 7, sub(m.velocity, cross(m.spin, arm)))
    model.write_vector(row, first + 10, m.spin)


@allocating_function
def write_row(par: Array, joint: Array, t: float, y: Array, s: ContactState, row: Array) -> None:
    """Fill ``row`` (WIDTH,) for the coordinates y at t."""
    set_time(par, joint, t)
    p = configuration(par, joint, t, y)
    i = instant_of(par, joint, y, reduced_equations(par, joint, y, p), s.stuck, s.sides)
    _write_body(row, layout.A_POSE, model.body(par, model.BODY_A), p.a)
    _write_body(row, layout.B_POSE, model.body(par, model.BODY_B), p.b)
    for k in range(4):
        row[COORDINATES + k] = y[k]
    f, c = FORCES, i.constraint
    row[f], row[f + 3] = i.total
    row[f + 1], row[f + 2], row[f + 4], row[f + 5] = c
    row[FRICTION], row[FRICTION + 1] = i.friction
    pushes = compliant_stops(par, y)
    row[REACTION], row[REACTION + 1] = i.reaction[0] + pushes[0], i.reaction[1] + pushes[1]
    row[NORMAL], row[TRACTION], row[LIMIT] = i.normal, i.traction, i.limit
    regime = layout.STICK if s.stuck else layout.SLIP
    row[REGIME] = regime if model.law(par).on else layout.FRICTIONLESS
    n = size_of(joint)
    for k in range(derivatives.INTEGRALS):
        row[INTEGRALS + k] = y[n + k]


@allocating_kernel
def initial_coordinates(par: Array, sample: Array, joint: Array, y: Array) -> None:
    """Fill ``joint`` (NJOINT,) and ``y`` from the first sample (NSAMPLE,) and imposed motions."""
    mem = np.zeros(model.NMEM)
    observed = measure(par, mem, sample, 0.0, np.zeros(layout.NOUT))
    initial_state(par, mem, sample, observed, joint, y)
    set_time(par, joint, 0.0)
    apply_imposed_motion(par, joint, y)


@allocating_kernel
def trajectory(
    par: Array, joint: Array, y: Array, times: Array, tolerance: float, first: float,
    rows: Array, log: Array, most: int, kinks: Array, pieces: Array,
) -> IntegrationResult:  # fmt: skip
    """Integrate from 0 through ``times`` (N,), ascending, and fill ``rows`` (N, WIDTH).

    kinks, pieces: (M,), (M, 30): factors over time from the times of index ``kinks`` on.
    """
    ran = IntegrationResult(
        0.0,
        ContactState(False, (0, 0), False, False, False, -math.inf),
        0,
        0,
        True,
        False,
        math.inf,
    )
    evaluations, coarse, kink = 0, math.inf, 0
    for k in range(times.shape[0]):
        s = ran.state
        ran = integrate(
            par, joint, y, ran.t, times[k], tolerance, first, s.locked, s.stuck, log, ran.events,
            most,
        )  # fmt: skip
        evaluations += ran.evaluations
        coarse = min(coarse, ran.coarse)
        if not ran.complete:
            break
        write_row(par, joint, times[k], y, ran.state, rows[k])
        while kink < kinks.shape[0] and int(kinks[kink]) == k:
            for j in range(pieces.shape[1]):
                joint[PIECES + j] = pieces[kink, j]
            set_time(par, joint, times[k])
            turn_imposed_motion(par, joint, times[k], y, ran.state.locked)
            kink += 1
    return IntegrationResult(
        ran.t, ran.state, ran.events, evaluations, ran.complete, ran.blocked, coarse
    )
