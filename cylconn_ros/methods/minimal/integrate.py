"""Integration from event to event: the loop over steps, and what each event does to the state."""

import math
from typing import Final, NamedTuple

import numpy as np

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_kernel, device_function
from cylconn_ros.core.joint_limits import Two, imposed
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal import events as motion
from cylconn_ros.methods.minimal.derivatives import SLIPPED, rates_at, size_of
from cylconn_ros.methods.minimal.dop853 import STAGES
from cylconn_ros.methods.minimal.events import located, note, nudged, settled, slowest, watch
from cylconn_ros.methods.minimal.forces import Instant
from cylconn_ros.methods.minimal.impacts import bring_to, impact
from cylconn_ros.methods.minimal.one_step import State, ahead, step, stiffness_shown
from cylconn_ros.methods.minimal.radau import stiffness

# A step of h strains the explicit method where h times the stiffness nears its bound, 6.
STRAINED: Final = 3.0
PATIENCE: Final = 5  # strained steps in a row before it gives way to the implicit one
RELAXED: Final = 1.5  # and when it comes back
STIFF_START: Final = 30.0  # of a first step from rest into slip
CROWD: Final = 8.0  # steps that what happens may take before it is passed over


class Ran(NamedTuple):
    """How an integration went."""

    t: float
    state: State
    events: int
    evaluations: int
    complete: bool
    blocked: bool  # an imposed motion needs a force without bound; otherwise: too many steps
    coarse: float  # s: from here on with steps out of tolerance, to come to an end; inf: nowhere


class Going(NamedTuple):
    """How an integration stands between two steps."""

    t: float
    i: Instant
    s: State
    h: float  # to try next
    trend: Two  # length and error of the last step; 0: there is none to go by
    strained: int  # steps in a row
    stiffness: float  # 1/s
    floor: float  # s: no step is shorter for the sake of tolerance


class Happened(NamedTuple):
    """What ended a step; ``kind`` 0: nothing."""

    kind: int
    locked: bool
    restitution: float
    evaluations: int


@device_function
def begun(
    par: Array, joint: Array, t: float, y: Array, k: Array, locked: bool, was_stick: bool,
    left: float, pause: float,
) -> tuple[float, State]:  # fmt: skip
    """Find the equations that hold from t on; from rest into slip, make its first instant.

    ``pause``: s, to rest before.
    """
    stuck, sides, a, held = settled(par, joint, t, y, locked, was_stick)
    law = model.law(par)
    if not law.on or stuck or y[at.SLIDE] != 0.0 or y[at.SPIN] != 0.0:
        return 0.0, State(stuck, sides, locked, False, held, -math.inf)
    if pause > 0.0:
        return 0.0, State(True, sides, locked, False, True, t + min(pause, left))
    taken = nudged(par, joint, t, y, a, sides, k[0], left)
    i = rates_at(par, joint, t + taken, y, False, sides, k[0])
    stiff = False
    if i.slip > 0.0 and not i.jammed:
        pull = stiffness(par, joint, t + taken, y, sides, i.slip, law.radius, k)
        stiff = pull * taken > STIFF_START
    return taken, State(False, sides, locked, stiff, False, -math.inf)


@device_function
def _imposed_rates(par: Array, s: State) -> Two:
    """The rates of slide and spin that nothing can change; 0.0 where there is none."""
    slide, spin = 0.0, 0.0
    component = int(par[model.LOCK]) if s.locked else 0
    if imposed(par, 0) and component != 1:
        slide = model.given(par[model.COMMAND + 1], 0.0)
    if imposed(par, 1) and component != 2:
        spin = model.given(par[model.COMMAND + 4], 0.0)
    return slide, spin


@device_function
def _passing(par: Array, y: Array, locked: bool) -> float:
    """The side from which the locking component nears the lock's position; 0: it does not."""
    if par[model.LOCK] == 0.0 or locked or math.isnan(par[model.LOCK + 1]):
        return 0.0
    away = y[at.LENGTH + int(par[model.LOCK]) - 1] - par[model.LOCK + 1]
    return 1.0 if away > 0.0 else (-1.0 if away < 0.0 else 0.0)


@device_function
def _struck(
    par: Array, joint: Array, t: float, y: Array, event: int, s: State, a: Two, low: float,
    floor: float,
) -> tuple[bool, int, float]:  # fmt: skip
    """Do what an event does: whether it is locked now, the kind of event, its restitution.

    ``a``: the accelerations of slide and spin, which tell how high and long a bounce would be;
    lower than ``low``, or shorter than ``floor``, it is none.
    """
    n = size_of(joint)
    if event == motion.STICKS:
        return s.locked, motion.BREAKS_AWAY, 0.0
    if event == motion.LOCK_AT or event == motion.LOCK_FORCE:
        k = int(par[model.LOCK]) - 1
        if event == motion.LOCK_AT:
            y[at.LENGTH + k] = par[model.LOCK + 1]
        sides = (2, s.sides[1]) if k == 0 else (s.sides[0], 2)
        rest = (0.0, y[at.SPIN]) if k == 0 else (y[at.SLIDE], 0.0)
        bring_to(par, joint, t, y, n, sides, rest)
        return True, motion.LOCKS, 0.0
    k = (event - motion.GAPS) // 2
    if s.sides[k] != 0:
        return s.locked, motion.RELEASES, 0.0
    y[at.LENGTH + k] = par[model.STOPS + event - motion.GAPS]
    eps, v = par[model.STOPS + 4], y[at.SLIDE + k]
    rebound = eps * abs(v)
    if v * a[k] > 0.0 and rebound < max(math.sqrt(2.0 * low * abs(a[k])), 0.5 * floor * abs(a[k])):
        eps = 0.0
    return s.locked, motion.IMPACTS, impact(par, joint, t, y, n, k, eps, s.sides)


@device_function
def _longest(
    par: Array, joint: Array, t: float, i: Instant, y: Array, s: State, slowing: float
) -> float:
    """The longest step that the state allows."""
    if s.stuck:
        pause = s.until - t if s.until > t else math.inf
        return min(slowest(joint, y, s.held), pause)
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


@device_function
def _hops(par: Array, i: Instant, y: Array, s: State, low: float) -> bool:
    """End the rate of what leaves a stop to be back before it is ``low`` off; whether there is."""
    found = False
    for k in range(2):
        v, a = y[at.SLIDE + k], i.acceleration[k]
        below = y[at.LENGTH + k] == par[model.STOPS + 2 * k] and v > 0.0
        above = y[at.LENGTH + k] == par[model.STOPS + 2 * k + 1] and v < 0.0
        if s.sides[k] == 0 and (below or above) and v * a < 0.0 and v * v < 2.0 * low * abs(a):
            y[at.SLIDE + k] = 0.0
            found = True
    return found


@device_function
def _rest(
    par: Array, joint: Array, t: float, y: Array, k: Array, i: Instant, slowing: float
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


@device_function
def _slowing(par: Array, i: Instant, y: Array) -> float:
    """-d|s|/dt of friction's slip velocity; 0 where there is no friction."""
    law = model.law(par)
    if not law.on or i.slip == 0.0:
        return 0.0
    turning = law.radius * law.radius * y[at.SPIN] * i.acceleration[1]
    return -(y[at.SLIDE] * i.acceleration[0] + turning) / i.slip


@device_function
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


@device_function
def _least(par: Array, i: Instant, tolerance: float) -> float:
    """The step below which there is none: slip does not change in it, or does not move anything."""
    radius = model.law(par).radius
    a = math.sqrt(i.acceleration[0] ** 2 + (radius * i.acceleration[1]) ** 2)
    if not (i.slip > 0.0 and a > 0.0):
        return 1e-18
    change = min(i.slip / a, 1.0)
    return max(1e-12 * change, min(1e-6 * change, 1e-3 * tolerance / i.slip))


@device_function
def _changed(s: State, strained: int, strain: float) -> State:
    """The state with the method that fits the stiffness."""
    change = strained >= PATIENCE if not s.stiff else strain <= RELAXED
    return State(s.stuck, s.sides, s.locked, s.stiff != change, s.held, s.until)


@device_function
def _stepped(
    par: Array, joint: Array, y: Array, end: float, tolerance: float, low: float, g: Going,
    k: Array, new: Array, system: Array, before: Array, seen: Array,
) -> tuple[Going, Happened]:  # fmt: skip
    """Make a step, up to what happens first within it."""
    t, i, s, law = g.t, g.i, g.s, model.law(par)
    passing = _passing(par, y, s.locked)
    watch(par, joint, t, i, y, s, passing, before)
    longest = min(_longest(par, joint, t, i, y, s, _slowing(par, i, y)), end - t)
    h = longest if s.stuck else min(max(g.h, g.floor), longest)
    tried = ahead(
        par, joint, t, y, h, s, i.slip, _least(par, i, tolerance), g.floor, tolerance, g.trend, k,
        new, system,
    )  # fmt: skip
    h, slip, pull = tried.h, i.slip, g.stiffness
    if h == 0.0 and s.stiff:  # did not converge: go on explicitly
        pull = stiffness(par, joint, t, y, s.sides, slip, law.radius, k)
        s = State(s.stuck, s.sides, s.locked, False, s.held, s.until)
        h = max(3.0 / pull, g.floor) if pull > 0.0 else g.h
        going = Going(t, i, s, h, g.trend, -100, pull, g.floor)
        return going, Happened(0, s.locked, 0.0, tried.evaluations)
    if h == 0.0:
        return g, Happened(motion.JAMS, s.locked, 0.0, tried.evaluations)
    i = rates_at(par, joint, t + h, new, s.stuck, s.sides, k[STAGES])
    event, last = -1, h >= end - t
    if watch(par, joint, t + h, i, new, s, passing, seen) > 0:
        event, h = _first_event(
            par, joint, t, y, h, s, slip, passing, k, new, system, before, seen
        )  # fmt: skip
        last = False
    elif law.on and not s.stuck and not s.stiff:
        pull = stiffness_shown(h, slip, law.radius, k)
    y[:] = new
    k[0] = k[STAGES]
    t = end if last else t + h
    if s.stiff and event < 0 and i.slip > 0.0:
        pull = stiffness(par, joint, t, y, s.sides, i.slip, law.radius, k)
    strained = g.strained + 1 if pull * h > STRAINED else min(g.strained, 0)
    kind, locked, restitution = 0, s.locked, 0.0
    if event >= 0:
        locked, kind, restitution = _struck(
            par, joint, t, y, event, s, i.acceleration, low, g.floor
        )  # fmt: skip
    s = _changed(s, strained, pull * h)
    going = Going(t, i, s, tried.next, (h, tried.error), strained, pull, g.floor)
    return going, Happened(kind, locked, restitution, tried.evaluations)


@device_function
def _followed(
    par: Array, joint: Array, y: Array, end: float, low: float, g: Going, what: Happened,
    log: Array, count: int, k: Array,
) -> tuple[Going, int]:  # fmt: skip
    """Go on after an event, which is logged: the number of events so far."""
    t, kind, held = g.t, what.kind, g.s.held
    stops = kind == motion.JAMS or kind == motion.RESTS
    if kind == motion.JAMS:
        bring_to(par, joint, t, y, size_of(joint), (2, 2), _imposed_rates(par, g.s))
    sticks = kind == motion.BREAKS_AWAY or kind == motion.JAMS  # what jams stays if it can
    pause = g.floor if stops else 0.0
    taken, s = begun(par, joint, t, y, k, what.locked, sticks, end - t, pause)
    i = rates_at(par, joint, t + taken, y, s.stuck, s.sides, k[0])
    if _hops(par, i, y, s, low):
        taken, s = begun(par, joint, t, y, k, what.locked, sticks, end - t, pause)
        i = rates_at(par, joint, t + taken, y, s.stuck, s.sides, k[0])
    if kind == motion.RESTS and not s.stuck:
        kind = motion.REVERSES
    if kind == motion.BREAKS_AWAY and s.held:
        kind = motion.JAMS
    if not (held and s.stuck):
        count = note(log, count, t, kind, y, what.restitution)
    h = 10.0 * taken if taken > 0.0 else g.h
    return Going(t + taken, i, s, h, (0.0, 0.0), 0, 0.0, g.floor), count


@allocating_kernel
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
    moved = imposed(par, 0) or imposed(par, 1)
    rest = max(motion.REST, 0.01 * math.sqrt(tolerance))
    taken, s = begun(par, joint, t, y, k, locked, was_stick, end - t, 0.0)
    i = rates_at(par, joint, t + taken, y, s.stuck, s.sides, k[0])
    g = Going(t + taken, i, s, first, (0.0, 0.0), 0, 0.0, 0.0)
    greatest, coarse, evaluations = 0.0, math.inf, 0
    for n in range(most):
        if not g.t < end:
            return Ran(g.t, g.s, count, evaluations, True, False, coarse)
        if g.i.jammed and moved:
            return Ran(g.t, g.s, count, evaluations, False, True, coarse)
        floor = 0.0
        if 2 * n >= most:  # what happens crowds without end: no finer than to come to an end
            coarse, floor = min(coarse, g.t), CROWD * (end - g.t) / (most - n)
        slowing = _slowing(par, g.i, y)
        greatest = max(greatest, g.i.slip)
        near = slowing > 0.0 and g.i.slip <= rest * greatest
        size = 0.1 + max(abs(y[at.LENGTH]), abs(y[at.ANGLE]))
        low = max(motion.LOW, tolerance * size)
        g = Going(g.t, g.i, g.s, g.h, g.trend, g.strained, g.stiffness, floor)
        what = Happened(0, g.s.locked, 0.0, 0)
        if g.i.jammed:
            what = Happened(motion.JAMS, g.s.locked, 0.0, 0)
        elif -math.inf < g.s.until <= g.t:
            what = Happened(motion.BREAKS_AWAY, g.s.locked, 0.0, 0)
        elif near and g.i.slip < slowing * (end - g.t):
            t = g.t + _rest(par, joint, g.t, y, k[0], g.i, slowing)
            g = Going(t, g.i, g.s, g.h, g.trend, g.strained, g.stiffness, floor)
            what = Happened(motion.RESTS, g.s.locked, 0.0, 0)
        else:
            g, what = _stepped(
                par, joint, y, end, tolerance, low, g, k, new, system, before, seen
            )  # fmt: skip
        evaluations += what.evaluations
        if what.kind != 0:
            g, count = _followed(par, joint, y, end, low, g, what, log, count, k)
            greatest = 0.0
    return Ran(g.t, g.s, count, evaluations, False, False, coarse)
