"""The compiled step: one entry for every method and every caller."""

import math
from typing import Final

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function, kernel
from cylconn_ros.core.latency import is_late, periods_late, predict, remember_sent
from cylconn_ros.core.relative_state import status_of, write_measured
from cylconn_ros.methods import augmented_lagrangian, baumgarte, impulse, observe, penalty

IMPULSE: Final = 0
PENALTY: Final = 1
AUGMENTED_LAGRANGIAN: Final = 2
BAUMGARTE: Final = 3
MINIMAL: Final = 4
OBSERVE: Final = 5
NAMES: Final[dict[str, int]] = {
    "impulse": IMPULSE,
    "penalty": PENALTY,
    "augmented_lagrangian": AUGMENTED_LAGRANGIAN,
    "baumgarte": BAUMGARTE,
    "minimal": MINIMAL,
    "observe": OBSERVE,
}


AHEAD: Final = slice(model.AHEAD, model.AHEAD + out_at.NSAMPLE)


@inline_function
def _nothing(out: Array, status: int) -> None:
    """A zero wrench and the reason."""
    for k in range(out_at.NOUT):
        out[k] = 0.0
    out[out_at.STATUS] = status


@inline_function
def begun(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Whether a sample can be answered: OK with ``out`` empty, or why the wrench is zero.

    Where wrenches act late, the sample to be answered is then the one at AHEAD in ``mem``.
    """
    status = status_of(sample)
    if status == out_at.OK and not h > 0.0:
        status = out_at.NO_PERIOD
    _nothing(out, status)  # what a method leaves out is zero, whatever stood there
    if is_late(par):
        if status == out_at.OK:
            predict(par, mem, sample, h, out)
            status = status_of(mem[model.AHEAD : model.AHEAD + out_at.NSAMPLE])
            out[out_at.STATUS] = status
        if status != out_at.OK:
            remember_sent(mem, False)
    return status


@inline_function
def ended(par: Array, mem: Array, sample: Array, h: float, flags: int, out: Array) -> int:
    """Close an answer: its status, which is not OK where anything in it is not finite."""
    out[out_at.FLAGS] = flags
    mem[model.LAST_PERIOD] = h
    if is_late(par):
        write_measured(par, mem, sample, h * periods_late(par, mem), out)
        remember_sent(mem, True)
    for k in range(out_at.REGIME):
        if not math.isfinite(out[k]):
            _nothing(out, out_at.NOT_FINITE)
            for i in range(model.NMEM):  # what was remembered of it is not to be trusted either
                mem[i] = 0.0
            return out_at.NOT_FINITE
    return out_at.OK


@kernel
def step(method: int, par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Answer one sample.

    Args:
        method: one of NAMES but MINIMAL, which has its own entry (methods/minimal/entry.py).
        par: the scene in numbers. mem: (NMEM,) what is remembered, advanced.
        sample: (NSAMPLE,) see core/layout.py. h: the period the wrench will be held, s.
        out: (NOUT,) the answer.

    Returns the status: OK, or why the wrench is zero. A sample that cannot be used leaves ``mem``
    as it was.
    """
    status = begun(par, mem, sample, h, out)
    if status != out_at.OK:
        return status
    now = mem[AHEAD] if is_late(par) else sample
    if method == IMPULSE:
        flags = impulse.step(par, mem, now, h, out)
    elif method == PENALTY:
        flags = penalty.step(par, mem, now, h, out)
    elif method == AUGMENTED_LAGRANGIAN:
        flags = augmented_lagrangian.step(par, mem, now, h, out)
    elif method == OBSERVE:
        flags = observe.step(par, mem, now, h, out)
    else:
        flags = baumgarte.step(par, mem, now, h, out)
    return ended(par, mem, sample, h, flags, out)


@kernel
def run(method: int, par: Array, mem: Array, samples: Array, h: float, outs: Array) -> None:
    """Answer (N, NSAMPLE) samples in order into (N, NOUT)."""
    for k in range(samples.shape[0]):
        step(method, par, mem, samples[k], h, outs[k])
