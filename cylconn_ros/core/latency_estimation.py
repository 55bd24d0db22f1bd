"""Estimation of the latency, and of its spread, from the measured motion and the sent wrenches.

A wrench that acts tau = j + phi periods after its sample, 0 <= phi < 1, gives an interval between
two samples the impulse of

    (1 - phi) A_j + phi A_(j+1)        A_j: the wrench sent j periods before the last one

The wrench that an interval needed follows from the measured change of the velocities. For each j,
phi is fitted by least squares with forgetting, to the differences of successive intervals, from
which constant unknown loads vanish:

    r = dN - dA_j,  D = dA_j - dA_(j+1)        d: difference of two successive intervals
    S0 = sum r.r,  S1 = sum r.D,  S2 = sum D.D, the misfit is S0 + 2 phi S1 + phi^2 S2

The sums weigh forces by 1/m and torques by 1/I, over both bodies. phi is exactly 0 if S0 is within
rounding of zero, so that exact lock step computes as with ``latency: 0``. Of equal misfits the
least tau counts: a latency that is too small is refuted by the next sample. The spread sigma
of tau, in periods, is that of the residual along D.

A single interval that disagrees, as under a load that arrived late, may look like a latency. The
intervals that agree with lock step exactly although the wrenches changed are evidence against it:
RETURN of them end an estimate, and one that disagrees outweighs only DISAGREEMENT of them.

The feedback gain (core/delay.py) is alpha = 1/(1 + GAIN_SPREAD sigma). It falls at once and
recovers slowly.
"""

import math

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.layout import MAX_LATENCY
from cylconn_ros.core.passivity import reset_stick_position
from cylconn_ros.core.vectors import Vector, add_scaled, dot, sub

FORGETTING = 0.1  # share of earlier intervals that one with as much change replaces
UNEXPLAINED = 4.0  # weight of what no latency explains, over the change of the wrenches
NEIGHBOUR_RATIO = 0.8  # the same of the next j
SWITCH_RATIO = 0.25  # misfit of another j over that in use, below which it replaces it
FIRST = 3e-3  # misfit of the first interval over the wrench, both squared
EXACT = 1e-6  # S0/S2, below which a latency is exact
FILTER = 0.8  # share of earlier changes in a filtered wrench
INFORMED = 0.3  # S2 of another j over the greatest, below which only SILENT replaces
SILENT = 1e-4  # misfit of such a j over that in use
RESOLUTION = 1e-9  # of forces and velocities, relative
MOST_HELD = 5  # periods in an interval up to which it is used
GAIN_SPREAD = 8.0
LEAST_GAIN = 0.05
LEAST_SPREAD = 0.01  # periods; below it the gain is 1
MIXED = 0.3  # share of the residual across D that is a spread, from a latency of four periods on
START = 0.5  # the gain is 1/(1 + START j) when j is first measured
RECOVERY = 0.02  # of the gain, per sample
RETURN = 10  # intervals in lock step after which no latency is assumed
DISAGREEMENT = 4  # such intervals that one outweighs which disagrees


@inline_function
def _mean(mem: Array, j: int, n: int, at: int) -> Vector:
    """Mean of the n wrenches sent before index j, a force or a torque."""
    x = y = z = 0.0
    for i in range(n):
        b = model.SENT_WRENCHES + 12 * (j + i) + at
        x, y, z = x + mem[b], y + mem[b + 1], z + mem[b + 2]
    return (x / n, y / n, z / n)


@inline_function
def _change(mem: Array, j: int, n: int, last: int, at: int) -> Vector:
    """dA_j: change of the mean wrench from an interval of ``last`` periods to one of n."""
    now, before = _mean(mem, j, n, at), _mean(mem, j + n, last, at)
    return (now[0] - before[0], now[1] - before[1], now[2] - before[2])


@inline_function
def _filtered(mem: Array, at: int, change: Vector) -> Vector:
    """Add a change to the filtered wrench at ``at``."""
    y = add_scaled(change, FILTER, model.vector(mem, at))
    model.write_vector(mem, at, y)
    return y


@inline_function
def keep_needed(mem: Array, needed: tuple[Vector, Vector, Vector, Vector], n: int) -> None:
    """Store the wrenches of an interval of n periods, from which the next one's changes count."""
    for k in range(4):
        model.write_vector(mem, model.LAST_NEEDED + 3 * k, needed[k])
    mem[model.LAST_INTERVAL] = n


@device_function
def forget(mem: Array, needed: tuple[Vector, Vector, Vector, Vector], n: int) -> None:
    """Keep only the wrenches of the last interval, of n periods: wrenches act with their sample."""
    keep_needed(mem, needed, n)
    if mem[model.FIT_CHANGE] == 0.0 and mem[model.DELAYED] == 0.0:
        if mem[model.FEEDBACK_GAIN] != 0.0:  # after a stall
            gain = mem[model.FEEDBACK_GAIN] + RECOVERY
            mem[model.FEEDBACK_GAIN] = gain if gain < 1.0 else 0.0
        return
    mem[model.DELAYED], mem[model.LATENCY_SPREAD] = 0.0, 0.0
    mem[model.FEEDBACK_GAIN], mem[model.GAIN_REDUCTION] = 0.0, 0.0
    mem[model.SPREAD_SUMS], mem[model.SPREAD_SUMS + 1] = 0.0, 0.0
    for k in range(model.LATENCY_FIT, model.LAST_NEEDED):
        mem[k] = 0.0
    for k in range(model.FILTERED_NEEDED, model.LAST_INTERVAL):
        mem[k] = 0.0
    mem[model.MEASURED_LATENCY] = 0.0


@device_function
def acts_at_once(
    mem: Array,
    needed: tuple[Vector, Vector, Vector, Vector],
    n: int,
    weights: tuple[float, float, float, float],
    resolution: float,
) -> bool:
    """Whether the wrenches of the interval acted with their sample, within rounding.

    ``needed``: force and torque on A, on B, that the interval of n periods needed; ``weights`` of
    their squares. ``resolution``: sum of squares that is rounding.
    """
    missed = acted = change = 0.0
    last = min(n, MOST_HELD)
    for k in range(4):
        sent, before = _mean(mem, 0, last, 3 * k), _mean(mem, last, last, 3 * k)
        off, by = sub(needed[k], sent), sub(sent, before)
        missed += weights[k] * dot(off, off)
        acted += weights[k] * dot(sent, sent)
        change += weights[k] * dot(by, by)
    rounding = EXACT * EXACT * acted + resolution
    if missed <= rounding and change > 100.0 * rounding:
        mem[model.LOCK_STEP] = min(mem[model.LOCK_STEP] + 1.0, RETURN)
    return missed <= rounding


@inline_function
def is_lock_step(mem: Array) -> bool:
    """Whether the loop is in lock step, after an interval whose wrenches acted at once."""
    return mem[model.DELAYED] == 0.0 or mem[model.LOCK_STEP] >= RETURN


@inline_function
def is_tolerated(mem: Array) -> bool:
    """Whether the evidence of lock step outweighs an interval whose wrenches acted late."""
    evidence = mem[model.LOCK_STEP]
    tolerated = mem[model.DELAYED] == 0.0 and evidence >= DISAGREEMENT
    mem[model.LOCK_STEP] = evidence - DISAGREEMENT if tolerated else 0.0
    return tolerated


@device_function
def begin_interval(mem: Array) -> None:
    """Begin the sums of one interval."""
    for k in range(3 * (MAX_LATENCY + 1)):
        mem[model.INTERVAL_FIT + k] = 0.0


@device_function
def add_interval(mem: Array, at: int, needed: Vector, n: int, weight: float) -> None:
    """Add the force or torque that an interval of n periods needed.

    ``at``: its index among the 12 numbers of a sent wrench. ``weight``: of its squares.
    """
    last = int(mem[model.LAST_INTERVAL])
    before = model.vector(mem, model.LAST_NEEDED + at)
    model.write_vector(mem, model.LAST_NEEDED + at, needed)
    if n > MOST_HELD or last > MOST_HELD:
        return
    if last == 0:
        for j in range(MAX_LATENCY + 1):
            sent = _mean(mem, j, n, at)
            off = sub(needed, sent)
            mem[model.INTERVAL_FIT + 3 * j] += weight * dot(off, off)
            mem[model.INTERVAL_FIT + 3 * j + 2] += weight * dot(sent, sent)
        return
    seen = _filtered(mem, model.FILTERED_NEEDED + at, sub(needed, before))
    a = _filtered(mem, model.FILTERED_SENT + at, _change(mem, 0, n, last, at))
    for j in range(MAX_LATENCY + 1):
        change = _change(mem, j + 1, n, last, at)
        b = _filtered(mem, model.FILTERED_SENT + 12 * (j + 1) + at, change)
        s0 = s1 = s2 = 0.0
        for k in range(3):
            r, d = seen[k] - a[k], a[k] - b[k]
            s0, s1, s2 = s0 + r * r, s1 + r * d, s2 + d * d
        fit = model.INTERVAL_FIT + 3 * j
        mem[fit] += weight * s0
        mem[fit + 1] += weight * s1
        mem[fit + 2] += weight * s2
        a = b


@inline_function
def _take_interval(mem: Array) -> float:
    """Add the sums of the interval to those of all, by what they say; their weight."""
    unexplained, change = math.inf, 0.0
    for j in range(MAX_LATENCY + 1):
        fit = model.INTERVAL_FIT + 3 * j
        s0, s1, s2 = mem[fit], mem[fit + 1], mem[fit + 2]
        phi = min(max(-s1 / s2, 0.0), 1.0) if s2 > 0.0 else 0.0
        unexplained = min(unexplained, s0 + phi * (2.0 * s1 + phi * s2))
        change = max(change, s2)
    if change <= 0.0:
        return 0.0
    other = UNEXPLAINED * max(unexplained, 0.0)
    weight = change * change / (change * change + other * other)
    total = mem[model.FIT_CHANGE]
    share = FORGETTING * weight * min(1.0, change / (FORGETTING * total)) if total > 0.0 else 1.0
    for k in range(3 * (MAX_LATENCY + 1)):
        mem[model.LATENCY_FIT + k] *= 1.0 - share
        mem[model.LATENCY_FIT + k] += weight * mem[model.INTERVAL_FIT + k]
    mem[model.FIT_CHANGE] = (1.0 - share) * total + weight * change
    mem[model.SPREAD_SUMS] *= 1.0 - 0.5 * share
    mem[model.SPREAD_SUMS + 1] *= 1.0 - 0.5 * share
    return weight


@device_function
def begin_estimate(mem: Array) -> None:
    """After the first interval: the least whole latency that agrees with it, if one does.

    A wrench of which nothing was seen is at least as late as the interval is long.
    """
    fit = model.INTERVAL_FIT
    for j in range(MAX_LATENCY + 1):
        if mem[fit + 3 * j] < FIRST * mem[fit + 2]:
            if j > mem[model.MEASURED_LATENCY]:
                mem[model.MEASURED_LATENCY], mem[model.DELAYED] = j, 1.0
            return


@inline_function
def _fit(mem: Array, j: int, rounding: float) -> tuple[float, float]:
    """Phi of j and its misfit."""
    fit = model.LATENCY_FIT + 3 * j
    s0, s1, s2 = mem[fit], mem[fit + 1], mem[fit + 2]
    phi = 0.0
    if s2 > 0.0 and s0 > EXACT * s2 + rounding:
        phi = min(max(-s1 / s2, 0.0), 1.0)
    return phi, max(s0 + phi * (2.0 * s1 + phi * s2), 0.0)


@device_function
def estimate(mem: Array, resolution: float) -> None:
    """Estimate latency, spread and gain. ``resolution``: sum of squares that is rounding."""
    weight = _take_interval(mem)
    used = int(mem[model.MEASURED_LATENCY])
    now_phi = mem[model.MEASURED_LATENCY] - used
    rounding, now, greatest = 100.0 * resolution, 0.0, 0.0
    for j in range(MAX_LATENCY + 1):
        greatest = max(greatest, mem[model.LATENCY_FIT + 3 * j + 2])
        if j == used:
            phi, now = _fit(mem, j, rounding)
            if mem[model.LATENCY_FIT + 3 * j + 2] > rounding:
                now_phi = phi
    best, least, best_phi = used, now, now_phi
    for j in range(MAX_LATENCY + 1):
        phi, misfit = _fit(mem, j, rounding)
        allowed = SWITCH_RATIO
        if mem[model.LATENCY_FIT + 3 * j + 2] < INFORMED * greatest:
            allowed = SILENT
        elif abs(j - used) == 1:
            allowed = NEIGHBOUR_RATIO
        if misfit < min(allowed * now, 0.999 * least):
            best, least, best_phi = j, misfit, phi
    if best != used and now > rounding:
        if abs(best - used) > 1 or mem[model.LATENCY_SPREAD] < LEAST_SPREAD:
            reset_stick_position(mem)
            mem[model.FEEDBACK_GAIN] = min(_gain(mem), 1.0 / (1.0 + START * best))
        used, now_phi = best, best_phi
    if now_phi >= 0.999999:
        used, now_phi = used + 1, 0.0
    if used >= MAX_LATENCY:  # no later wrench is stored
        used, now_phi = MAX_LATENCY, 0.0
    mem[model.MEASURED_LATENCY] = used + now_phi
    if mem[model.MEASURED_LATENCY] > 0.0:
        mem[model.DELAYED] = 1.0
    fit = model.INTERVAL_FIT + 3 * used
    along, across = mem[fit + 1] + now_phi * mem[fit + 2], mem[fit + 2]
    rest = mem[fit] + now_phi * (2.0 * mem[fit + 1] + now_phi * across)
    whole = MIXED * min(max(0.5 * mem[model.MEASURED_LATENCY] - 1.0, 0.0), 1.0)
    mem[model.SPREAD_SUMS] += weight * (along * along + whole * max(rest, 0.0) * across)
    mem[model.SPREAD_SUMS + 1] += weight * across * across
    update_gain(mem)


@inline_function
def _gain(mem: Array) -> float:
    return mem[model.FEEDBACK_GAIN] if mem[model.FEEDBACK_GAIN] > 0.0 else 1.0


@device_function
def update_gain(mem: Array) -> None:
    """Spread and gain from the sums."""
    spread, weight = 0.0, mem[model.SPREAD_SUMS + 1]
    if weight > 0.0 and mem[model.DELAYED] != 0.0:
        spread = math.sqrt(mem[model.SPREAD_SUMS] / weight)
        spread = min(spread, 0.3 + 0.5 * mem[model.MEASURED_LATENCY])
    mem[model.LATENCY_SPREAD] = spread
    wanted = 1.0 - mem[model.GAIN_REDUCTION]
    if spread > LEAST_SPREAD:
        wanted = max(wanted / (1.0 + GAIN_SPREAD * spread), LEAST_GAIN)
    gain = _gain(mem)
    if wanted < gain:
        gain = wanted
    elif wanted < 1.0:
        gain += RECOVERY * (wanted - gain)
    else:
        gain = min(gain + RECOVERY, 1.0)
    mem[model.FEEDBACK_GAIN] = gain
