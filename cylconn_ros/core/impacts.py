"""Motion of a component towards a stop and after it, under constant acceleration.

With the gap g of a stop, its rate w (negative: approaching) and the acceleration a1 under all but
the stop, the stop is reached after T, the root of g + w T + a1 T^2/2 = 0 at which the gap falls, at
the rate w_T = w + a1 T. The component leaves it at -eps w_T and moves on under a2; if a2 < 0 it
returns, and the series of its bounces is summed in closed form (:func:`bounced`). A return that the
next step can begin is part of its ideal motion, so that hops shorter than a step are followed.

One wrench is held over each period, so that an impulse at T is divided over two steps, with its
first moment: shares 3/2 - T/h and T/h - 1/2, for T/h in [1/2, 3/2). Equivalently, with gap x2 and
rate w2 of the ideal motion after two steps, the first ends at

    w1 = (x2 - g)/h - (w + w2)/2        exact plant
    w1 = (x2 - g)/h - w2                semi-implicit plant, T/h in [0, 1)

and the second at w2. The free motion of a semi-implicit plant lies on the parabola with the rate
w + a h/2 in place of w.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core.jit import inline_function

Two = tuple[float, float]
LEAST_HOP: Final = 0.01  # periods; a shorter hop is not followed, for a restitution near 1


class Contact(NamedTuple):
    """When a stop is reached (s; infinite: never), and the rate of the gap then."""

    time: float
    rate: float


@inline_function
def reached(gap: float, w: float, a: float, h: float, explicit: bool) -> Contact:
    """The time at which the gap closes under the acceleration a."""
    w = w + 0.5 * h * a if explicit else w
    if gap <= 0.0 and w < 0.0:
        return Contact(0.0, w)
    square = w * w - 2.0 * a * gap
    if square < 0.0 or (a >= 0.0 and w >= 0.0):
        return Contact(math.inf, 0.0)
    fall = math.sqrt(square)
    if w < 0.0:
        return Contact(2.0 * gap / (fall - w), -fall)
    return Contact((w + fall) / -a, -fall)


@inline_function
def earliest(h: float, explicit: bool) -> float:
    """The earliest impact that two held wrenches can reproduce."""
    return 0.0 if explicit else 0.5 * h


@inline_function
def latest(h: float, explicit: bool) -> float:
    """An impact that is later than this begins in a later step."""
    return h if explicit else 1.5 * h


@inline_function
def closes(rebound: float, a: float, eps: float, h: float) -> bool:
    """Whether the series of bounces that begins with the rate ``rebound`` ends within a step."""
    if a > 0.0:
        return False
    if rebound == 0.0:
        return True
    hop = -a * h
    return 2.0 * rebound < max(1.0 - eps, LEAST_HOP if eps > 1.0 - LEAST_HOP else 0.0) * hop


@inline_function
def bounces(rebound: float, a: float, eps: float, t: float) -> int:
    """Number of returns to the stop within t after leaving it at ``rebound``; -1: it rests then."""
    if a >= 0.0:
        return 0
    if rebound <= 0.0:
        return -1
    hop = 2.0 * rebound / -a
    if t < hop:
        return 0
    if eps == 1.0:
        return int(t / hop)
    left = 1.0 - t * (1.0 - eps) / hop
    if eps == 0.0 or left <= 0.0:
        return -1
    return int(math.log(left) / math.log(eps))


@inline_function
def bounced(rebound: float, a: float, eps: float, t: float, until: float) -> Two:
    """Gap and its rate a time t after leaving the stop at ``rebound`` >= 0, acceleration a.

    Returns to the stop later than ``until`` are left to a later step.
    """
    n = bounces(rebound, a, eps, until)
    if n < 0:
        return 0.0, 0.0
    share, begun = 1.0, 0.0
    if n > 0:
        share = eps**n
        begun = 2.0 * rebound / -a * (n if eps == 1.0 else (1.0 - share) / (1.0 - eps))
    since, rate = t - begun, share * rebound
    return rate * since + 0.5 * a * since * since, rate + a * since


@inline_function
def ideal_end(rebound: float, a: float, eps: float, t: float, h: float, explicit: bool) -> Two:
    """Gap and rate of the ideal motion two steps after a sample, a time t after the impact.

    Only what the first of the two steps can begin is included.
    """
    until = t - 2.0 * h + latest(h, explicit)
    x, w = bounced(rebound, a, eps, t, until)
    if explicit and (x != 0.0 or w != 0.0):  # the rate of the plant, not of its parabola
        return x, w - 0.5 * h * a
    return x, w


@inline_function
def first_rate(gap: float, w: float, end: Two, h: float, explicit: bool) -> float:
    """Rate at the end of an impact's first step, for the ideal motion's end of the second."""
    rise = (end[0] - gap) / h
    return rise - end[1] if explicit else rise - 0.5 * (w + end[1])


@inline_function
def bounded_gap(w: float, a: float, time: float, h: float, explicit: bool) -> Two:
    """The gap that closes after ``time``, and its rate then, of an impact that was put off."""
    w = w + 0.5 * h * a if explicit else w
    return -(w * time + 0.5 * a * time * time), w + a * time
