"""Stalls: intervals in which no new wrench took effect, and stamps that are not the motion's times.

A simulator or a connector that is kept waiting stalls the loop. While the connector waits, the
plant moves on under the wrench that it has; afterwards the connector answers the samples that have
queued up, and of those wrenches only the newest will act. This is no latency of many periods: as
soon as the stall is over, wrenches act as late as before. With N the wrench that the interval
needed, L its mean excess over the sent wrenches (unknown loads), and P the wrench that is expected
to act,

    |N - L - held|^2 < HELD |N - L - P|^2

tells that the wrench which acted at the end of the last interval was held through this one. The
estimate of the latency then stays as it is, and the wrenches in flight are taken as overtaken by
the one that is computed now. Only after AGREED intervals that confirmed the latency: before, a
wrench that does not act may as well be on its way.

A wrench that reaches the simulator within the same period as a newer one never acts. Where a newer
wrench than the expected one acted through the interval, the older ones are dropped: they would be
taken for late until the estimate reaches its greatest latency.

A simulator of fixed steps that stamps its samples with the clock moves by whole periods, whatever
its stamps say. The number of periods that a motion took is that of

    moved = n h (v + v+)/2        and h (v+ - v)/2 more on a semi-implicit plant

by least squares over the mass centres. It replaces the interval of the stamps where it is whole and
explains the motion, and the stamps do not.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import latency_of
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.layout import MAX_LATENCY, SENT_PERIODS
from cylconn_ros.core.plant import motion_of
from cylconn_ros.core.rigid_body import Body
from cylconn_ros.core.vectors import Vector, add, add_scaled, dot, scale, sub

HELD = 0.01
AGREED = 5  # intervals
MOST_AGREED = 20
USUAL_OF = 50.0  # intervals of the usual latency
SOON = 1.6  # periods: with more, a wrench that does not act yet is rather on its way
AFTER, LEAST_AFTER = 0.5, 0.2  # the gain after n intervals is 1/(1 + AFTER n), or the least one
CLEARLY = 0.01  # misfit of a wrench that overtook others, over that of those, both squared
DISTINCT = 0.01  # its difference from them, over itself, both squared
DISAGREES = 0.25  # confirmations that an interval outweighs which does not confirm it
LOADED = 0.1  # what such an interval needs beside the wrench, over the wrench, both squared
FAR_SHARE = 0.005  # of one that needs more
LOAD_SHARE = 0.1  # of an interval in the mean of unknown loads
AGREES = 0.1  # misfit of an interval that confirms the latency, over its change, both squared
LEAST_CHANGE = 1e-8  # of the wrench, relative, squared
EVEN = 0.01  # of the period: stamps within it are as good as the motion
WHOLE = 0.05  # periods: of a number of steps from a whole one
EXPLAINED = 1e-4  # of the motion, squared: it is that of so many steps
LEAST_MOTION = 1e-9  # of a mass centre, relative to its distance from the origin plus 1 m


Wrenches = tuple[Vector, Vector, Vector, Vector]
"""Force and torque on A, on B."""
Weights = tuple[float, float, float, float]
"""Of their squares."""


class Compared(NamedTuple):
    """Weighted sums of squares over the forces and torques of an interval.

    expected, held, absent: of what it needed beside unknown loads, less the wrench that was
    expected to act, the one that would have been held, none. change: of expected less held. size:
    of expected. differs: of the change since the last interval, less that of the expected wrench.
    """

    expected: float
    held: float
    absent: float
    change: float
    size: float
    differs: float


@device_function
def interval_by_motion(par: Array, mem: Array, sample: Array, a: Body, b: Body, h: float) -> float:
    """The interval since the last sample, s: by the stamps, or by the motion if that is whole."""
    stamped = mem[model.LAST_PERIOD]
    if abs(stamped - h) <= EVEN * h:
        return stamped
    last = mem[model.LAST_SAMPLE : model.LAST_SAMPLE + layout.NSAMPLE]
    lead = 0.5 * h if model.output(par).semi_implicit else 0.0
    along = square = size = 0.0
    for k in range(2):
        body, at = (a, layout.A_POSE) if k == 0 else (b, layout.B_POSE)
        if body.free:
            before, now = motion_of(body, last, at), motion_of(body, sample, at)
            moved = sub(sub(now.com, before.com), _led(lead, before.velocity, now.velocity))
            mean = scale(0.5, add(before.velocity, now.velocity))
            along += body.mass * dot(moved, mean)
            square += body.mass * dot(mean, mean)
            far = LEAST_MOTION * (1.0 + abs(now.com[0]) + abs(now.com[1]) + abs(now.com[2]))
            size += body.mass * (dot(moved, moved) - far * far)
    if square <= 0.0 or size <= 0.0:
        return stamped
    steps = along / (square * h)
    whole = math.floor(steps + 0.5)
    # least squares: the rest is |moved|^2 - (moved . mean)^2 / |mean|^2
    unexplained = size - along * along / square
    apart = whole * h - stamped
    by_stamps = apart * apart * square + unexplained
    if whole < 1.0 or abs(steps - whole) > WHOLE or unexplained > EXPLAINED * size:
        return stamped
    return whole * h if by_stamps > EXPLAINED * size else stamped


@inline_function
def _led(lead: float, before: Vector, now: Vector) -> Vector:
    """The part of a semi-implicit motion that comes from its positions following v+."""
    return scale(lead, sub(now, before))


@inline_function
def is_stalled(mem: Array) -> bool:
    """Whether the last wrench that acted is being held although newer ones have been sent."""
    return mem[model.STALLED] > 0.0


@inline_function
def _at(mem: Array, j: int, at: int) -> Vector:
    """The wrench sent j periods before the last one."""
    return model.vector(mem, model.SENT_WRENCHES + 12 * j + at)


@inline_function
def _mixed(mem: Array, j: int, part: float, at: int) -> Vector:
    """The mean wrench of a period, j + part periods late."""
    return add_scaled(scale(1.0 - part, _at(mem, j, at)), part, _at(mem, j + 1, at))


@inline_function
def _update_usual(mem: Array, late: float) -> None:
    """Add the latency of an interval to the usual one."""
    count = min(mem[model.LATENCIES] + 1.0, USUAL_OF)
    mem[model.LATENCIES] = count
    apart = late - mem[model.USUAL_LATENCY]
    if count == USUAL_OF:
        apart = min(max(apart, -1.0), 1.0)
    mem[model.USUAL_LATENCY] += apart / count


@device_function
def find_stall(
    par: Array, mem: Array, needed: Wrenches, n: int, weights: Weights, resolution: float
) -> bool:
    """Whether this interval tells nothing of the latency, as a wrench was held through it or until.

    Updates the stall in ``mem``. Arguments as of acts_at_once (core/latency_estimation.py).
    """
    late = latency_of(par, mem)
    j, part = int(late), late - int(late)
    _update_usual(mem, late)
    if n != 1 or mem[model.LAST_INTERVAL] <= 0.0 or mem[model.USUAL_LATENCY] >= SOON:
        mem[model.STALLED] = 0.0
        return False
    stalled, trusted = is_stalled(mem), _is_trusted(mem)
    seen = _compare(mem, needed, weights, j, part)
    telling = seen.change > LEAST_CHANGE * seen.size + 100.0 * resolution
    if trusted and seen.absent < CLEARLY * min(seen.expected, seen.held):
        for k in range(12):  # after a timeout, or as the simulator applies no old wrench
            mem[model.STALLED_WRENCH + k] = 0.0
        mem[model.STALLED] += 1.0
        return True
    if trusted and telling and seen.held < HELD * seen.expected:
        _hold(mem, j, stalled)
        return True
    if stalled and not telling:
        return True
    other = _acted(mem, needed, weights, j, min(seen.expected, seen.held))
    if other >= 0:
        _take_other(mem, j, other, trusted)
        return True
    mem[model.STALLED] = 0.0
    if not stalled:
        _confirm(mem, needed, j, part, seen, telling)
    return stalled


@inline_function
def _is_trusted(mem: Array) -> bool:
    """Whether enough intervals confirmed the latency, or lock step, to call another one a stall."""
    in_lock_step = mem[model.LOCK_STEP] if mem[model.DELAYED] == 0.0 else 0.0
    return max(mem[model.AGREED], in_lock_step) >= AGREED


@inline_function
def _compare(mem: Array, needed: Wrenches, weights: Weights, j: int, part: float) -> Compared:
    """Compare what an interval needed with the wrenches expected, j + part late, and held."""
    stalled = is_stalled(mem)
    expected = held = absent = change = size = differs = 0.0
    for k in range(4):
        at, weight = 3 * k, weights[k]
        now, old = _mixed(mem, j, part, at), _at(mem, j + 1, at)
        if stalled:
            old = model.vector(mem, model.STALLED_WRENCH + at)
        acted = sub(needed[k], model.vector(mem, model.UNKNOWN_LOAD + at))
        off, off_old, by = sub(acted, now), sub(acted, old), sub(now, old)
        expected += weight * dot(off, off)
        held += weight * dot(off_old, off_old)
        absent += weight * dot(acted, acted)
        change += weight * dot(by, by)
        size += weight * dot(now, now)
        seen = sub(needed[k], model.vector(mem, model.LAST_NEEDED + at))
        off = sub(seen, sub(now, _mixed(mem, j + 1, part, at)))
        differs += weight * dot(off, off)
    return Compared(expected, held, absent, change, size, differs)


@inline_function
def _hold(mem: Array, j: int, stalled: bool) -> None:
    """Count an interval through which a wrench was held; correct errors more slowly after it."""
    if not stalled:
        for k in range(4):
            model.write_vector(mem, model.STALLED_WRENCH + 3 * k, _at(mem, j + 1, 3 * k))
    mem[model.STALLED] += 1.0
    gain = mem[model.FEEDBACK_GAIN] if mem[model.FEEDBACK_GAIN] > 0.0 else 1.0
    least = max(LEAST_AFTER, 1.0 / (1.0 + AFTER * mem[model.STALLED]))
    mem[model.FEEDBACK_GAIN] = min(gain, least)


@inline_function
def _take_other(mem: Array, j: int, other: int, trusted: bool) -> None:
    """Take up that the wrench at index ``other`` acted, not the one at j: older, or a newer one."""
    if other > j:
        _begin_again(mem, other)
        return
    _drop_overtaken(mem, other, trusted)
    mem[model.STALLED], mem[model.AGREED] = 0.0, max(mem[model.AGREED] - 1.0, 0.0)


@inline_function
def _confirm(
    mem: Array, needed: Wrenches, j: int, part: float, seen: Compared, telling: bool
) -> None:
    """Update the confirmations of the latency and, if it explains the interval, unknown loads."""
    agrees, near = seen.differs < AGREES * seen.change, seen.expected < LOADED * seen.size
    if telling:
        agreed = mem[model.AGREED]
        mem[model.AGREED] = (
            min(agreed + 1.0, MOST_AGREED) if agrees else max(agreed - DISAGREES, 0.0)
        )
    if agrees or (near and not telling):
        share = LOAD_SHARE if near else FAR_SHARE
        for k in range(4):
            at = 3 * k
            beside = sub(needed[k], _mixed(mem, j, part, at))
            mean = model.vector(mem, model.UNKNOWN_LOAD + at)
            model.write_vector(
                mem, model.UNKNOWN_LOAD + at, add_scaled(mean, share, sub(beside, mean))
            )


@inline_function
def _acted(
    mem: Array,
    needed: Wrenches,
    weights: Weights,
    late: int,
    missed: float,
) -> int:
    """The wrench other than the expected one that acted through the whole interval; -1 if none.

    Its index, 0 for the last one sent. missed: misfit of the wrench expected or held.
    """
    for i in range(MAX_LATENCY + 1):
        if i == late or i == late + 1:
            continue
        misfit = change = size = 0.0
        for k in range(4):
            at = 3 * k
            sent = _at(mem, i, at)
            off = sub(sub(needed[k], model.vector(mem, model.UNKNOWN_LOAD + at)), sent)
            by = sub(sent, _at(mem, late, at))
            misfit += weights[k] * dot(off, off)
            change += weights[k] * dot(by, by)
            size += weights[k] * dot(sent, sent)
        share = CLEARLY if i < late else CLEARLY * CLEARLY
        if misfit < share * missed and change > DISTINCT * size:
            return i
    return -1


@inline_function
def _begin_again(mem: Array, late: int) -> None:
    """Take a wrench that acted ``late`` periods after its sample for a longer latency."""
    for k in range(model.LATENCY_FIT, model.LAST_NEEDED):
        mem[k] = 0.0
    for k in range(model.FILTERED_NEEDED, model.LAST_INTERVAL):
        mem[k] = 0.0
    mem[model.MEASURED_LATENCY], mem[model.DELAYED] = float(late), 1.0
    mem[model.STALLED], mem[model.AGREED], mem[model.LATENCIES] = 0.0, 0.0, 0.0


@inline_function
def _drop_overtaken(mem: Array, newest: int, trusted: bool) -> None:
    """Forget the wrenches that the one at index ``newest`` has overtaken: they will never act."""
    at = model.SENT_WRENCHES + 12 * newest
    for i in range(newest + 1, SENT_PERIODS):
        for k in range(12):
            mem[model.SENT_WRENCHES + 12 * i + k] = mem[at + k]
    for k in range(model.FILTERED_NEEDED, model.LAST_INTERVAL):
        mem[k] = 0.0
    if not trusted:  # the estimate has taken them for late
        for k in range(model.LATENCY_FIT, model.LAST_NEEDED):
            mem[k] = 0.0
        mem[model.MEASURED_LATENCY] = float(newest)
