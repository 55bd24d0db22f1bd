"""Event-driven integration: the loop over steps, and the state changes at events."""

import math
from typing import Final, NamedTuple

import numpy as np

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function, allocating_kernel
from cylconn_ros.core.joint_limits import Two, is_motion_imposed
from cylconn_ros.methods.minimal import coordinates, events
from cylconn_ros.methods.minimal.derivatives import SLIP_INTEGRAL, derivatives_at, size_of
from cylconn_ros.methods.minimal.dop853 import STAGES
from cylconn_ros.methods.minimal.events import (
    contact_conditions,
    event_functions,
    locate_event,
    log_event,
    longest_stick_step,
    start_slip,
)
from cylconn_ros.methods.minimal.forces import Instant
from cylconn_ros.methods.minimal.impacts import impact, impose_rates
from cylconn_ros.methods.minimal.one_step import (
    ContactState,
    adaptive_step,
    step,
    stiffness_estimate,
)
from cylconn_ros.methods.minimal.over_time import hold, longest_step, set_time
from cylconn_ros.methods.minimal.radau import stiffness

# The explicit method is stable up to h times the stiffness of about 6.
STIFF_STEP: Final = 3.0
STIFF_STEPS: Final = 5  # consecutive stiff steps before the implicit method takes over
NONSTIFF_STEP: Final = 1.5  # below which the explicit method takes over again
STIFF_START: Final = 30.0  # stiffness times first step, above which slip starts implicitly
EVENT_STEPS: Final = 8.0  # steps per event at the limit of steps; sets the shortest step


class IntegrationResult(NamedTuple):
    """Result of an integration."""

    t: float
    state: ContactState
    events: int
    evaluations: int
    complete: bool
    blocked: bool  # an imposed motion needs an unbounded force; otherwise: too many steps
    coarse: float  # s: from this time on steps exceed the tolerance; inf: none does


class IntegrationState(NamedTuple):
    """State of an integration between two steps."""

    t: float
    i: Instant
    s: ContactState
    h: float  # to try next
    trend: Two  # length and error of the last step; 0: none
    strained: int  # consecutive stiff steps
    stiffness: float  # 1/s
    floor: float  # s: shortest step, whatever the tolerance


class StepEvent(NamedTuple):
    """The event at the end of a step; ``kind`` 0: none."""

    kind: int
    locked: bool
    restitution: float
    evaluations: int


@allocating_function
def begin_phase(
    par: Array, joint: Array, t: float, y: Array, k: Array, locked: bool, was_stick: bool,
    left: float, pause: float,
) -> tuple[float, ContactState]:  # fmt: skip
    """Select the equations that hold from t on; if slip starts from rest, make its first step.

    ``pause``: s, to stick before. Returns the time of the first step, and the contact state.
    """
    stuck, sides, a, beyond_limit = contact_conditions(par, joint, t, y, locked, was_stick)
    law = model.law(par)
    if not law.on or stuck or y[coordinates.SLIDE] != 0.0 or y[coordinates.SPIN] != 0.0:
        return 0.0, ContactState(stuck, sides, locked, False, beyond_limit, -math.inf)
    if pause > 0.0:
        return 0.0, ContactState(True, sides, locked, False, True, t + min(pause, left))
    taken = start_slip(par, joint, t, y, a, sides, k[0], left)
    i = derivatives_at(par, joint, t + taken, y, False, sides, k[0])
    stiff = False
    if i.slip > 0.0 and not i.jammed:
        pull = stiffness(par, joint, t + taken, y, sides, i.slip, law.radius, k)
        stiff = pull * taken > STIFF_START
    return taken, ContactState(False, sides, locked, stiff, False, -math.inf)


@allocating_function
def _imposed_rates(par: Array, s: ContactState) -> Two:
    """The imposed rates of slide and spin; 0.0 if none is imposed."""
    slide, spin = 0.0, 0.0
    component = int(par[model.LOCK]) if s.locked else 0
    if is_motion_imposed(par, 0) and component != 1:
        slide = model.value_or(par[model.COMMAND + 1], 0.0)
    if is_motion_imposed(par, 1) and component != 2:
        spin = model.value_or(par[model.COMMAND + 4], 0.0)
    return slide, spin


@allocating_function
def _lock_side(par: Array, y: Array, locked: bool) -> float:
    """The side from which the component approaches the lock's position; 0: it does not."""
    if par[model.LOCK] == 0.0 or locked or math.isnan(par[model.LOCK + 1]):
        return 0.0
    away = y[coordinates.LENGTH + int(par[model.LOCK]) - 1] - par[model.LOCK + 1]
    return 1.0 if away > 0.0 else (-1.0 if away < 0.0 else 0.0)


@allocating_function
def _apply_event(
    par: Array, joint: Array, t: float, y: Array, event: int, s: ContactState, a: Two, low: float,
    floor: float,
) -> tuple[bool, int, float]:  # fmt: skip
    """Apply an event to ``y``; returns whether the lock is closed, the kind, and the restitution.

    ``a``: the accelerations of slide and spin, which give height and duration of a bounce. A bounce
    lower than ``low`` or shorter than ``floor`` is suppressed.
    """
    n = size_of(joint)
    if event == events.BREAKAWAY:
        return s.locked, events.BREAKS_AWAY, 0.0
    if event == events.LOCK_AT or event == events.LOCK_FORCE:
        k = int(par[model.LOCK]) - 1
        if event == events.LOCK_AT:
            y[coordinates.LENGTH + k] = par[model.LOCK + 1]
        hold(joint, k)
        sides = (2, s.sides[1]) if k == 0 else (s.sides[0], 2)
        rest = (0.0, y[coordinates.SPIN]) if k == 0 else (y[coordinates.SLIDE], 0.0)
        impose_rates(par, joint, t, y, n, sides, rest)
        return True, events.LOCKS, 0.0
    k = (event - events.GAPS) // 2
    if s.sides[k] != 0:
        return s.locked, events.RELEASES, 0.0
    y[coordinates.LENGTH + k] = par[model.STOPS + event - events.GAPS]
    eps, v = par[model.STOPS + 4], y[coordinates.SLIDE + k]
    rebound = eps * abs(v)
    if v * a[k] > 0.0 and rebound < max(math.sqrt(2.0 * low * abs(a[k])), 0.5 * floor * abs(a[k])):
        eps = 0.0
    return s.locked, events.IMPACTS, impact(par, joint, t, y, n, k, eps, s.sides)


@allocating_function
def _longest_step(
    par: Array, joint: Array, t: float, i: Instant, y: Array, s: ContactState, slowing: float
) -> float:
    """The longest step that the contact state allows, s."""
    if s.stuck:
        pause = s.until - t if s.until > t else math.inf
        return min(longest_stick_step(joint, y, s.beyond_limit), pause)
    longest = longest_step(joint)
    if slowing > 0.0:
        longest = events.REST_STEP_SHARE * i.slip / slowing
    for k in range(2):  # off a stop: not beyond the reversal, or the bounce would be missed
        low = y[coordinates.LENGTH + k] - par[model.STOPS + 2 * k]
        high = par[model.STOPS + 2 * k + 1] - y[coordinates.LENGTH + k]
        v, a = y[coordinates.SLIDE + k], i.acceleration[k]
        if s.sides[k] == 0 and (low == 0.0 or high == 0.0) and v * a < 0.0:
            longest = min(longest, 0.95 * abs(v / a))
    return longest


@allocating_function
def _suppress_bounce(par: Array, i: Instant, y: Array, s: ContactState, low: float) -> bool:
    """Zero the rate of a component whose bounce is lower than ``low``; whether there is one."""
    found = False
    for k in range(2):
        v, a = y[coordinates.SLIDE + k], i.acceleration[k]
        below = y[coordinates.LENGTH + k] == par[model.STOPS + 2 * k] and v > 0.0
        above = y[coordinates.LENGTH + k] == par[model.STOPS + 2 * k + 1] and v < 0.0
        if s.sides[k] == 0 and (below or above) and v * a < 0.0 and v * v < 2.0 * low * abs(a):
            y[coordinates.SLIDE + k] = 0.0
            found = True
    return found


@allocating_function
def _advance_to_rest(
    par: Array, joint: Array, t: float, y: Array, k: Array, i: Instant, slowing: float
) -> float:
    """Advance ``y`` to rest with constant deceleration; returns the time, s."""
    h = i.slip / slowing
    y[coordinates.LENGTH] += 0.5 * h * y[coordinates.SLIDE]
    y[coordinates.ANGLE] += 0.5 * h * y[coordinates.SPIN]
    y[coordinates.SLIDE] = y[coordinates.SPIN] = 0.0
    for j in range(coordinates.A_COM, y.shape[0]):
        y[j] += h * k[j]
    y[size_of(joint) + SLIP_INTEGRAL] -= 0.5 * h * i.slip
    return h


@allocating_function
def _deceleration(par: Array, i: Instant, y: Array) -> float:
    """-d|s|/dt; 0 without friction."""
    law = model.law(par)
    if not law.on or i.slip == 0.0:
        return 0.0
    turning = law.radius * law.radius * y[coordinates.SPIN] * i.acceleration[1]
    return -(y[coordinates.SLIDE] * i.acceleration[0] + turning) / i.slip


@allocating_function
def _first_event(
    par: Array, joint: Array, t: float, y: Array, h: float, s: ContactState, slip: float,
    lock_side: float, k: Array, new: Array, system: Array, before: Array, values: Array,
) -> tuple[int, float]:  # fmt: skip
    """The first of the events within h, and its time; ``new`` is the state there."""
    event, least, ended = 0, math.inf, values.copy()
    for c in range(events.NEVENTS):
        if ended[c] < 0.0:
            values[c] = ended[c]
            taken = locate_event(
                par, joint, t, y, h, s, slip, lock_side, c, k, new, system, before, values
            )  # fmt: skip
            if taken < least:
                event, least = c, taken
    step(par, joint, t, y, least, s, slip, k, new, system)
    return event, least


@allocating_function
def _shortest_step(par: Array, i: Instant, tolerance: float) -> float:
    """The shortest step: in a shorter one slip neither changes nor causes a motion."""
    radius = model.law(par).radius
    a = math.sqrt(i.acceleration[0] ** 2 + (radius * i.acceleration[1]) ** 2)
    if not (i.slip > 0.0 and a > 0.0):
        return 1e-18
    change = min(i.slip / a, 1.0)
    return max(1e-12 * change, min(1e-6 * change, 1e-3 * tolerance / i.slip))


@allocating_function
def _switch_integrator(s: ContactState, strained: int, strain: float) -> ContactState:
    """The contact state with the integration method for the stiffness."""
    change = strained >= STIFF_STEPS if not s.stiff else strain <= NONSTIFF_STEP
    return ContactState(s.stuck, s.sides, s.locked, s.stiff != change, s.beyond_limit, s.until)


@allocating_function
def _step_to_event(
    par: Array, joint: Array, y: Array, end: float, tolerance: float, low: float,
    g: IntegrationState, k: Array, new: Array, system: Array, before: Array, values: Array,
) -> tuple[IntegrationState, StepEvent]:  # fmt: skip
    """Make a step, up to the first event within it."""
    t, i, s, law = g.t, g.i, g.s, model.law(par)
    lock_side = _lock_side(par, y, s.locked)
    event_functions(par, joint, t, i, y, s, lock_side, before)
    longest = min(_longest_step(par, joint, t, i, y, s, _deceleration(par, i, y)), end - t)
    h = longest if s.stuck else min(max(g.h, g.floor), longest)
    tried = adaptive_step(
        par, joint, t, y, h, s, i.slip, _shortest_step(par, i, tolerance), g.floor, tolerance,
        g.trend, k, new, system,
    )  # fmt: skip
    h, slip, pull = tried.h, i.slip, g.stiffness
    if h == 0.0 and s.stiff:  # did not converge: continue explicitly
        pull = stiffness(par, joint, t, y, s.sides, slip, law.radius, k)
        s = ContactState(s.stuck, s.sides, s.locked, False, s.beyond_limit, s.until)
        h = max(3.0 / pull, g.floor) if pull > 0.0 else g.h
        state = IntegrationState(t, i, s, h, g.trend, -100, pull, g.floor)
        return state, StepEvent(0, s.locked, 0.0, tried.evaluations)
    if h == 0.0:
        return g, StepEvent(events.JAMS, s.locked, 0.0, tried.evaluations)
    i = derivatives_at(par, joint, t + h, new, s.stuck, s.sides, k[STAGES])
    event, last = -1, h >= end - t
    if event_functions(par, joint, t + h, i, new, s, lock_side, values) > 0:
        event, h = _first_event(
            par, joint, t, y, h, s, slip, lock_side, k, new, system, before, values
        )  # fmt: skip
        last = False
    elif law.on and not s.stuck and not s.stiff:
        pull = stiffness_estimate(h, slip, law.radius, k)
    for n in range(y.shape[0]):
        y[n], k[0, n] = new[n], k[STAGES, n]
    t = end if last else t + h
    if s.stiff and event < 0 and i.slip > 0.0:
        pull = stiffness(par, joint, t, y, s.sides, i.slip, law.radius, k)
    strained = g.strained + 1 if pull * h > STIFF_STEP else min(g.strained, 0)
    kind, locked, restitution = 0, s.locked, 0.0
    if event >= 0:
        locked, kind, restitution = _apply_event(
            par, joint, t, y, event, s, i.acceleration, low, g.floor
        )  # fmt: skip
    s = _switch_integrator(s, strained, pull * h)
    state = IntegrationState(t, i, s, tried.next, (h, tried.error), strained, pull, g.floor)
    return state, StepEvent(kind, locked, restitution, tried.evaluations)


@allocating_function
def _restart_after_event(
    par: Array, joint: Array, y: Array, end: float, low: float, g: IntegrationState,
    what: StepEvent, log: Array, count: int, k: Array,
) -> tuple[IntegrationState, int]:  # fmt: skip
    """Log an event and restart after it; returns the state and the number of events."""
    t, kind, beyond_limit = g.t, what.kind, g.s.beyond_limit
    stops = kind == events.JAMS or kind == events.RESTS
    if kind == events.JAMS:
        set_time(par, joint, t)
        impose_rates(par, joint, t, y, size_of(joint), (2, 2), _imposed_rates(par, g.s))
    sticks = kind == events.BREAKS_AWAY or kind == events.JAMS  # after a jam, stick if admissible
    pause = g.floor if stops else 0.0
    taken, s = begin_phase(par, joint, t, y, k, what.locked, sticks, end - t, pause)
    i = derivatives_at(par, joint, t + taken, y, s.stuck, s.sides, k[0])
    if _suppress_bounce(par, i, y, s, low):
        taken, s = begin_phase(par, joint, t, y, k, what.locked, sticks, end - t, pause)
        i = derivatives_at(par, joint, t + taken, y, s.stuck, s.sides, k[0])
    if kind == events.RESTS and not s.stuck:
        kind = events.REVERSES
    if kind == events.BREAKS_AWAY and s.beyond_limit:
        kind = events.JAMS
    if not (beyond_limit and s.stuck):
        count = log_event(log, count, t, kind, y, what.restitution)
    h = 10.0 * taken if taken > 0.0 else g.h
    return IntegrationState(t + taken, i, s, h, (0.0, 0.0), 0, 0.0, g.floor), count


@allocating_kernel
def integrate(
    par: Array, joint: Array, y: Array, t: float, end: float, tolerance: float, first: float,
    locked: bool, was_stick: bool, log: Array, count: int, most: int,
) -> IntegrationResult:  # fmt: skip
    """Advance ``y``, in place, from t to ``end``.

    Args:
        par, joint, y: parameters, constants (NJOINT,), coordinates followed by integrals.
        tolerance: of a step, relative; a tenth of it is the absolute one (SI units).
        first: first step to try, s.
        locked: whether the lock is closed.
        was_stick: whether it sticks up to t, which selects among several solutions.
        log: (events, 5) of which ``count`` rows are used.
        most: greatest number of steps.
    """
    k, system = np.zeros((STAGES + 1, y.shape[0])), np.zeros((6, 7))
    new, values, before = np.zeros(y.shape[0]), np.zeros(events.NEVENTS), np.zeros(events.NEVENTS)
    moved = is_motion_imposed(par, 0) or is_motion_imposed(par, 1)
    rest = max(events.REST_SHARE, 0.01 * math.sqrt(tolerance))
    taken, s = begin_phase(par, joint, t, y, k, locked, was_stick, end - t, 0.0)
    i = derivatives_at(par, joint, t + taken, y, s.stuck, s.sides, k[0])
    g = IntegrationState(t + taken, i, s, first, (0.0, 0.0), 0, 0.0, 0.0)
    greatest, coarse, evaluations = 0.0, math.inf, 0
    for n in range(most):
        if not g.t < end:
            return IntegrationResult(g.t, g.s, count, evaluations, True, False, coarse)
        if g.i.jammed and moved:
            return IntegrationResult(g.t, g.s, count, evaluations, False, True, coarse)
        floor = 0.0
        if 2 * n >= most:  # events accumulate: bound the step from below to reach the end
            coarse, floor = min(coarse, g.t), EVENT_STEPS * (end - g.t) / (most - n)
        slowing = _deceleration(par, g.i, y)
        greatest = max(greatest, g.i.slip)
        near = slowing > 0.0 and g.i.slip <= rest * greatest
        size = 0.1 + max(abs(y[coordinates.LENGTH]), abs(y[coordinates.ANGLE]))
        low = max(events.LOWEST_BOUNCE, tolerance * size)
        g = IntegrationState(g.t, g.i, g.s, g.h, g.trend, g.strained, g.stiffness, floor)
        what = StepEvent(0, g.s.locked, 0.0, 0)
        if g.i.jammed:
            what = StepEvent(events.JAMS, g.s.locked, 0.0, 0)
        elif -math.inf < g.s.until <= g.t:
            what = StepEvent(events.BREAKS_AWAY, g.s.locked, 0.0, 0)
        elif near and g.i.slip < slowing * (end - g.t):
            t = g.t + _advance_to_rest(par, joint, g.t, y, k[0], g.i, slowing)
            g = IntegrationState(t, g.i, g.s, g.h, g.trend, g.strained, g.stiffness, floor)
            what = StepEvent(events.RESTS, g.s.locked, 0.0, 0)
        else:
            g, what = _step_to_event(
                par, joint, y, end, tolerance, low, g, k, new, system, before, values
            )  # fmt: skip
        evaluations += what.evaluations
        if what.kind != 0:
            g, count = _restart_after_event(par, joint, y, end, low, g, what, log, count, k)
            greatest = 0.0
    return IntegrationResult(g.t, g.s, count, evaluations, False, False, coarse)
