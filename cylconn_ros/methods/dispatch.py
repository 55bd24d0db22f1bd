"""The compiled steps: one function for each live method, which all callers share.

Callers get the function's handle and call it by address, so that a method is compiled once, and
only if it is used.
"""

import math
from typing import Any, Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import is_delayed, latency_of, may_be_delayed
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import c_function, call_step, inline_function, vector
from cylconn_ros.core.latency import predict_sample, store_sent_wrenches
from cylconn_ros.core.relative_state import sample_status, write_measured
from cylconn_ros.methods import augmented_lagrangian, baumgarte, impulse, observe, penalty

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
    if may_be_delayed(par, mem):
        if status == layout.OK:
            predict_sample(par, mem, sample, h, out)
        if status == layout.OK and is_delayed(par, mem):
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
    if is_delayed(par, mem):
        write_measured(par, mem, sample, h * latency_of(par, mem), out)
    if may_be_delayed(par, mem):
        store_sent_wrenches(mem, True)
    for k in range(layout.REGIME):
        if not math.isfinite(out[k]):
            _clear(out, layout.NOT_FINITE)
            for i in range(model.NMEM):  # the memory of such a step cannot be trusted
                mem[i] = 0.0
            return layout.NOT_FINITE
    return layout.OK


_STEP = c_function(
    "int64(CPointer(float64), int64, CPointer(float64), CPointer(float64), float64, "
    "CPointer(float64))"
)


@inline_function
def _impulse(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    used = mem[PREDICTED] if is_delayed(par, mem) else sample
    flags = impulse.step(par, mem, used, h, out)
    return finish(par, mem, sample, h, flags, out)


@_STEP
def impulse_step(par: Any, size: int, mem: Any, sample: Any, h: float, out: Any) -> int:
    """The step of method impulse, see :func:`step`."""
    return _impulse(
        vector(par, size), vector(mem, model.NMEM), vector(sample, layout.NSAMPLE), h,
        vector(out, layout.NOUT),
    )  # fmt: skip


@inline_function
def _penalty(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    used = mem[PREDICTED] if is_delayed(par, mem) else sample
    flags = penalty.step(par, mem, used, h, out)
    return finish(par, mem, sample, h, flags, out)


@_STEP
def penalty_step(par: Any, size: int, mem: Any, sample: Any, h: float, out: Any) -> int:
    """The step of method penalty, see :func:`step`."""
    return _penalty(
        vector(par, size), vector(mem, model.NMEM), vector(sample, layout.NSAMPLE), h,
        vector(out, layout.NOUT),
    )  # fmt: skip


@inline_function
def _augmented_lagrangian(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    used = mem[PREDICTED] if is_delayed(par, mem) else sample
    flags = augmented_lagrangian.step(par, mem, used, h, out)
    return finish(par, mem, sample, h, flags, out)


@_STEP
def augmented_lagrangian_step(
    par: Any, size: int, mem: Any, sample: Any, h: float, out: Any
) -> int:
    """The step of method augmented_lagrangian, see :func:`step`."""
    return _augmented_lagrangian(
        vector(par, size), vector(mem, model.NMEM), vector(sample, layout.NSAMPLE), h,
        vector(out, layout.NOUT),
    )  # fmt: skip


@inline_function
def _observe(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    used = mem[PREDICTED] if is_delayed(par, mem) else sample
    flags = observe.step(par, mem, used, h, out)
    return finish(par, mem, sample, h, flags, out)


@_STEP
def observe_step(par: Any, size: int, mem: Any, sample: Any, h: float, out: Any) -> int:
    """The step of method observe, see :func:`step`."""
    return _observe(
        vector(par, size), vector(mem, model.NMEM), vector(sample, layout.NSAMPLE), h,
        vector(out, layout.NOUT),
    )  # fmt: skip


@inline_function
def _baumgarte(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    used = mem[PREDICTED] if is_delayed(par, mem) else sample
    flags = baumgarte.step(par, mem, used, h, out)
    return finish(par, mem, sample, h, flags, out)


@_STEP
def baumgarte_step(par: Any, size: int, mem: Any, sample: Any, h: float, out: Any) -> int:
    """The step of method baumgarte, see :func:`step`."""
    return _baumgarte(
        vector(par, size), vector(mem, model.NMEM), vector(sample, layout.NSAMPLE), h,
        vector(out, layout.NOUT),
    )  # fmt: skip


STEPS: Final = {
    "impulse": impulse_step,
    "penalty": penalty_step,
    "augmented_lagrangian": augmented_lagrangian_step,
    "observe": observe_step,
    "baumgarte": baumgarte_step,
}
"""The step function of every live method."""


@inline_function
def step(handle: Any, par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Compute the wrenches for one sample.

    Args:
        handle: of the method's step function (STEPS).
        par: (TABLE + table size,) parameters. mem: (NMEM,) memory, updated (core/model.py).
        sample: (NSAMPLE,) see core/layout.py. h: s, the period for which the wrench is held.
        out: (NOUT,) wrenches, state and enums, overwritten.

    Returns the status: OK, or the reason for the zero wrench. A sample that cannot be used leaves
    the history in ``mem`` unchanged. Vectors of other lengths than stated are not detected.
    """
    return call_step(handle, par, mem, sample, h, out)
