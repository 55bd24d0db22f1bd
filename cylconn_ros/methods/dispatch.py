"""The compiled step: one kernel for all live methods and all callers."""

import math
from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function, kernel
from cylconn_ros.core.latency import is_delayed, latency_of, predict_sample, store_sent_wrenches
from cylconn_ros.core.relative_state import sample_status, write_measured
from cylconn_ros.methods import augmented_lagrangian, baumgarte, impulse, observe, penalty
from cylconn_ros.methods.traits import TRAITS

# Constants of their own, because kernels read module globals, not dictionaries.
IMPULSE: Final = TRAITS["impulse"].number
PENALTY: Final = TRAITS["penalty"].number
AUGMENTED_LAGRANGIAN: Final = TRAITS["augmented_lagrangian"].number
BAUMGARTE: Final = TRAITS["baumgarte"].number
OBSERVE: Final = TRAITS["observe"].number

PREDICTED: Final = slice(model.PREDICTED_SAMPLE, model.PREDICTED_SAMPLE + layout.NSAMPLE)
"""The sample predicted for the time at which the wrench acts, in ``mem``."""


@inline_function
def _clear(out: Array, status: int) -> None:
    """Zero wrenches and a zero state, with the reason."""
    for k in range(layout.NOUT):
        out[k] = 0.0
    out[layout.STATUS] = status


@inline_function
def begin(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Clear ``out`` and check the sample: OK, or the reason for the zero wrench.

    If wrenches act late, the step then uses the sample at PREDICTED in ``mem``.
    """
    status = sample_status(sample)
    if status == layout.OK and not h > 0.0:
        status = layout.NO_PERIOD
    _clear(out, status)  # fields that a method does not write are zero
    if is_delayed(par):
        if status == layout.OK:
            predict_sample(par, mem, sample, h, out)
            status = sample_status(
                mem[model.PREDICTED_SAMPLE : model.PREDICTED_SAMPLE + layout.NSAMPLE]
            )
            out[layout.STATUS] = status
        if status != layout.OK:
            store_sent_wrenches(mem, False)
    return status


@inline_function
def finish(par: Array, mem: Array, sample: Array, h: float, flags: int, out: Array) -> int:
    """Complete ``out`` and the memory; the status is NOT_FINITE if any output is not finite."""
    out[layout.FLAGS] = flags
    mem[model.LAST_PERIOD] = h
    if is_delayed(par):
        write_measured(par, mem, sample, h * latency_of(par, mem), out)
        store_sent_wrenches(mem, True)
    for k in range(layout.REGIME):
        if not math.isfinite(out[k]):
            _clear(out, layout.NOT_FINITE)
            for i in range(model.NMEM):  # the memory of such a step cannot be trusted
                mem[i] = 0.0
            return layout.NOT_FINITE
    return layout.OK


@kernel
def step(method: int, par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Compute the wrenches for one sample.

    Args:
        method: number of a live method (methods/traits.py).
        par: (TABLE + table size,) parameters. mem: (NMEM,) memory, updated (core/model.py).
        sample: (NSAMPLE,) see core/layout.py. h: s, the period for which the wrench is held.
        out: (NOUT,) wrenches, state and enums, overwritten.

    Returns the status: OK, or the reason for the zero wrench. A sample that cannot be used leaves
    the history in ``mem`` unchanged. A number without a live method gives UNKNOWN_METHOD.
    """
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    used = mem[PREDICTED] if is_delayed(par) else sample
    if method == IMPULSE:
        flags = impulse.step(par, mem, used, h, out)
    elif method == PENALTY:
        flags = penalty.step(par, mem, used, h, out)
    elif method == AUGMENTED_LAGRANGIAN:
        flags = augmented_lagrangian.step(par, mem, used, h, out)
    elif method == OBSERVE:
        flags = observe.step(par, mem, used, h, out)
    elif method == BAUMGARTE:
        flags = baumgarte.step(par, mem, used, h, out)
    else:
        _clear(out, layout.UNKNOWN_METHOD)
        return layout.UNKNOWN_METHOD
    return finish(par, mem, sample, h, flags, out)
