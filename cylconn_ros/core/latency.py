"""Late wrenches: where both bodies will be when the wrench acts, from what they have been sent.

An answer that acts d periods after its sample is computed for the state at that time. Until then
the bodies move under wrenches that are known, having been sent:

    from t_k + i h to t_k + (i + 1) h, i < d:    the wrench of the sample at t_k + (i - d) h,
                                                 or the last one before it, where that was lost

Loads are held. A body of unknown inertia, and one that moves on its own, goes on as it does.

Where d is not given it is measured: of all d, the one with which m dv/dt = F(d) + m g + load fits
the mass centres' velocities best over the last samples; F is the mean of what was held since the
last sample, where some between were lost. A place that stick holds is where it was foreseen: with
another d it is another one.

Work is counted on the motion that was, of the wrenches that acted on it (core/passivity.py).
"""

import math

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.layout import MOST_LATE
from cylconn_ros.core.passivity import count, jumped, release
from cylconn_ros.core.plant import advanced, motion_of
from cylconn_ros.core.relative_state import observe
from cylconn_ros.core.rigid_body import Body
from cylconn_ros.core.vectors import add, add_scaled, dot, normalised, scale, sub

KEPT = 0.9  # of the misfit of earlier samples: some ten count
BETTER = 0.25  # misfit, over that of the latency in use, which makes another one take over
UNEVENNESS = 5.0  # times the share by which a period is off: from a fifth on it counts in full
LEAST_MISFIT = 1e-18  # of a force over the weight of its history, squared: below it is rounding


@inline_function
def is_late(par: Array) -> bool:
    """Whether wrenches act later than at their sample."""
    return par[model.LATENCY] != 0.0


@inline_function
def periods_late(par: Array, mem: Array) -> int:
    """How many periods after its sample a wrench acts: given, or measured so far."""
    given = int(par[model.LATENCY])
    return given if given >= 0 else int(mem[model.LATE])


@inline_function
def share_removed(par: Array, mem: Array) -> float:
    """Of an error of position, what one wrench is to remove."""
    if not is_late(par):
        return 1.0
    return 1.0 / (1.0 + periods_late(par, mem) * mem[model.UNEVEN])


@inline_function
def remember_sent(mem: Array, acted: bool) -> None:
    """Put the answer's wrench in front of those sent before; zero where nothing was sent."""
    for k in range(12 * MOST_LATE - 1, -1, -1):
        mem[model.SENT + 12 + k] = mem[model.SENT + k]
    for k in range(6):
        mem[model.SENT + k] = mem[model.LAST_A + k] if acted else 0.0
        mem[model.SENT + 6 + k] = mem[model.LAST_B + k] if acted else 0.0


@device_function
def predict(par: Array, mem: Array, sample: Array, h: float, out: Array) -> None:
    """Write the sample as it will be when its wrench acts into ``mem`` at AHEAD.

    A first sample is the reference configuration as it is; ``out`` is then written to on the way.
    """
    here = mem[model.AHEAD : model.AHEAD + layout.NSAMPLE]
    body_a, body_b = model.body(par, model.BODY_A), model.body(par, model.BODY_B)
    gone = 1
    if mem[model.STARTED] != 0.0 and mem[model.LAST_PERIOD] > 0.0:
        gone = min(max(int(mem[model.LAST_PERIOD] / h + 0.5), 1), MOST_LATE + 1)
    for _ in range(gone - 1):  # samples were lost: the last wrench was held
        for k in range(12 * MOST_LATE - 1, -1, -1):
            mem[model.SENT + 12 + k] = mem[model.SENT + k]
    for k in range(layout.NSAMPLE):
        here[k] = sample[k]
    for at in (layout.A_POSE, layout.B_POSE):
        q = normalised(model.quaternion(here, at + 3))
        for k in range(4):
            here[at + 3 + k] = q[k]
    mem[model.JUMPED] = 0.0
    if mem[model.STARTED] == 0.0:
        mem[model.UNEVEN] = 1.0
    elif mem[model.LAST_PERIOD] > 0.0:
        dt = mem[model.LAST_PERIOD] / gone
        off = min(UNEVENNESS * abs(mem[model.LAST_PERIOD] / h - 1.0), 1.0)
        mem[model.UNEVEN] = max(KEPT * mem[model.UNEVEN], off)
        if par[model.LATENCY] < 0.0:
            _measure(par, mem, here, body_a, body_b, gone, dt)
        work_a, jump_a = _work(par, mem, here, body_a, 0, gone, dt)
        work_b, jump_b = _work(par, mem, here, body_b, 1, gone, dt)
        count(mem, work_a)
        count(mem, work_b)
        mem[model.JUMPED] = 1.0 if jump_a or jump_b else 0.0
    for k in range(layout.A_LOAD):
        mem[model.SEEN + k] = here[k]
    late = periods_late(par, mem)
    if mem[model.STARTED] == 0.0:
        observe(par, mem, here, out)
        mem[model.LAST_PERIOD] = late * h
    for i in range(late):
        at = model.SENT + 12 * (late - 1 - i)
        for k in range(2):
            body = body_a if k == 0 else body_b
            force, torque = model.vector(mem, at + 6 * k), model.vector(mem, at + 6 * k + 3)
            pose = layout.A_POSE if k == 0 else layout.B_POSE
            advanced(par, body, here, pose, force, torque, here, layout.A_LOAD + 6 * k, h)


@inline_function
def _acted(mem: Array, late: int, j: int) -> int:
    """Where in ``mem`` the wrenches stand that acted ``j`` periods before the last one."""
    return model.SENT + 12 * min(late + j, MOST_LATE)


@inline_function
def _fits(par: Array, mem: Array, here: Array, k: int, body: Body, gone: int, dt: float) -> None:
    """Add to every latency's misfit how badly it explains the change of velocity of body k.

    The misfit is a force squared; over ``gone`` periods, their mean.
    """
    at = layout.A_POSE if k == 0 else layout.B_POSE
    load = model.vector(here, layout.A_LOAD + 6 * k)
    before = motion_of(body, mem[model.SEEN : model.AFTER_SEEN], at).velocity
    v = motion_of(body, here, at).velocity
    weight = scale(body.mass, model.vector(par, model.GRAVITY))
    needed = sub(scale(body.mass / (gone * dt), sub(v, before)), add_scaled(load, 1.0, weight))
    for d in range(MOST_LATE + 1):
        apart = needed
        for j in range(gone):
            apart = add_scaled(apart, -1.0 / gone, model.vector(mem, _acted(mem, d, j) + 6 * k))
        mem[model.MISFIT + d] += dot(apart, apart)


@inline_function
def _measure(
    par: Array, mem: Array, here: Array, body_a: Body, body_b: Body, gone: int, dt: float
) -> None:
    """Keep the latency with which the wrenches sent explain the velocities seen."""
    if gone > MOST_LATE:
        return
    for d in range(MOST_LATE + 1):
        mem[model.MISFIT + d] *= KEPT
    for k in range(2):
        body = body_a if k == 0 else body_b
        if body.free:
            _fits(par, mem, here, k, body, gone, dt)
    greatest, best, least = 0.0, 0, math.inf
    for d in range(MOST_LATE + 1):
        misfit = mem[model.MISFIT + d]
        greatest = max(greatest, misfit)
        if misfit < least:
            best, least = d, misfit
    now = mem[model.MISFIT + int(mem[model.LATE])]
    if least < BETTER * now and now > LEAST_MISFIT * greatest:
        mem[model.LATE], mem[model.UNEVEN] = best, 1.0
        release(mem)


@device_function
def _work(
    par: Array, mem: Array, here: Array, body: Body, k: int, gone: int, dt: float
) -> tuple[float, bool]:
    """The work on body k since the last sample, and whether it has jumped.

    The motion is gone through again from the last sample, wrench by wrench; what it then differs by
    from the motion seen is spread over the periods, unless it is a jump.
    """
    at, late = layout.A_POSE if k == 0 else layout.B_POSE, periods_late(par, mem)
    state, h = mem[model.SEEN : model.AFTER_SEEN], gone * dt
    first, seen = motion_of(body, state, at), motion_of(body, here, at)
    work, mean, turn = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    m = first
    for i in range(gone):
        acted = _acted(mem, late, gone - 1 - i) + 6 * k
        force, torque = model.vector(mem, acted), model.vector(mem, acted + 3)
        advanced(par, body, state, at, force, torque, here, layout.A_LOAD + 6 * k, dt)
        last, m = m, motion_of(body, state, at)
        work += dot(force, sub(m.com, last.com)) + 0.5 * dt * dot(torque, add(m.spin, last.spin))
        mean = add_scaled(mean, 1.0 / gone, force)
        turn = add_scaled(turn, dt * (i + 0.5) / gone, torque)
    moved, told = sub(seen.com, first.com), scale(h, seen.velocity)
    apart, late_by = sub(seen.com, m.com), sub(moved, told)
    halfway = add_scaled(late_by, 0.5 * h, sub(seen.velocity, first.velocity))
    least = min(dot(apart, apart), dot(late_by, late_by), dot(halfway, halfway))
    if jumped(par, moved, told, least, h):
        return work, True
    return work + dot(mean, apart) + dot(turn, sub(seen.spin, m.spin)), False
