"""Integration from event to event: the loop over steps, and what each event does to the state."""

import math
from typing import Final, NamedTuple

import numpy as np

from cylconn_ros.core import model
from cylconn_ros.core.bounds import Two
from cylconn_ros.core.compiled import entry_that_allocates, jit
from cylconn_ros.core.friction import Array
from cylconn_ros.methods import minimal_motion as motion
from cylconn_ros.methods import minimal_place as at
from cylconn_ros.methods.minimal_impacts import bring_to_rest, impact
from cylconn_ros.methods.minimal_motion import located, note, nudged, settled, slowest, watch
from cylconn_ros.methods.minimal_rates import SLIPPED, rates_at, size_of
from cylconn_ros.methods.minimal_steps import State, ahead, step
from cylconn_ros.methods.minimal_tableau import STAGES

# A step of h strains the explicit method where h times the stiffness is beyond its stability.
STRAINED: Final = 3.0
PATIENCE: Final = 5  # strained steps in a row before it gives way to the implicit one
RELAXED: Final = 1.5  # and when it comes back


class Ran(NamedTuple):
    """How an integration went."""

    t: float
    state: State
    events: int
    evaluations: int
    complete: bool  # False: too many steps


@jit
def begun(
    par: Array, joint: Array, t: float, y: Array, k: Array, locked: bool, was_stick: bool,
    left: float,
) -> tuple[float, State]:  # fmt: skip
    """Find the equations that hold from t on; from rest into slip, make its first instant."""
    stuck, sides, a = settled(par, joint, t, y, locked, was_stick)
    taken = 0.0
    friction = model.law(par).on
    if friction and not stuck and y[at.SLIDE] == 0.0 and y[at.SPIN] == 0.0:
        taken = nudged(par, joint, t, y, a, sides, k, left)
    return taken, State(stuck, sides, locked, False)


@jit
def _passing(par: Array, y: Array, locked: bool) -> float:
    """The side from which the locking component nears the lock's position; 0: it does not."""
    if par[model.LOCK] == 0.0 or locked or math.isnan(par[model.LOCK + 1]):
        return 0.0
    away = y[at.LENGTH + int(par[model.LOCK]) - 1] - par[model.LOCK + 1]
    return 1.0 if away > 0.0 else (-1.0 if away < 0.0 else 0.0)


@jit
def _struck(
    par: Array, joint: Array, t: float, y: Array, event: int, s: State, a: Two
) -> tuple[bool, int, float]:
    """Do what an event does: whether it is locked now, the kind of event, its restitution.

    ``a``: the accelerations of slide and spin, which tell how high a bounce would be.
    """
    n = size_of(joint)
    if event == motion.STICKS:
        return s.locked, motion.BREAKS_AWAY, 0.0
    if event == motion.LOCK_AT or event == motion.LOCK_FORCE:
        k = int(par[model.LOCK]) - 1
        if event == motion.LOCK_AT:
            y[at.LENGTH + k] = par[model.LOCK + 1]
        sides = (2, s.sides[1]) if k == 0 else (s.sides[0], 2)
        bring_to_rest(par, joint, t, y, n, sides)
        return True, motion.LOCKS, 0.0
    k = (event - motion.GAPS) // 2
    if s.sides[k] != 0:
        return s.locked, motion.RELEASES, 0.0
    y[at.LENGTH + k] = par[model.STOPS + event - motion.GAPS]
    eps, v = par[model.STOPS + 4], y[at.SLIDE + k]
    if v * a[k] > 0.0 and (eps * v) ** 2 < 2.0 * motion.LOW * abs(a[k]):
        eps = 0.0
    return s.locked, motion.IMPACTS, impact(par, joint, t, y, n, k, eps, s.sides)


@jit
def _longest(
    par: Array, joint: Array, i: motion.Instant, y: Array, s: State, slowing: float
) -> float:
    """The longest step that the state allows."""
    if s.stuck:
        return slowest(joint, i)
    longest = math.inf
    if slowing > 0.0:
        longest = motion.SHARE * i.slip / slowing
    for k in range(2):  # off a stop: not over the turning point, or it would seem to have stayed
        low = y[at.LENGTH + k] - par[model.STOPS + 2 * k]
        high = par[model.STOPS + 2 * k + 1] - y[at.LENGTH + k]
        v, a = y[at.SLIDE + k], i.acceleration[k]
        if s.sides[k] == 0 and (low == 0.0 or high == 0.0) and v * a < 0.0:
            longest = min(longest, 0.95 * abs(v / a))
    return longest


@jit
def _rest(
    par: Array, joint: Array, t: float, y: Array, k: Array, i: motion.Instant, slowing: float
) -> float:
    """Along a straight line to rest; the time it takes."""
    h = i.slip / slowing
    y[at.LENGTH] += 0.5 * h * y[at.SLIDE]
    y[at.ANGLE] += 0.5 * h * y[at.SPIN]
    y[at.SLIDE] = y[at.SPIN] = 0.0
    for j in range(at.A_COM, y.shape[0]):
        y[j] += h * k[j]
    y[size_of(joint) + SLIPPED] -= 0.5 * h * i.slip
    return h


@jit
def _slowing(par: Array, i: motion.Instant, y: Array) -> float:
    """-d|s|/dt of friction's slip velocity; 0 where there is no friction."""
    law = model.law(par)
    if not law.on or i.slip == 0.0:
        return 0.0
    turning = law.radius * law.radius * y[at.SPIN] * i.acceleration[1]
    return -(y[at.SLIDE] * i.acceleration[0] + turning) / i.slip


@jit
def _first_event(
    par: Array, joint: Array, t: float, y: Array, h: float, s: State, slip: float, passing: float,
    k: Array, new: Array, system: Array, before: Array, seen: Array,
) -> tuple[int, float]:  # fmt: skip
    """Of the events that have happened after h, the first, and when; ``new`` is brought there."""
    event, least, ended = 0, math.inf, seen.copy()
    for c in range(motion.WATCHED):
        if ended[c] < 0.0:
            seen[c] = ended[c]
            taken = located(
                par, joint, t, y, h, s, slip, passing, c, k, new, system, before, seen
            )  # fmt: skip
            if taken < least:
                event, least = c, taken
    step(par, joint, t, y, least, s, slip, k, new, system)
    return event, least


@entry_that_allocates
def integrate(
    par: Array, joint: Array, y: Array, t: float, end: float, tolerance: float, first: float,
    locked: bool, was_stick: bool, log: Array, count: int, most: int,
) -> Ran:  # fmt: skip
    """Advance ``y``, in place, from t to ``end``.

    Args:
        par, joint, y: the scene, what the coordinates are counted from, coordinates and integrals.
        tolerance: of a step, relative and a tenth of it absolute (SI units).
        first: the first step to try, s. locked: whether the lock has closed.
        was_stick: whether it sticks up to t, which decides between several solutions.
        log: (events, 5) for events, ``count`` of which are in it. most: steps to take at most.
    """
    k, system = np.zeros((STAGES + 1, y.shape[0])), np.zeros((6, 7))
    new, seen, before = np.zeros(y.shape[0]), np.zeros(motion.WATCHED), np.zeros(motion.WATCHED)
    taken, s = begun(par, joint, t, y, k[0], locked, was_stick, end - t)
    t += taken
    i = rates_at(par, joint, t, y, s.stuck, s.sides, k[0])
    h, trend, greatest, strained, evaluations = first, (0.0, 0.0), 0.0, 0, 0
    rest = max(motion.REST, 0.01 * math.sqrt(tolerance))
    for _ in range(most):
        if not t < end:
            return Ran(t, s, count, evaluations, True)
        slowing = _slowing(par, i, y)
        greatest = max(greatest, i.slip)
        kind, restitution, locks = 0, 0.0, s.locked
        near = slowing > 0.0 and i.slip <= rest * greatest
        if i.jammed:
            kind = motion.JAMS
        elif near and i.slip < slowing * (end - t):
            t += _rest(par, joint, t, y, k[0], i, slowing)
            kind = motion.RESTS
        else:
            passing = _passing(par, y, s.locked)
            watch(par, i, y, s, passing, before)
            longest = min(_longest(par, joint, i, y, s, slowing), end - t)
            h = longest if s.stuck else min(h, longest)
            slip, strain = i.slip, i.stiffness
            tried = ahead(par, joint, t, y, h, s, slip, tolerance, trend, k, new, system)
            h = tried.h
            evaluations += tried.evaluations
            if h == 0.0 and s.stiff:  # did not converge: go on explicitly
                s = State(s.stuck, s.sides, s.locked, False)
                h, strained = 3.0 / strain, -100
                continue
            if h == 0.0:
                kind = motion.JAMS
            else:
                i = rates_at(par, joint, t + h, new, s.stuck, s.sides, k[STAGES])
                event, last = -1, h >= end - t
                if watch(par, i, new, s, passing, seen) > 0:
                    event, h = _first_event(
                        par, joint, t, y, h, s, slip, passing, k, new, system, before, seen
                    )
                    last = False
                y[:] = new
                k[0] = k[STAGES]
                t = end if last else t + h
                strained = strained + 1 if strain * h > STRAINED else min(strained, 0)
                if s.stiff != (strained >= PATIENCE if not s.stiff else strain * h > RELAXED):
                    s = State(s.stuck, s.sides, s.locked, not s.stiff)
                h, trend = tried.next, (h, tried.error)
                if event >= 0:
                    locks, kind, restitution = _struck(par, joint, t, y, event, s, i.acceleration)
        if kind != 0:
            if kind == motion.JAMS:
                bring_to_rest(par, joint, t, y, size_of(joint), (2, 2))
            taken, s = begun(par, joint, t, y, k[0], locks, kind == motion.BREAKS_AWAY, end - t)
            if kind == motion.RESTS and not s.stuck:
                kind = motion.REVERSES
            count = note(log, count, t, kind, y, restitution)
            t += taken
            h, trend, greatest = (10.0 * taken if taken > 0.0 else h), (0.0, 0.0), 0.0
            strained = 0
            i = rates_at(par, joint, t, y, s.stuck, s.sides, k[0])
    return Ran(t, s, count, evaluations, False)
