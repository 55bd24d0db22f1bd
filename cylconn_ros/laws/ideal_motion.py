"""Ideal motion of a component that hits a stop, bounce by bounce, for many samples at once.

The gap falls under the acceleration a1 of everything but the stop, closes after T at the rate w_T,
leaves at -eps w_T and moves on under a2. If a2 < 0 it returns; each return is followed in turn, up
to ``until``, the latest that the present step can begin. The series of bounces ends after
hop / (1 - eps), with hop = -2 eps w_T / a2: then the component rests.

A semi-implicit plant moves on the parabola whose rate is w + a h/2.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws.parameters import Bools, Rows

Array = NDArray[np.float64]
MOST_BOUNCES = 3000
LEAST_HOP = 0.01  # periods; a hop that is shorter from the beginning is not followed
UNDECIDED = 1e-9  # periods, or relative: a margin below which rounding decides


@dataclasses.dataclass
class Fall(Rows):
    """When gaps close, (n,) each."""

    time: Array  # s; infinite: never
    rate: Array  # of the gap then
    rate_size: Array
    undecided: Bools  # whether the gap closes at all


@dataclasses.dataclass
class Flight(Rows):
    """The motion a time after an impact, (n,) each."""

    gap: Array
    rate: Array
    size: Array  # of the rate
    count: Array  # returns to the stop; -1: at rest
    undecided: Bools


def fall(gap: Array, w: Array, a: Array, h: Array, explicit: Bools, sizes: list[Array]) -> Fall:
    """When gaps with the rate w close under the acceleration a.

    sizes: (n,) of the gap, of its rate and of its change by acceleration in a step.
    """
    gap_size, w_size, change_size = sizes
    w = np.where(explicit, w + 0.5 * h * a, w)
    w_size = w_size + np.where(explicit, change_size, 0.0)
    square = w * w - 2.0 * a * gap
    square_size = 2.0 * np.abs(w) * w_size + 2.0 * np.abs(a) * gap_size
    square_size += 2.0 * change_size / h * np.abs(gap)
    never = (square < 0.0) | ((a >= 0.0) & (w >= 0.0))
    at_once = (gap <= 0.0) & (w < 0.0)
    speed = np.sqrt(np.maximum(square, 0.0))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # both forms of the root of gap + w t + a t^2/2 at which the gap falls
        time = np.where(w < 0.0, 2.0 * gap / (speed - w), -(w + speed) / a)
        speed_size = np.where(square > 0.0, square_size / (2.0 * speed), 0.0) + w_size
    undecided = ~at_once & (np.abs(square) <= 1e-12 * square_size)
    time = np.where(at_once, 0.0, np.where(never, np.inf, time))
    rate = np.where(at_once, w, np.where(never, 0.0, -speed))
    return Fall(time, rate, np.where(at_once, w_size, speed_size), undecided)


def latest(h: Array, explicit: Bools) -> Array:
    """(n,) time up to which an impact begins in the present step."""
    return np.where(explicit, h, 1.5 * h)


def ends_within_a_step(rebound: Array, a: Array, eps: Array, h: Array) -> tuple[Bools, Bools]:
    """(n,) whether the bounces after ``rebound`` end within a step; whether rounding decides."""
    hop = 2.0 * rebound  # times -a
    share = np.where(eps > 1.0 - LEAST_HOP, np.maximum(1.0 - eps, LEAST_HOP), 1.0 - eps)
    whole = share * -a * h
    ends = (a <= 0.0) & ((rebound == 0.0) | (hop < whole))
    near = (rebound > 0.0) & (np.abs(hop - whole) <= UNDECIDED * (hop + np.abs(whole)))
    return np.asarray(ends), np.asarray(near)


def flight(
    rebound: Array, a: Array, eps: Array, t: Array, until: Array, size: Array, h: Array
) -> Flight:
    """Gap and rate a time t after leaving a stop at ``rebound``; returns up to ``until``.

    size: (n,) of the rebound and of the change of the rate in the time.
    """
    falls = a < 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        hop = np.where(falls, 2.0 * rebound / -a, np.inf)
        series = np.where(eps < 1.0, hop / (1.0 - eps), np.inf)
    rests = falls & ((rebound <= 0.0) | (series <= until) | ((eps == 0.0) & (hop <= until)))
    rate, begun, count = rebound.copy(), np.zeros_like(t), np.zeros_like(t)
    undecided = falls & (rebound > 0.0) & (np.abs(series - until) <= UNDECIDED * h)
    moving = falls & ~rests
    for _ in range(MOST_BOUNCES):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            back = begun + np.where(moving, 2.0 * rate / -a, np.inf)
        undecided |= moving & (np.abs(back - until) <= UNDECIDED * h)
        moving = moving & (back <= until)
        if not moving.any():
            break
        begun = np.where(moving, back, begun)
        rate = np.where(moving, eps * rate, rate)
        count += moving
    undecided |= moving
    since = t - begun
    return Flight(
        np.where(rests, 0.0, rate * since + 0.5 * a * since * since),
        np.where(rests, 0.0, rate + a * since),
        np.where(rests, 0.0, size * (1.0 + since / h)),
        np.where(rests, -1.0, count),
        np.asarray(undecided),
    )


def end_of_two_steps(
    rebound: Array, a: Array, eps: Array, t: Array, h: Array, explicit: Bools, size: Array
) -> Flight:
    """The motion t after an impact, two steps after a sample; its rate is the plant's."""
    found = flight(rebound, a, eps, t, t - 2.0 * h + latest(h, explicit), size, h)
    moves = explicit & ((found.gap != 0.0) | (found.rate != 0.0))
    return dataclasses.replace(found, rate=found.rate - np.where(moves, 0.5 * h * a, 0.0))


def first_target(gap: Array, w: Array, end: Flight, h: Array, explicit: Bools) -> Array:
    """(n,) rate after the first of two steps that lead to ``end`` with a held wrench each."""
    mean = (end.gap - gap) / h  # sum of the mean rates of both steps
    return np.where(explicit, mean - end.rate, mean - 0.5 * (w + end.rate))
