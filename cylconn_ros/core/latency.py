"""Delay compensation: prediction of the state when the wrench acts.

A wrench that acts tau = j + phi periods after its sample is computed for the predicted state at
that time. Until then the bodies move under wrenches that have already been sent:

    for phi h, then j times h:    the wrenches sent j + 1, j, ..., 1 periods before this sample, or
                                  the last one before it if a sample was lost

Loads are held. A body of unknown inertia, and a driven body, keeps its twist.

If the latency is not given, it is measured (core/latency_estimation.py). Where it is to be
checked, a given one is compared with the measured one; one of 1 or more is replaced by it while the
motion refutes it, and until then the measurement has no effect. One of 0 is kept: wrenches for the
samples as they are, whatever moves the bodies. For this the motion since the last sample is
simulated again under the wrenches that acted; its difference from the measured motion gives the
mean wrench that the interval needed. The work is that of the wrenches that acted on the measured
motion (core/passivity.py).
"""

from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import is_checked, is_delayed, is_measured, latency_of
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.latency_estimation import (
    RESOLUTION,
    acts_at_once,
    add_interval,
    begin_estimate,
    begin_interval,
    estimate,
    forget,
    is_lock_step,
    is_tolerated,
    keep_needed,
    update_gain,
)
from cylconn_ros.core.layout import MAX_LATENCY, SENT_PERIODS
from cylconn_ros.core.passivity import add_work, control_gain, has_jumped, reset_stick_position
from cylconn_ros.core.plant import advance_body, motion_of
from cylconn_ros.core.relative_state import check_twist, measure
from cylconn_ros.core.rigid_body import Body
from cylconn_ros.core.stalls import find_stall, interval_by_motion, is_stalled
from cylconn_ros.core.vectors import (
    Vector,
    add,
    add_scaled,
    dot,
    into,
    matrix,
    norm,
    normalised,
    out_of,
    scale,
    sub,
    times,
)

FORGETTING = 0.9  # factor on the variation of earlier periods
VARIATION_GAIN = 5.0  # times the relative error of a period: a fifth counts in full
ANOTHER = 0.5  # periods: a change of the estimate beyond it has yet to be confirmed
EVEN = 0.05  # variation of a period up to which a motion tells the integration of the plant
MISFIT_KEPT = 0.9  # factor on earlier misfits
REFUTED = 0.5  # periods: difference of the measured latency from a declared one that refutes it
CONFIRMING = 50.0  # intervals in succession that confirm a refuted latency
_KEPT = 12 * (SENT_PERIODS - 1)


@inline_function
def store_sent_wrenches(mem: Array, acted: bool) -> None:
    """Store the wrench of this step, newest first; zero if none was computed."""
    for k in range(_KEPT - 1, -1, -1):
        mem[model.SENT_WRENCHES + 12 + k] = mem[model.SENT_WRENCHES + k]
    for k in range(12):
        mem[model.SENT_WRENCHES + k] = mem[model.HELD_WRENCH + k] if acted else 0.0


@device_function
def predict_sample(par: Array, mem: Array, sample: Array, h: float, out: Array) -> None:
    """Write the sample predicted for the time of action into ``mem`` at PREDICTED_SAMPLE.

    The first sample defines the reference configuration without prediction; ``out`` then serves as
    scratch space.
    """
    current = mem[model.PREDICTED_SAMPLE : model.PREDICTED_SAMPLE + layout.NSAMPLE]
    body_a, body_b = model.body(par, model.BODY_A), model.body(par, model.BODY_B)
    periods = 1
    if mem[model.HAS_REFERENCE] != 0.0 and mem[model.LAST_PERIOD] > 0.0:
        stamped = mem[model.LAST_PERIOD]
        mem[model.LAST_PERIOD] = interval_by_motion(par, mem, sample, body_a, body_b, h)
        if mem[model.LAST_PERIOD] != stamped:
            _note_stamps(mem, sample, body_a, body_b, stamped)
        periods = min(max(int(mem[model.LAST_PERIOD] / h + 0.5), 1), MAX_LATENCY + 1)
    for _ in range(periods - 1):  # samples were lost: the last wrench was held
        for k in range(_KEPT - 1, -1, -1):
            mem[model.SENT_WRENCHES + 12 + k] = mem[model.SENT_WRENCHES + k]
    for k in range(layout.NSAMPLE):
        current[k] = sample[k]
    for at in (layout.A_POSE, layout.B_POSE):
        q = normalised(model.quaternion(current, at + 3))
        for k in range(4):
            current[at + 3 + k] = q[k]
    _take_up(par, mem, current, body_a, body_b, h, periods)
    for k in range(layout.NSAMPLE):
        mem[model.LAST_SAMPLE + k] = current[k]
    if not is_delayed(par, mem):
        return
    late = latency_of(par, mem)
    whole = int(late)
    if mem[model.HAS_REFERENCE] == 0.0:
        measure(par, mem, current, h, out)
        mem[model.LAST_PERIOD] = late * h
    for i in range(-1, whole):
        dt = (late - whole) * h if i < 0 else h
        if dt == 0.0:
            continue
        at = model.SENT_WRENCHES + 12 * (whole - 1 - i)
        if is_stalled(mem):
            at = model.STALLED_WRENCH
        for k in range(2):
            body = body_a if k == 0 else body_b
            force, torque = model.vector(mem, at + 6 * k), model.vector(mem, at + 6 * k + 3)
            pose = layout.A_POSE if k == 0 else layout.B_POSE
            advance_body(
                par, body, current, pose, force, torque, current, layout.A_LOAD + 6 * k, dt
            )


@device_function
def _note_stamps(mem: Array, sample: Array, body_a: Body, body_b: Body, stamped: float) -> None:
    """Note that the motion contradicts the interval of the stamps, for the diagnostics."""
    before = mem[model.LAST_SAMPLE : model.LAST_SAMPLE + layout.NSAMPLE]
    for k in range(2):
        body, at = (body_a, layout.A_POSE) if k == 0 else (body_b, layout.B_POSE)
        if body.free:
            m, now = motion_of(body, before, at), motion_of(body, sample, at)
            check_twist(mem, k, sub(now.com, m.com), m.velocity, now.velocity, stamped)


@inline_function
def _take_up(
    par: Array, mem: Array, current: Array, body_a: Body, body_b: Body, h: float, periods: int
) -> None:
    """Take up the motion since the last sample: its work, jumps, and the latency."""
    mem[model.CONTRADICTED] = 0.0
    if mem[model.HAS_REFERENCE] == 0.0:
        mem[model.JUMPED], mem[model.PERIOD_VARIATION], mem[model.LAST_INTERVAL] = 0.0, 1.0, 0.0
    elif mem[model.LAST_PERIOD] > 0.0:
        dt = mem[model.LAST_PERIOD] / periods
        off = min(VARIATION_GAIN * abs(mem[model.LAST_PERIOD] / h - 1.0), 1.0)
        mem[model.PERIOD_VARIATION] = max(FORGETTING * mem[model.PERIOD_VARIATION], off)
        before = latency_of(par, mem)
        a = _replay(par, mem, current, body_a, 0, periods, dt)
        b = _replay(par, mem, current, body_b, 1, periods, dt)
        if is_measured(par, mem):
            stalled = is_stalled(mem)
            _measure_latency(par, mem, body_a, body_b, a, b, periods)
            shift = (latency_of(par, mem) - before) * h
            # the interval between the predicted samples; and its work
            if shift != 0.0 or stalled != is_stalled(mem):
                mem[model.LAST_PERIOD] = max(mem[model.LAST_PERIOD] + shift, 0.01 * h)
                a = _replay(par, mem, current, body_a, 0, periods, dt)
                b = _replay(par, mem, current, body_b, 1, periods, dt)
        elif is_checked(par):
            held = mem[model.STICK_SAMPLES]
            _measure_latency(par, mem, body_a, body_b, a, b, periods)
            mem[model.STICK_SAMPLES] = held
        if is_checked(par):
            _check_declared(par, mem)
        if is_delayed(par, mem):
            add_work(mem, a.work)
            add_work(mem, b.work)
            mem[model.JUMPED] = 1.0 if a.jump or b.jump else 0.0
            if periods == 1 and off < EVEN and not (a.jump or b.jump):
                at = model.INTEGRATION_MISFIT
                mem[at] = MISFIT_KEPT * mem[at] + a.apart_halfway + b.apart_halfway
                mem[at + 1] = MISFIT_KEPT * mem[at + 1] + a.apart_late + b.apart_late
            # the springs of an elastic constraint store energy, too: its balance tells nothing
            if is_measured(par, mem) and par[model.PENALTY] == 0.0:
                balance = mem[model.WORK] - mem[model.ACTUATION_WORK] + mem[model.SPRING_ENERGY]
                control_gain(mem, balance, abs(a.work) + abs(b.work))


class Interval(NamedTuple):
    """The motion of a body since the last sample.

    work: J. jump: whether it has jumped. force, torque: the mean wrench about the mass centre that
    its change of velocity needed, N and N.m. size: of force and momentum rates, N, for rounding.
    apart_halfway, apart_late: squared differences from an exact and from a semi-implicit motion.
    """

    work: float
    jump: bool
    force: Vector
    torque: Vector
    size: float
    apart_halfway: float
    apart_late: float


@inline_function
def _measure_latency(
    par: Array, mem: Array, body_a: Body, body_b: Body, a: Interval, b: Interval, periods: int
) -> None:
    """Add the interval to the estimate of the latency."""
    if a.jump or b.jump:
        mem[model.LAST_INTERVAL] = 0.0
        return
    resolution = body_a.inverse_mass * a.size * a.size + body_b.inverse_mass * b.size * b.size
    needed = (a.force, a.torque, b.force, b.torque)
    weights = (*_weights(body_a), *_weights(body_b))
    at_once = acts_at_once(mem, needed, periods, weights, resolution)
    if at_once and is_lock_step(mem):
        mem[model.STALLED] = 0.0
        forget(mem, needed, periods)
        return
    # stalls change the stored wrenches, with which a declared latency predicts
    in_use = is_measured(par, mem)
    if in_use and find_stall(par, mem, needed, periods, weights, resolution):
        keep_needed(mem, needed, periods)
        update_gain(mem)
        return
    if not at_once and is_tolerated(mem):
        forget(mem, needed, periods)
        return
    begin_interval(mem)
    for k in range(2):
        body, seen = (body_a, a) if k == 0 else (body_b, b)
        if body.free:
            add_interval(mem, 6 * k, seen.force, periods, weights[2 * k])
            add_interval(mem, 6 * k + 3, seen.torque, periods, weights[2 * k + 1])
    if mem[model.LAST_INTERVAL] > 0.0:
        before = mem[model.MEASURED_LATENCY]
        estimate(mem, resolution)
        if abs(mem[model.MEASURED_LATENCY] - before) > ANOTHER:
            mem[model.AGREED] = 0.0
    elif mem[model.FIT_CHANGE] == 0.0:
        begin_estimate(mem)
    mem[model.LAST_INTERVAL] = periods


@inline_function
def _check_declared(par: Array, mem: Array) -> None:
    """Take the measured latency while it refutes the declared one, which may be confirmed later.

    Until a wrench has been seen to act, the measured latency is a lower bound that rises by one
    with each interval.
    """
    declared, at_once = par[model.LATENCY], mem[model.LOCK_STEP] > 0.0
    if declared == 0.0 or mem[model.LAST_INTERVAL] == 0.0:
        return
    if not at_once and mem[model.DELAYED] == 0.0 and mem[model.FIT_CHANGE] == 0.0:
        return  # nothing is known
    refutes = abs(mem[model.MEASURED_LATENCY] - declared) > REFUTED
    if refutes == (mem[model.REFUTED] != 0.0):
        mem[model.CONTRARY] = 0.0
        return
    mem[model.CONTRARY] += 1.0
    wanted = 1.0
    if not refutes:
        wanted = CONFIRMING
    elif not at_once and mem[model.MEASURED_LATENCY] < declared:
        wanted = declared + 1.0
    if mem[model.CONTRARY] >= wanted:
        mem[model.REFUTED], mem[model.CONTRARY] = 1.0 if refutes else 0.0, 0.0
        reset_stick_position(mem)


@inline_function
def _inverse_inertia(body: Body) -> float:
    """The inverse of the mean principal inertia; zero if infinite."""
    total = body.inertia[0] + body.inertia[3] + body.inertia[5]
    return 3.0 / total if total > 0.0 else 0.0


@inline_function
def _weights(body: Body) -> tuple[float, float]:
    """Weights of the squares of force and torque; zero for a body that is not free."""
    if not body.free:
        return (0.0, 0.0)
    return (body.inverse_mass, _inverse_inertia(body))


@inline_function
def _sent_at(mem: Array, late: int, j: int) -> int:
    """Index in ``mem`` of the wrenches that acted ``j`` periods before the last one."""
    return model.SENT_WRENCHES + 12 * min(late + j, SENT_PERIODS - 1)


@device_function
def _replay(
    par: Array, mem: Array, current: Array, body: Body, k: int, periods: int, dt: float
) -> Interval:
    """Simulate the motion of body k since the last sample again, wrench by wrench.

    Its difference from the measured motion is distributed over the periods unless it is a jump.
    """
    at, late = layout.A_POSE if k == 0 else layout.B_POSE, latency_of(par, mem)
    whole = int(late)
    part = late - whole
    state = mem[model.SIMULATED_SAMPLE : model.SIMULATED_SAMPLE + layout.NSAMPLE]
    for i in range(layout.NSAMPLE):
        state[i] = mem[model.LAST_SAMPLE + i]
    h = periods * dt
    first, measured = motion_of(body, state, at), motion_of(body, current, at)
    work, mean, turn = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    m, torques = first, (0.0, 0.0, 0.0)
    for i in range(2 * periods):
        share = part if i % 2 == 0 else 1.0 - part
        if share == 0.0:
            continue
        acted = _sent_at(mem, whole + 1 - i % 2, periods - 1 - i // 2) + 6 * k
        if is_stalled(mem):
            acted = model.STALLED_WRENCH + 6 * k
        force, torque = model.vector(mem, acted), model.vector(mem, acted + 3)
        advance_body(par, body, state, at, force, torque, state, layout.A_LOAD + 6 * k, share * dt)
        last, m = m, motion_of(body, state, at)
        turning = 0.5 * share * dt * dot(torque, add(m.spin, last.spin))
        work += dot(force, sub(m.com, last.com)) + turning
        mean = add_scaled(mean, share / periods, force)
        torques = add_scaled(torques, share / periods, torque)
        turn = add_scaled(turn, share * dt * (i // 2 + 0.5) / periods, torque)
    moved, expected = sub(measured.com, first.com), scale(h, measured.velocity)
    check_twist(mem, k, moved, first.velocity, measured.velocity, h)
    apart, late_by = sub(measured.com, m.com), sub(moved, expected)
    halfway = add_scaled(late_by, 0.5 * h, sub(measured.velocity, first.velocity))
    apart_late, apart_halfway = dot(late_by, late_by), dot(halfway, halfway)
    least = min(dot(apart, apart), apart_late, apart_halfway)
    faster = sub(measured.velocity, m.velocity)
    axes = matrix(measured.orientation)
    spun = out_of(axes, times(body.inertia, into(axes, sub(measured.spin, m.spin))))
    jump = has_jumped(par, moved, expected, least, h)
    if not jump:
        work += dot(mean, apart) + dot(turn, sub(measured.spin, m.spin))
    if not body.free:
        return Interval(work, jump, mean, torques, 0.0, apart_halfway, apart_late)
    force, torque = add_scaled(mean, body.mass / h, faster), add_scaled(torques, 1.0 / h, spun)
    size = RESOLUTION * (norm(force) + body.mass / h * norm(measured.velocity))
    return Interval(work, jump, force, torque, size, apart_halfway, apart_late)
