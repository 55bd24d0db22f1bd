"""The scene's own coordinates, live: the mean wrench of the coming period.

A sample is projected onto slide and spin (and the pose of A, where both bodies are free), and these
are integrated over the period (methods/minimal/integrate.py). While it slides and nothing happens,
f1 and m1 are the means of that motion, and so is the reported FN; the constraint's part is what
leads back onto it, as the impulse method has it. Where something happens within the period - stick,
rest, stops, locks, imposed motion - no mean of a held wrench leaves the bodies where they should
be, and the wrench is the impulse method's, which solves for the end of the period; but of a rest,
place and time are the integrated ones.
"""

import math

import numpy as np

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.joint_limits import imposed
from cylconn_ros.core.relative_state import Observed, observe
from cylconn_ros.methods.complementarity import Solved, reactions
from cylconn_ros.methods.free_axes import Available, available
from cylconn_ros.methods.impulse import answer, frozen
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.derivatives import FRICTION, INTEGRALS, NORMAL, SLIPPED, TOTAL
from cylconn_ros.methods.minimal.events import LOG, RESTS
from cylconn_ros.methods.minimal.initial import LIVE, mode_of, start, tolerance_of
from cylconn_ros.methods.minimal.integrate import Ran, integrate

MOST_STEPS = 200  # within a period: beyond them, the impulse method's answer
MOST_EVENTS = 8


@device_function
def step(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """One sample: (NSAMPLE,) in, (NOUT,) out, ``mem`` advanced; returns the flags."""
    o = observe(par, mem, sample, out)
    s = frozen(par, mem, sample, o, h, True)
    slipped, was_stick = mem[model.SLIPPED], mem[model.WAS_STICK] != 0.0
    av = available(par, mem, o, s.reduced, h, model.output(par).semi_implicit)
    sticks = av.solved.regime == out_at.STICK
    if av.stop != 0 or av.lock != 0 or av.restitution != 0.0 or (sticks and was_stick):
        return answer(par, mem, out, o, s, av, h)
    if imposed(par, 0) or imposed(par, 1):
        return answer(par, mem, out, o, s, av, h)
    n = 17 if mode_of(par) == at.BOTH_FREE else 4
    joint, y, log = np.zeros(at.NJOINT), np.zeros(n + INTEGRALS), np.zeros((MOST_EVENTS, LOG))
    start(par, mem, sample, o, True, joint, y)
    ran = integrate(
        par, joint, y, 0.0, h, tolerance_of(par, LIVE), h, False, was_stick, log, 0, MOST_STEPS
    )  # fmt: skip
    within = ran.complete and ran.coarse == math.inf
    smooth = within and ran.events == 0 and not ran.state.stuck and not sticks
    if smooth:
        mem[model.SLIPPED] = slipped + y[n + SLIPPED]
        av = _mean(par, mem, o, av, y, n, h)
        mem[model.LAST_TOTAL], mem[model.LAST_TOTAL + 1] = y[n + TOTAL] / h, y[n + TOTAL + 1] / h
        c = reactions(s.reduced, mem[model.LAST_TOTAL], mem[model.LAST_TOTAL + 1])
        av = Available(
            av.spring, av.damper, av.actuation, av.solved, c, av.stop, av.lock, av.restitution
        )
    flags = answer(par, mem, out, o, s, av, h)
    if smooth:
        _write_means(par, out, av, y[n + NORMAL] / h)
    elif sticks and within and ran.state.stuck and ran.events <= MOST_EVENTS:
        _keep_place(mem, out, y, log, ran, h)
    return flags


@device_function
def _mean(
    par: Array, mem: Array, o: Observed, av: Available, y: Array, n: int, h: float
) -> Available:
    """The parts of f1 and m1 as means of the integrated motion; the constraint's is not touched."""
    e = model.ELASTICITY
    damper = (
        -par[e + 2] * (y[at.LENGTH] - o.length) / h,
        -par[e + 3] * (y[at.ANGLE] - o.angle) / h,
    )
    friction = (y[n + FRICTION] / h, y[n + FRICTION + 1] / h)
    spring = (
        y[n + TOTAL] / h - friction[0] - damper[0] - av.actuation[0],
        y[n + TOTAL + 1] / h - friction[1] - damper[1] - av.actuation[1],
    )
    solved = Solved(
        (y[at.SLIDE], y[at.SPIN]), friction, (0.0, 0.0), av.solved.regime, av.solved.flags,
        av.solved.s_mean, 0.0,
    )  # fmt: skip
    return Available(
        spring, damper, av.actuation, solved, av.constraint, av.stop, av.lock, av.restitution
    )


@device_function
def _write_means(par: Array, out: Array, av: Available, normal: float) -> None:
    """The mean FN, which is greater than that of mean reactions that turn."""
    out[out_at.NORMAL_FORCE] = normal
    traction = out[out_at.TRACTION]
    if out[out_at.REGIME] == out_at.SLIP and normal > 0.0:
        out[out_at.FRICTION_COEFFICIENT] = traction / normal


@device_function
def _keep_place(mem: Array, out: Array, y: Array, log: Array, ran: Ran, h: float) -> None:
    """Stick where the motion came to rest, not where the held wrench leaves the bodies."""
    mem[model.HELD_LENGTH], mem[model.HELD_ANGLE] = y[at.LENGTH], y[at.ANGLE]
    mem[model.STUCK] = 2.0  # the place is known: it is not to be taken from the next sample
    if ran.events > 0 and log[ran.events - 1, 1] == RESTS:
        out[out_at.STOP_TIME] = log[ran.events - 1, 0]
