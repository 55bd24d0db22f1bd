"""Events of the motion: event functions, their location, and the equations that hold afterwards.

A step ends at its first event, which is located by repeating the step with a shorter length, to the
last digit of time:

    rest        |s| decreases to zero in steps that shrink with it; the last 1e-8 is extrapolated
    breakaway   the traction that stick needs exceeds the friction limit
    stop        a gap closes: impact with restitution; contact ends if its reaction would pull
    lock        its position is passed, or its force exceeded
    jam         slip has no finite force: slide and spin stop at once
"""

import math
from typing import Final

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function
from cylconn_ros.core.joint_limits import Two, is_motion_imposed
from cylconn_ros.core.layout import STICK
from cylconn_ros.core.vectors import norm
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.derivatives import derivatives_at
from cylconn_ros.methods.minimal.forces import (
    Instant,
    Sides,
    instant,
    regime_from_rest,
    slip_persists,
)
from cylconn_ros.methods.minimal.one_step import ContactState, step
from cylconn_ros.methods.minimal.over_time import longest_step, set_time

# kinds of events; a row of the log holds time, kind, length, angle, restitution
RESTS: Final = 1
REVERSES: Final = 2  # rests and slips again at once
BREAKS_AWAY: Final = 3
JAMS: Final = 4
IMPACTS: Final = 5
RELEASES: Final = 6
LOCKS: Final = 7
LOG_WIDTH: Final = 5

REST_SHARE = 1e-8  # of the greatest slip rate since slip started
REST_STEP_SHARE = 0.9  # greatest step as a share of the time to rest
START_TIME = 1e-8  # s, first step from rest, after which slip has a direction
CLOSED_GAP = 1e-12  # m or rad, of a gap
LOWEST_BOUNCE = 1e-14  # m or rad; lower bounces, and those within the tolerance, are suppressed

# event functions of a step
GAPS: Final = 0  # 4: slide low, high, spin low, high; of a closed gap its reaction
BREAKAWAY: Final = 4
LOCK_AT: Final = 5
LOCK_FORCE: Final = 6
NEVENTS: Final = 7


@allocating_function
def event_functions(
    par: Array,
    joint: Array,
    t: float,
    i: Instant,
    y: Array,
    s: ContactState,
    lock_side: float,
    values: Array,
) -> int:
    """Fill ``values`` (NEVENTS,) with the event functions; returns how many are negative."""
    for k in range(2):
        x = y[coordinates.LENGTH + k]
        low = GAPS + 2 * k
        values[low] = values[low + 1] = math.inf
        if s.sides[k] == 0:
            values[low] = x - par[model.STOPS + 2 * k]
            values[low + 1] = par[model.STOPS + 2 * k + 1] - x
        elif s.sides[k] != 2:
            values[low] = 1e-12 * abs(i.total[k]) - s.sides[k] * i.reaction[k]
    values[BREAKAWAY] = i.limit * (1.0 + 1e-12) - i.traction if s.stuck else math.inf
    if s.until > -math.inf:
        values[BREAKAWAY] = math.inf
    elif s.beyond_limit:
        stuck, _, _, beyond_limit = contact_conditions(par, joint, t, y, s.locked, True)
        values[BREAKAWAY] = 1.0 if beyond_limit and stuck else -1.0
    values[LOCK_AT] = values[LOCK_FORCE] = math.inf
    if par[model.LOCK] != 0.0 and not s.locked:
        k = int(par[model.LOCK]) - 1
        if lock_side != 0.0:
            values[LOCK_AT] = lock_side * (y[coordinates.LENGTH + k] - par[model.LOCK + 1])
        if not math.isnan(par[model.LOCK + 2]):
            values[LOCK_FORCE] = par[model.LOCK + 2] - abs(i.total[k])
    count = 0
    for e in range(NEVENTS):
        if values[e] < 0.0:
            count += 1
    return count


@allocating_function
def locate_event(
    par: Array, joint: Array, t: float, y: Array, high: float, s: ContactState, slip: float,
    lock_side: float, event: int, k: Array, new: Array, system: Array, start: Array, end: Array,
) -> float:  # fmt: skip
    """The step at whose end ``event`` has just occurred, by the Illinois method and bisection."""
    low, g_low, g_high = 0.0, max(start[event], 0.0), end[event]
    for count in range(100):
        if high - low <= 2e-16 * (abs(t) + high) or g_high == 0.0:
            break
        h = 0.5 * (low + high)
        if count % 3 != 2 and g_low > 0.0:
            h = high - g_high * (high - low) / (g_high - g_low)
            if not low < h < high:
                h = 0.5 * (low + high)
        step(par, joint, t, y, h, s, slip, k, new, system)
        i = derivatives_at(par, joint, t + h, new, s.stuck, s.sides, k[k.shape[0] - 1])
        event_functions(par, joint, t + h, i, new, s, lock_side, end)
        g = end[event]
        if g < 0.0:
            high, g_high = h, g
            g_low *= 0.5
        else:
            low, g_low = h, g
            g_high *= 0.5
    return high


@allocating_function
def _limit_candidate(par: Array, y: Array, k: int, locked: bool) -> int:
    """2: locked, or motion imposed; -1, 1: in contact with that stop; 0: free."""
    if (locked and int(par[model.LOCK]) - 1 == k) or is_motion_imposed(par, k):
        return 2
    if y[coordinates.SLIDE + k] != 0.0:
        return 0
    if y[coordinates.LENGTH + k] - par[model.STOPS + 2 * k] <= CLOSED_GAP:
        return -1
    if par[model.STOPS + 2 * k + 1] - y[coordinates.LENGTH + k] <= CLOSED_GAP:
        return 1
    return 0


@allocating_function
def contact_conditions(
    par: Array, joint: Array, t: float, y: Array, locked: bool, was_stick: bool
) -> tuple[bool, Sides, Two, bool]:
    """Stick or slip, active limits, accelerations of slide and spin, and ``beyond_limit``.

    If stick exceeds the friction limit, but slip would jam as soon as it starts, it sticks as the
    limit of infinitely many jams: ``beyond_limit``.
    """
    set_time(par, joint, t)
    stuck, sides, a = _solve_contact(par, joint, t, y, locked, was_stick)
    if not model.law(par).on or stuck or y[coordinates.SLIDE] != 0.0 or y[coordinates.SPIN] != 0.0:
        return stuck, sides, a, False
    if slip_persists(par, joint, t, y, sides, a):
        return False, sides, a, False
    if not was_stick:
        stuck, sides, a = _solve_contact(par, joint, t, y, locked, True)
        if stuck:
            return True, sides, a, False
    return True, sides, (0.0, 0.0), True


@allocating_function
def _solve_contact(
    par: Array, joint: Array, t: float, y: Array, locked: bool, was_stick: bool
) -> tuple[bool, Sides, Two]:
    """Stick or slip, active limits, and accelerations of slide and spin, by case enumeration.

    A stop is active if its reaction pushes; it is not if friction alone holds the component.
    """
    c1, c2 = _limit_candidate(par, y, 0, locked), _limit_candidate(par, y, 1, locked)
    at_rest = y[coordinates.SLIDE] == 0.0 and y[coordinates.SPIN] == 0.0
    stuck, sides, a = False, (c1, c2), (0.0, 0.0)
    for choice in range(4):
        s1, s2 = (c1 if choice % 2 == 1 else 0), (c2 if choice >= 2 else 0)
        if (c1 == 2 and s1 == 0) or (c2 == 2 and s2 == 0):
            continue
        if (choice % 2 == 1 and c1 == 0) or (choice >= 2 and c2 == 0):
            continue
        sides = (s1, s2)
        stuck = False
        if at_rest:
            regime, a = regime_from_rest(par, joint, t, y, sides, was_stick)
            stuck = regime == STICK
        i = instant(par, joint, t, y, stuck, sides)
        if not at_rest:
            a = i.acceleration
        fits = True
        for k in range(2):
            c = c1 if k == 0 else c2
            if c == -1 or c == 1:
                s = sides[k]
                into_stop = a[k] * c > 0.0 if s == 0 else i.reaction[k] * c > 0.0
                fits = fits and not into_stop
        if fits:
            break
    return stuck, sides, a


@allocating_function
def log_event(log: Array, count: int, t: float, kind: int, y: Array, restitution: float) -> int:
    """Append an event to ``log`` if there is room; returns the number of events."""
    if count < log.shape[0]:
        log[count, 0], log[count, 1] = t, kind
        log[count, 2], log[count, 3], log[count, 4] = (
            y[coordinates.LENGTH],
            y[coordinates.ANGLE],
            restitution,
        )
    return count + 1


@allocating_function
def start_slip(
    par: Array, joint: Array, t: float, y: Array, a: tuple[float, float], sides: Sides, k: Array,
    left: float,
) -> float:  # fmt: skip
    """First step from rest with accelerations a, which gives slip a direction; its length, s."""
    h = min(START_TIME, left)
    y[coordinates.SLIDE], y[coordinates.SPIN] = h * a[0], h * a[1]
    derivatives_at(par, joint, t, y, False, sides, k)
    for i in range(coordinates.A_COM, y.shape[0]):
        y[i] += h * k[i]
    y[coordinates.LENGTH] += 0.5 * h * h * a[0]
    y[coordinates.ANGLE] += 0.5 * h * h * a[1]
    return h


@allocating_function
def longest_stick_step(joint: Array, y: Array, beyond_limit: bool) -> float:
    """The longest step in stick, s: a rotation of 0.1 rad, or 0.01 rad if ``beyond_limit``.

    A sine over time bounds it, too: breakaway is looked for at the end of the step.
    """
    free = joint[coordinates.MODE] == coordinates.BOTH_FREE
    w = norm(
        model.vector(y, coordinates.A_SPIN)
        if free
        else model.vector(joint, coordinates.PRESCRIBED + 10)
    )
    return min((0.01 if beyond_limit else 0.1) / w if w > 0.0 else math.inf, longest_step(joint))
