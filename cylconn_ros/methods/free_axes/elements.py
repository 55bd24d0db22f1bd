"""Tables of springs and dampers, and compliant stops, in a solved step (core/elements.py).

Their force depends on the rate at the end of the step, which friction and the reactions of rigid
stops, locks and drives decide too. The step is solved with the force linearised about a rate, the
one at the start first, and solved again about the rate found until the linearised force is the
force itself: at once where the path of the step lies on one piece of every table.
"""

from typing import Final

from cylconn_ros.core import elements, model
from cylconn_ros.core.elements import ElementForces, elements_over_step
from cylconn_ros.core.free_gain import lag_of, stable_damping, stable_stiffness
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import Two
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.methods.free_axes.complementarity import ReducedStep

SETTLED: Final = 1e-14  # of the terms of the force
MOST_SOLUTIONS: Final = 40
LATER: Final = 4.0 / 3.0  # a force that grows as it enters a stop tells a lag that is too short:
#                           measured 2, 4 and 9 periods for 2.5, 5 and 12
HALVED_AFTER: Final = 12  # solutions after which a step goes half the way, against cycles


@inline_function
def has_any_element(par: Array) -> bool:
    """Whether slide or spin has a table or a compliant stop."""
    return par[model.ELEMENTS] != 0.0 or par[model.ELEMENTS + 1] != 0.0


@inline_function
def linearise_about(mem: Array, end: Two, share: float) -> None:
    """Move the rates about which the elements are linearised to ``end``, by a share of the way."""
    for k in range(2):
        at = model.END_RATES + k
        mem[at] = end[k] if share == 1.0 else mem[at] + share * (end[k] - mem[at])


@device_function
def _over_step(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, h: float, k: int, end: float
) -> ElementForces:
    """Forces of the elements of component k for the rate ``end`` at the end of the step.

    Forces that act late are those of the position expected then, and weakened as linear springs
    and dampers are (core/free_gain.py).
    """
    x, w = (o.length, o.twist.v[0]) if k == 0 else (o.angle, o.twist.w[0])
    if par[model.ELEMENTS + k] == 0.0:
        return ElementForces(0.0, 0.0, 0.0, 0, 0.0)
    lag, rest = LATER * lag_of(par, mem, h), model.REFERENCE + 2 + k
    u = x - model.value_or(par[rest], mem[model.LENGTH0 + k])
    if lag > 0.0:
        u, x = u + lag * w, x + lag * w
    semi_implicit = model.output(par).semi_implicit
    f = elements_over_step(par, model.ELEMENTS, k, u, x, w, end, h, semi_implicit)
    if lag == 0.0:
        return f
    at = model.ELEMENTS + elements.first_of(k) + elements.STEEPEST
    mobility = (r.a[0] if k == 0 else r.a[2]) / h
    stiff, damp = par[at], par[at + 1]
    soft = stable_stiffness(stiff, mobility, lag) / stiff if stiff > 0.0 else 1.0
    slow = stable_damping(damp, mobility, lag) / damp if damp > 0.0 else 1.0
    both = min(soft, slow)
    return ElementForces(soft * f.spring, slow * f.damper, both * f.stop, f.side, both * f.slope)


@device_function
def elements_of(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, h: float, k: int
) -> ElementForces:
    """Forces of the elements of component k for the rates of :func:`linearise_about`."""
    return _over_step(par, mem, o, r, h, k, mem[model.END_RATES + k])


@device_function
def add_elements(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, h: float
) -> tuple[Two, Two]:
    """(push, E) of slide and of spin: the force of their elements is push - E w+."""
    one, two = elements_of(par, mem, o, r, h, 0), elements_of(par, mem, o, r, h, 1)
    return (
        (_total(one) + one.slope * mem[model.END_RATES], one.slope),
        (_total(two) + two.slope * mem[model.END_RATES + 1], two.slope),
    )


@inline_function
def _total(f: ElementForces) -> float:
    return f.spring + f.damper + f.stop


@device_function
def are_settled(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, h: float, end: Two, others: Two
) -> bool:
    """Whether the linearised forces are those of the rates ``end`` that the step has found.

    ``others``: sizes of friction and reactions, whose rounding the rates have.
    """
    for k in range(2):
        at = mem[model.END_RATES + k]
        here, there = _over_step(par, mem, o, r, h, k, at), _over_step(par, mem, o, r, h, k, end[k])
        change = -here.slope * (end[k] - at)
        size = abs(there.spring) + abs(there.damper) + abs(there.stop) + others[k]
        size += max(here.slope, there.slope) * (abs(at) + abs(end[k]))
        if there.spring != 0.0 or there.stop != 0.0:  # rounding of the position
            stiff = par[model.ELEMENTS + elements.first_of(k) + elements.STEEPEST]
            x = o.length if k == 0 else o.angle
            rest = model.value_or(par[model.REFERENCE + 2 + k], mem[model.LENGTH0 + k])
            size += stiff * (abs(x) + abs(rest))
        if abs(_total(there) - _total(here) - change) > SETTLED * size:
            return False
    return True
