"""Delay compensation: prediction of the state when the wrench acts, and estimation of the latency.

A wrench that acts d periods after its sample is computed for the predicted state at that time.
Until then the bodies move under wrenches that have already been sent:

    from t_k + i h to t_k + (i + 1) h, i < d:    the wrench of the sample at t_k + (i - d) h,
                                                 or the last one before it if that was lost

Loads are held. A body of unknown inertia, and a driven body, keeps its twist.

If d is not given, it is estimated: the d for which m dv/dt = F(d) + m g + load fits the velocities
of the mass centres best over the last samples. F is the mean of the wrenches held since the
previous sample, if samples between were lost. The position that stick holds is a predicted one, so
that it is redefined when d changes.

The work is that of the wrenches that acted on the measured motion (core/passivity.py).
"""

import math

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.layout import MAX_LATENCY
from cylconn_ros.core.passivity import add_work, has_jumped, reset_stick_position
from cylconn_ros.core.plant import advance_body, motion_of
from cylconn_ros.core.relative_state import measure
from cylconn_ros.core.rigid_body import Body
from cylconn_ros.core.vectors import add, add_scaled, dot, normalised, scale, sub

FORGETTING = 0.9  # factor on the misfit of earlier samples: about ten of them count
SWITCH_RATIO = 0.25  # misfit of another latency over that in use, below which it replaces it
VARIATION_GAIN = 5.0  # times the relative error of a period: a fifth counts in full
LEAST_MISFIT = 1e-18  # relative to the greatest misfit; below it is rounding


@inline_function
def is_delayed(par: Array) -> bool:
    """Whether wrenches act later than their sample."""
    return par[model.LATENCY] != 0.0


@inline_function
def latency_of(par: Array, mem: Array) -> int:
    """The latency in periods: as given, or as estimated so far."""
    given = int(par[model.LATENCY])
    return given if given >= 0 else int(mem[model.MEASURED_LATENCY])


@inline_function
def correction_share(par: Array, mem: Array) -> float:
    """Share of a position error that one wrench removes."""
    if not is_delayed(par):
        return 1.0
    return 1.0 / (1.0 + latency_of(par, mem) * mem[model.PERIOD_VARIATION])


@inline_function
def store_sent_wrenches(mem: Array, acted: bool) -> None:
    """Store the wrench of this step, newest first; zero if none was computed."""
    for k in range(12 * MAX_LATENCY - 1, -1, -1):
        mem[model.SENT_WRENCHES + 12 + k] = mem[model.SENT_WRENCHES + k]
    for k in range(6):
        mem[model.SENT_WRENCHES + k] = mem[model.LAST_A + k] if acted else 0.0
        mem[model.SENT_WRENCHES + 6 + k] = mem[model.LAST_B + k] if acted else 0.0


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
        periods = min(max(int(mem[model.LAST_PERIOD] / h + 0.5), 1), MAX_LATENCY + 1)
    for _ in range(periods - 1):  # samples were lost: the last wrench was held
        for k in range(12 * MAX_LATENCY - 1, -1, -1):
            mem[model.SENT_WRENCHES + 12 + k] = mem[model.SENT_WRENCHES + k]
    for k in range(layout.NSAMPLE):
        current[k] = sample[k]
    for at in (layout.A_POSE, layout.B_POSE):
        q = normalised(model.quaternion(current, at + 3))
        for k in range(4):
            current[at + 3 + k] = q[k]
    mem[model.JUMPED] = 0.0
    if mem[model.HAS_REFERENCE] == 0.0:
        mem[model.PERIOD_VARIATION] = 1.0
    elif mem[model.LAST_PERIOD] > 0.0:
        dt = mem[model.LAST_PERIOD] / periods
        off = min(VARIATION_GAIN * abs(mem[model.LAST_PERIOD] / h - 1.0), 1.0)
        mem[model.PERIOD_VARIATION] = max(FORGETTING * mem[model.PERIOD_VARIATION], off)
        if par[model.LATENCY] < 0.0:
            _measure_latency(par, mem, current, body_a, body_b, periods, dt)
        work_a, jump_a = _work(par, mem, current, body_a, 0, periods, dt)
        work_b, jump_b = _work(par, mem, current, body_b, 1, periods, dt)
        add_work(mem, work_a)
        add_work(mem, work_b)
        mem[model.JUMPED] = 1.0 if jump_a or jump_b else 0.0
    for k in range(layout.A_LOAD):
        mem[model.LAST_SAMPLE + k] = current[k]
    late = latency_of(par, mem)
    if mem[model.HAS_REFERENCE] == 0.0:
        measure(par, mem, current, out)
        mem[model.LAST_PERIOD] = late * h
    for i in range(late):
        at = model.SENT_WRENCHES + 12 * (late - 1 - i)
        for k in range(2):
            body = body_a if k == 0 else body_b
            force, torque = model.vector(mem, at + 6 * k), model.vector(mem, at + 6 * k + 3)
            pose = layout.A_POSE if k == 0 else layout.B_POSE
            advance_body(par, body, current, pose, force, torque, current, layout.A_LOAD + 6 * k, h)


@inline_function
def _sent_at(mem: Array, late: int, j: int) -> int:
    """Index in ``mem`` of the wrenches that acted ``j`` periods before the last one."""
    return model.SENT_WRENCHES + 12 * min(late + j, MAX_LATENCY)


@inline_function
def _add_misfits(
    par: Array, mem: Array, current: Array, k: int, body: Body, periods: int, dt: float
) -> None:
    """Add the misfit of each latency for the velocity change of body k.

    The misfit is a squared force, N^2, the mean over all periods since the last sample.
    """
    at = layout.A_POSE if k == 0 else layout.B_POSE
    load = model.vector(current, layout.A_LOAD + 6 * k)
    before = motion_of(body, mem[model.LAST_SAMPLE : model.LAST_SAMPLE_END], at).velocity
    v = motion_of(body, current, at).velocity
    weight = scale(body.mass, model.vector(par, model.GRAVITY))
    needed = sub(scale(body.mass / (periods * dt), sub(v, before)), add_scaled(load, 1.0, weight))
    for d in range(MAX_LATENCY + 1):
        apart = needed
        for j in range(periods):
            apart = add_scaled(
                apart, -1.0 / periods, model.vector(mem, _sent_at(mem, d, j) + 6 * k)
            )
        mem[model.LATENCY_MISFIT + d] += dot(apart, apart)


@inline_function
def _measure_latency(
    par: Array, mem: Array, current: Array, body_a: Body, body_b: Body, periods: int, dt: float
) -> None:
    """Estimate the latency from the measured velocities and the sent wrenches."""
    if periods > MAX_LATENCY:
        return
    for d in range(MAX_LATENCY + 1):
        mem[model.LATENCY_MISFIT + d] *= FORGETTING
    for k in range(2):
        body = body_a if k == 0 else body_b
        if body.free:
            _add_misfits(par, mem, current, k, body, periods, dt)
    greatest, best, least = 0.0, 0, math.inf
    for d in range(MAX_LATENCY + 1):
        misfit = mem[model.LATENCY_MISFIT + d]
        greatest = max(greatest, misfit)
        if misfit < least:
            best, least = d, misfit
    now = mem[model.LATENCY_MISFIT + int(mem[model.MEASURED_LATENCY])]
    if least < SWITCH_RATIO * now and now > LEAST_MISFIT * greatest:
        mem[model.MEASURED_LATENCY], mem[model.PERIOD_VARIATION] = best, 1.0
        reset_stick_position(mem)


@device_function
def _work(
    par: Array, mem: Array, current: Array, body: Body, k: int, periods: int, dt: float
) -> tuple[float, bool]:
    """The work on body k since the last sample, J, and whether the body has jumped.

    The motion since the last sample is simulated again, wrench by wrench. Its difference from the
    measured motion is distributed over the periods unless it is a jump.
    """
    at, late = layout.A_POSE if k == 0 else layout.B_POSE, latency_of(par, mem)
    state, h = mem[model.LAST_SAMPLE : model.LAST_SAMPLE_END], periods * dt
    first, measured = motion_of(body, state, at), motion_of(body, current, at)
    work, mean, turn = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    m = first
    for i in range(periods):
        acted = _sent_at(mem, late, periods - 1 - i) + 6 * k
        force, torque = model.vector(mem, acted), model.vector(mem, acted + 3)
        advance_body(par, body, state, at, force, torque, current, layout.A_LOAD + 6 * k, dt)
        last, m = m, motion_of(body, state, at)
        work += dot(force, sub(m.com, last.com)) + 0.5 * dt * dot(torque, add(m.spin, last.spin))
        mean = add_scaled(mean, 1.0 / periods, force)
        turn = add_scaled(turn, dt * (i + 0.5) / periods, torque)
    moved, expected = sub(measured.com, first.com), scale(h, measured.velocity)
    apart, late_by = sub(measured.com, m.com), sub(moved, expected)
    halfway = add_scaled(late_by, 0.5 * h, sub(measured.velocity, first.velocity))
    least = min(dot(apart, apart), dot(late_by, late_by), dot(halfway, halfway))
    if has_jumped(par, moved, expected, least, h):
        return work, True
    return work + dot(mean, apart) + dot(turn, sub(measured.spin, m.spin)), False
