"""What can happen on the way of the coordinates, when, and which equations hold from then on.

Steps end where something happens, found on the step itself at a shorter length, to the last digit
of time:

    rest        |s| runs to zero along steps that shrink with it; the last 1e-8 is a straight line
    breakaway   what stick needs exceeds what it may
    stop        a gap closes: impact with restitution; contact ends when its reaction would pull
    lock        its position is passed, or its force exceeded
    jam         no finite force lets it slide on: slide and spin stop at once
"""

import math
from typing import Final

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.joint_limits import Two, imposed
from cylconn_ros.core.layout import STICK
from cylconn_ros.core.vectors import norm
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.derivatives import rates_at
from cylconn_ros.methods.minimal.forces import Instant, Sides, carries_on, from_rest, instant
from cylconn_ros.methods.minimal.one_step import State, step

# kinds of events; a row of the log: time, kind, length, angle, restitution
RESTS: Final = 1
REVERSES: Final = 2  # rests and moves on at once
BREAKS_AWAY: Final = 3
JAMS: Final = 4
IMPACTS: Final = 5
RELEASES: Final = 6
LOCKS: Final = 7
LOG: Final = 5

REST = 1e-8  # of the greatest slip rate since it began
SHARE = 0.9  # of the time to rest that a step may take
NUDGE = 1e-8  # s, from rest to a slip that has a direction
CLOSED = 1e-12  # m or rad, of a gap
LOW = 1e-14  # m or rad: a bounce as low is none, nor is one within the tolerance

# events that are watched within a step
GAPS: Final = 0  # 4: slide low, high, spin low, high; of a closed one its reaction
STICKS: Final = 4
LOCK_AT: Final = 5
LOCK_FORCE: Final = 6
WATCHED: Final = 7


@device_function
def watch(
    par: Array, joint: Array, t: float, i: Instant, y: Array, s: State, passing: float, seen: Array
) -> int:
    """Fill ``seen``: each event's function, negative once it has happened; how many have."""
    for k in range(2):
        x = y[at.LENGTH + k]
        low = GAPS + 2 * k
        seen[low] = seen[low + 1] = math.inf
        if s.sides[k] == 0:
            seen[low] = x - par[model.STOPS + 2 * k]
            seen[low + 1] = par[model.STOPS + 2 * k + 1] - x
        elif s.sides[k] != 2:
            seen[low] = 1e-12 * abs(i.total[k]) - s.sides[k] * i.reaction[k]
    seen[STICKS] = i.limit * (1.0 + 1e-12) - i.traction if s.stuck else math.inf
    if s.until > -math.inf:
        seen[STICKS] = math.inf
    elif s.held:
        stuck, _, _, held = settled(par, joint, t, y, s.locked, True)
        seen[STICKS] = 1.0 if held and stuck else -1.0
    seen[LOCK_AT] = seen[LOCK_FORCE] = math.inf
    if par[model.LOCK] != 0.0 and not s.locked:
        k = int(par[model.LOCK]) - 1
        if passing != 0.0:
            seen[LOCK_AT] = passing * (y[at.LENGTH + k] - par[model.LOCK + 1])
        if not math.isnan(par[model.LOCK + 2]):
            seen[LOCK_FORCE] = par[model.LOCK + 2] - abs(i.total[k])
    count = 0
    for e in range(WATCHED):
        if seen[e] < 0.0:
            count += 1
    return count


@device_function
def located(
    par: Array, joint: Array, t: float, y: Array, high: float, s: State, slip: float,
    passing: float, event: int, k: Array, new: Array, system: Array, start: Array, end: Array,
) -> float:  # fmt: skip
    """The step at whose end ``event`` has just happened, by Illinois' method and halving."""
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
        i = rates_at(par, joint, t + h, new, s.stuck, s.sides, k[k.shape[0] - 1])
        watch(par, joint, t + h, i, new, s, passing, end)
        g = end[event]
        if g < 0.0:
            high, g_high = h, g
            g_low *= 0.5
        else:
            low, g_low = h, g
            g_high *= 0.5
    return high


@device_function
def _candidates(par: Array, y: Array, k: int, locked: bool) -> int:
    """2: locked, or its motion imposed; -1, 1: may rest on that stop; 0: free."""
    if (locked and int(par[model.LOCK]) - 1 == k) or imposed(par, k):
        return 2
    if y[at.SLIDE + k] != 0.0:
        return 0
    if y[at.LENGTH + k] - par[model.STOPS + 2 * k] <= CLOSED:
        return -1
    if par[model.STOPS + 2 * k + 1] - y[at.LENGTH + k] <= CLOSED:
        return 1
    return 0


@device_function
def settled(
    par: Array, joint: Array, t: float, y: Array, locked: bool, was_stick: bool
) -> tuple[bool, Sides, Two, bool]:
    """Whether it sticks, what holds, with what accelerations it goes on, and whether by force.

    Where stick exceeds what friction may, but slip would jam as soon as it began, it sticks as jams
    without end would have it: ``held``.
    """
    stuck, sides, a = _settled(par, joint, t, y, locked, was_stick)
    if not model.law(par).on or stuck or y[at.SLIDE] != 0.0 or y[at.SPIN] != 0.0:
        return stuck, sides, a, False
    if carries_on(par, joint, t, y, sides, a):
        return False, sides, a, False
    if not was_stick:
        stuck, sides, a = _settled(par, joint, t, y, locked, True)
        if stuck:
            return True, sides, a, False
    return True, sides, (0.0, 0.0), True


@device_function
def _settled(
    par: Array, joint: Array, t: float, y: Array, locked: bool, was_stick: bool
) -> tuple[bool, Sides, Two]:
    """Whether it sticks, which stops hold, and with what accelerations it goes on.

    A stop rests on nothing where friction holds it; it holds with a reaction that pushes.
    """
    c1, c2 = _candidates(par, y, 0, locked), _candidates(par, y, 1, locked)
    at_rest = y[at.SLIDE] == 0.0 and y[at.SPIN] == 0.0
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
            regime, a = from_rest(par, joint, t, y, sides, was_stick)
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


@device_function
def note(log: Array, count: int, t: float, kind: int, y: Array, restitution: float) -> int:
    """Append an event while there is room; the number of events so far."""
    if count < log.shape[0]:
        log[count, 0], log[count, 1] = t, kind
        log[count, 2], log[count, 3], log[count, 4] = y[at.LENGTH], y[at.ANGLE], restitution
    return count + 1


@device_function
def nudged(
    par: Array, joint: Array, t: float, y: Array, a: tuple[float, float], sides: Sides, k: Array,
    left: float,
) -> float:  # fmt: skip
    """From rest into motion with accelerations a, so that slip has a direction; the time taken."""
    h = min(NUDGE, left)
    y[at.SLIDE], y[at.SPIN] = h * a[0], h * a[1]
    rates_at(par, joint, t, y, False, sides, k)
    for i in range(at.A_COM, y.shape[0]):
        y[i] += h * k[i]
    y[at.LENGTH] += 0.5 * h * h * a[0]
    y[at.ANGLE] += 0.5 * h * h * a[1]
    return h


@device_function
def slowest(joint: Array, y: Array, held: bool) -> float:
    """The longest step while stuck: a tenth of a radian of the bodies' turning, or a hundredth."""
    free = joint[at.MODE] == at.BOTH_FREE
    w = norm(model.vector(y, at.A_SPIN) if free else model.vector(joint, at.PRESCRIBED + 10))
    return (0.01 if held else 0.1) / w if w > 0.0 else math.inf
