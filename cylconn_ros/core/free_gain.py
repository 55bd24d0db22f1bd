"""Gain of slide and spin where the simulator keeps the constraint and the lag is not known.

With ``constraint: simulator`` only f1 and m1 are sent. Friction that slips is a bounded force
against the slip velocity: if it acts late, it overshoots by what the lag lets it do and no more.
What brings slide or spin to rest within one period (stick, stops, locks, imposed motion) is a
feedback; if it acts n periods late, it is stable only with a share alpha of that force. A step then
leaves

    s+ = (1 - alpha) s- - alpha^2/4 x/h        x: distance from the position that is held

which is critically damped; known loads and springs are balanced in full. alpha = 1 is the step of
``constraint: connector``.

alpha follows from the motion. With the end of the last step, w+ = w_free + h A f, the force that
the period needed is f = (h A)^-1 (w - w_free). Of changes of the force, in which a constant unknown
load vanishes, the abrupt ones tell; a force that changes evenly looks the same at any lag:

    |d needed - d sent| < MATCH |d sent|       the newest wrench acts: alpha = 1
    |d needed - d sent| > MISMATCH |d sent|    it acts late: n = periods until ARRIVED of the change
                                               has been seen, alpha = 1/(1 + PERIODS_GAIN n)

Springs act on the elongation that is expected when they act, u + lag v: a spring that acts late
feeds its oscillation. Springs and dampers that are too stiff for the lag are weakened
(:func:`stable_stiffness`, :func:`stable_damping`).

alpha falls at once and rises slowly, except at the first change that tells. Before that it is 1 if
the latency is declared, else the least value.
"""

import math
from typing import Final

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function

LAG_SQUARED: Final = 0.25  # (w lag)^2 of a spring on the mass that it moves
LAG_DAMPED: Final = 0.5  # c lag / mass of a damper
MATCH: Final = 0.05
MISMATCH: Final = 0.2
ARRIVED: Final = 0.8
ABRUPT: Final = 0.5  # change of the change over the change
LEAST_CHANGE: Final = 0.1  # over the greatest force of late
ROUNDING: Final = 1e-9
GREATEST_FORGOTTEN: Final = 0.002  # share per period
RETURNED: Final = 0.5  # share of a change that must remain until it has arrived
MOST_PERIODS: Final = 16
PERIODS_GAIN: Final = 3.0
LEAST_GAIN: Final = 1.0 / (1.0 + PERIODS_GAIN * MOST_PERIODS)
UNEVEN: Final = 0.2  # of a period; a step that lasted longer or shorter does not tell
RECOVERY: Final = 1.2  # factor on alpha for a change that matches
HOLD_AFTER: Final = 4.0  # times 1/alpha periods, after which stick holds its position

# Indices from model.FREE_GAIN.
_ALPHA: Final = 0  # 0: not begun
_TOLD: Final = 1  # alpha that changes have told so far; 0: none has
_STORED: Final = 2  # what is stored, below
_FREE: Final = 3  # 2, of the last step
_A: Final = 5  # 3
_SENT: Final = 8  # 2, the force of the last step
_LAST_CHANGE: Final = 10  # 2, its change from the one before
_NEEDED: Final = 12  # 2
_PENDING: Final = 14  # 2, a change that has not been seen yet
_SEEN: Final = 16  # 2, what has been seen since
_PERIODS: Final = 18  # since that change; 0: none
_BASE: Final = 19  # 2, the force before that change
_REMAINS: Final = 21  # 2, what remains of that change
_GREATEST: Final = 23  # force of late, as a size

# Values of _STORED. The force and what was needed are zero before the first step.
_NOTHING: Final = 0.0
_FIRST: Final = 1.0
_STEPS: Final = 2.0
_LOST: Final = -1.0  # the last step does not tell what acted
_AGAIN: Final = -2.0  # the first step after that


@inline_function
def is_simulators(par: Array) -> bool:
    """Whether the simulator keeps the constraint."""
    return par[model.CONSTRAINT] != 0.0


@inline_function
def free_gain(par: Array, mem: Array) -> float:
    """The gain alpha."""
    if par[model.CONSTRAINT] == 0.0:
        return 1.0
    alpha = mem[model.FREE_GAIN + _ALPHA]
    if alpha > 0.0:
        return alpha
    return 1.0 if par[model.CONSTRAINT] == 1.0 else LEAST_GAIN


@inline_function
def lag_of(par: Array, mem: Array, h: float) -> float:
    """The lag that changes have told, s; 0 if none has."""
    if par[model.CONSTRAINT] == 0.0:
        return 0.0
    told = mem[model.FREE_GAIN + _TOLD]
    return h * (1.0 / told - 1.0) / PERIODS_GAIN if told > 0.0 else 0.0


@inline_function
def stable_stiffness(k: float, mobility: float, lag: float) -> float:
    """The stiffness k, or the greatest that a spring which acts late may have.

    mobility: inverse of the mass or the inertia that it moves.
    """
    late = mobility * lag * lag
    return k if late == 0.0 else min(k, LAG_SQUARED / late)


@inline_function
def stable_damping(c: float, mobility: float, lag: float) -> float:
    """The damping c, or the greatest that a damper which acts late may have."""
    late = mobility * lag
    return c if late == 0.0 else min(c, LAG_DAMPED / late)


@inline_function
def holds_position(mem: Array, alpha: float) -> bool:
    """Whether stick holds a position: the slip velocity has died away."""
    return mem[model.STICK_SAMPLES] * alpha > HOLD_AFTER


@inline_function
def is_stopped(par: Array, mem: Array) -> bool:
    """Whether a body in stick is at rest; with alpha < 1 only after the slip has died away."""
    alpha = free_gain(par, mem)
    return alpha == 1.0 or holds_position(mem, alpha)


@inline_function
def _size(a: tuple[float, float, float], x: float, y: float) -> float:
    """Size of a force (x, y) by the kinetic energy that it gives, from rest."""
    return math.sqrt(max(a[0] * x * x + 2.0 * a[1] * x * y + a[2] * y * y, 0.0))


@device_function
def update_gain(par: Array, mem: Array, v1: float, w1: float, h: float) -> None:
    """Compare the rates of this sample with the end of the last step and update alpha."""
    if not is_simulators(par):
        return
    at = model.FREE_GAIN
    alpha = free_gain(par, mem)
    mem[at + _ALPHA] = alpha
    stored, uneven = mem[at + _STORED], abs(mem[model.LAST_PERIOD] - h) > UNEVEN * h
    if stored == _NOTHING:
        return
    if stored == _LOST or uneven:
        mem[at + _STORED], mem[at + _PERIODS] = _LOST, 0.0
        return
    a = (mem[at + _A], mem[at + _A + 1], mem[at + _A + 2])
    det = a[0] * a[2] - a[1] * a[1]
    if not det > 0.0:  # other connectors hold a component
        mem[at + _STORED] = _LOST
        return
    d1, d2 = v1 - mem[at + _FREE], w1 - mem[at + _FREE + 1]
    needed = ((a[2] * d1 - a[1] * d2) / det, (a[0] * d2 - a[1] * d1) / det)
    seen = (needed[0] - mem[at + _NEEDED], needed[1] - mem[at + _NEEDED + 1])
    mem[at + _NEEDED], mem[at + _NEEDED + 1] = needed
    sent = (mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1])
    change = (sent[0] - mem[at + _SENT], sent[1] - mem[at + _SENT + 1])
    last = (mem[at + _LAST_CHANGE], mem[at + _LAST_CHANGE + 1])
    mem[at + _SENT], mem[at + _SENT + 1] = sent
    mem[at + _LAST_CHANGE], mem[at + _LAST_CHANGE + 1] = change
    if stored == _AGAIN:
        mem[at + _LAST_CHANGE], mem[at + _LAST_CHANGE + 1] = 0.0, 0.0
        return
    # a change that is rounding beside the force that would end the motion tells nothing
    least = ROUNDING * _size(a, (a[2] * v1 - a[1] * w1) / det, (a[0] * w1 - a[1] * v1) / det)
    force = max(_size(a, sent[0], sent[1]), least)
    mem[at + _ALPHA] = _learnt(mem, alpha, a, change, last, seen, force)


@inline_function
def _learnt(
    mem: Array, alpha: float, a: tuple[float, float, float], change: tuple[float, float],
    last: tuple[float, float], seen: tuple[float, float], force: float,
) -> float:  # fmt: skip
    """The gain after a period in which the force needed has changed by ``seen``."""
    at = model.FREE_GAIN
    told, known = mem[at + _TOLD], mem[at + _TOLD] > 0.0
    greatest = max((1.0 - GREATEST_FORGOTTEN) * mem[at + _GREATEST], force)
    mem[at + _GREATEST] = greatest
    if mem[at + _PERIODS] > 0.0:  # a change is under way
        mem[at + _PERIODS] += 1.0
        mem[at + _SEEN] += seen[0]
        mem[at + _SEEN + 1] += seen[1]
        n = mem[at + _PERIODS]
        reached = max(1.0 / (1.0 + PERIODS_GAIN * (n - 1.0)), LEAST_GAIN)
        if _along(a, mem, at + _SEEN, at + _PENDING) >= ARRIVED or n > MOST_PERIODS:
            mem[at + _PERIODS] = 0.0
            mem[at + _TOLD] = min(reached, RECOVERY * told) if known else reached
            return mem[at + _TOLD]
        mem[at + _REMAINS] = mem[at + _SENT] - mem[at + _BASE]
        mem[at + _REMAINS + 1] = mem[at + _SENT + 1] - mem[at + _BASE + 1]
        if _along(a, mem, at + _REMAINS, at + _PENDING) < RETURNED:  # it cannot tell any more
            mem[at + _PERIODS] = 0.0
            return told if known else alpha
        return min(alpha, reached)
    size = _size(a, change[0], change[1])
    abrupt = _size(a, change[0] - last[0], change[1] - last[1]) > ABRUPT * size
    if not (abrupt and size > LEAST_CHANGE * greatest):
        return alpha
    apart = _size(a, seen[0] - change[0], seen[1] - change[1])
    if apart < MATCH * size:
        mem[at + _TOLD] = min(RECOVERY * told, 1.0) if known else 1.0
        return mem[at + _TOLD]
    if apart > MISMATCH * size:
        for k in range(2):
            mem[at + _PENDING + k], mem[at + _SEEN + k] = change[k], seen[k]
            mem[at + _BASE + k] = mem[at + _SENT + k] - change[k]
        mem[at + _PERIODS] = 1.0
    return alpha


@inline_function
def _along(a: tuple[float, float, float], mem: Array, x: int, y: int) -> float:
    """Component of a force along another, as a share of that."""
    x1, x2, y1, y2 = mem[x], mem[x + 1], mem[y], mem[y + 1]
    both = a[0] * x1 * y1 + a[1] * (x1 * y2 + x2 * y1) + a[2] * x2 * y2
    own = a[0] * y1 * y1 + 2.0 * a[1] * y1 * y2 + a[2] * y2 * y2
    return both / own if own > 0.0 else 1.0


@inline_function
def store_step(
    par: Array, mem: Array, free: tuple[float, float], a: tuple[float, float, float], limited: bool
) -> None:
    """Store w_free and h A of this step for the comparison at the next sample.

    ``limited``: the wrench sent is not the one computed.
    """
    if is_simulators(par):
        at = model.FREE_GAIN
        stored = mem[at + _STORED]
        if limited:
            mem[at + _STORED] = _LOST
        elif stored == _LOST:
            mem[at + _STORED] = _AGAIN
        else:
            mem[at + _STORED] = _FIRST if stored == _NOTHING else _STEPS
        mem[at + _FREE], mem[at + _FREE + 1] = free
        mem[at + _A], mem[at + _A + 1], mem[at + _A + 2] = a
