"""Latency in use and the gain of the feedback for it, as stored in the memory.

The gain alpha of the feedback on constraint errors and held positions is 1 if the time of action is
known. It is smaller if the wrenches act at uncertain times (core/latency_estimation.py). With the
error e and its rate w at the time of action, the rate at the end of a step is

    w+ = (1 - alpha)^2 w- - alpha^2 e/h

on a semi-implicit plant, and alpha^2 w-/2 less on an exact one: both eigenvalues of the error are
1 - alpha, and alpha = 1 removes an error in the fewest steps.
"""

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function


@inline_function
def is_measured(par: Array, mem: Array) -> bool:
    """Whether the latency in use is the measured one: ``latency: -1``, or a declared one refuted.

    With known inertia.
    """
    return par[model.LATENCY] == model.MEASURED or mem[model.REFUTED] != 0.0


@inline_function
def is_checked(par: Array) -> bool:
    """Whether the measured latency may refute the declared one."""
    return par[model.LATENCY_CHECKED] != 0.0


@inline_function
def may_be_delayed(par: Array, mem: Array) -> bool:
    """Whether the sent wrenches are stored."""
    return par[model.LATENCY] > 0.0 or is_measured(par, mem) or is_checked(par)


@inline_function
def is_delayed(par: Array, mem: Array) -> bool:
    """Whether wrenches act later than their sample, as given or as measured."""
    if is_measured(par, mem):
        return mem[model.DELAYED] != 0.0
    return par[model.LATENCY] > 0.0


@inline_function
def adapts_gains(par: Array, mem: Array) -> bool:
    """Whether elastic constraints follow from the energy: unknown inertia, or no latency."""
    return par[model.LATENCY] == model.ADAPTED or not is_delayed(par, mem)


@inline_function
def latency_of(par: Array, mem: Array) -> float:
    """The latency in periods: as given, or as estimated so far."""
    if is_measured(par, mem):
        return mem[model.MEASURED_LATENCY]
    return max(par[model.LATENCY], 0.0)


@inline_function
def feedback_gain(par: Array, mem: Array) -> float:
    """The gain alpha of the feedback, 0 to 1."""
    if not is_measured(par, mem) or mem[model.FEEDBACK_GAIN] == 0.0:
        return 1.0
    return mem[model.FEEDBACK_GAIN]


@inline_function
def correction_share(par: Array, mem: Array) -> float:
    """Share of a position error that one wrench removes."""
    alpha = feedback_gain(par, mem)
    if not is_delayed(par, mem):
        return alpha * alpha
    return alpha * alpha / (1.0 + latency_of(par, mem) * mem[model.PERIOD_VARIATION])


@inline_function
def rate_share(par: Array, mem: Array, explicit: bool) -> float:
    """Share of a rate that one wrench removes beside its whole: w+ = -rate_share w- + ..."""
    alpha = feedback_gain(par, mem)
    kept = (1.0 - alpha) * (1.0 - alpha)
    return (0.0 if explicit else 0.5 * alpha * alpha) - kept


@inline_function
def reliable_restitution(par: Array, mem: Array) -> float:
    """Restitution of the stops; less where an impact's wrench acts at an uncertain time."""
    share = min(max((feedback_gain(par, mem) - 0.5) / 0.3, 0.0), 1.0)
    return par[model.STOPS + 4] * share
