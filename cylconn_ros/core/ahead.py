"""Late wrenches: where both bodies will be when the wrench acts, from what they have been sent.

An answer that acts d periods after its sample is computed for the state at that time. Until then
the bodies move under wrenches that are known, having been sent:

    from t_k + i h to t_k + (i + 1) h, i < d:    the wrench of the sample at t_k + (i - d) h,
                                                 or the last one before it, where that was lost

Loads are held. A body of unknown inertia, and one that moves on its own, goes on as it does.

Where d is not given it is measured: of all d, the one with which m dv/h = F(d) + m g + load fits
the mass centres' velocities best over the last samples.
"""

import math

from cylconn_ros.core import layout, model
from cylconn_ros.core.bodies import Body
from cylconn_ros.core.compiled import inline, jit
from cylconn_ros.core.friction import Array
from cylconn_ros.core.layout import MOST_LATE
from cylconn_ros.core.observe import observe
from cylconn_ros.core.plant import advanced, motion_of
from cylconn_ros.core.vectors import Vector, add_scaled, dot, normalised, scale, sub

KEPT = 0.9  # of the misfit of earlier samples: some ten count
BETTER = 0.25  # misfit, over that of the latency in use, which makes another one take over
LEAST_MISFIT = 1e-18  # of a force over the weight of its history, squared: below it is rounding


@inline
def is_late(par: Array) -> bool:
    """Whether wrenches act later than at their sample."""
    return par[model.LATENCY] != 0.0


@inline
def periods_late(par: Array, mem: Array) -> int:
    """How many periods after its sample a wrench acts: given, or measured so far."""
    given = int(par[model.LATENCY])
    return given if given >= 0 else int(mem[model.LATE])


@inline
def remember_sent(mem: Array, acted: bool) -> None:
    """Put the answer's wrench in front of those sent before; zero where nothing was sent."""
    for k in range(12 * MOST_LATE - 1, -1, -1):
        mem[model.SENT + 12 + k] = mem[model.SENT + k]
    for k in range(6):
        mem[model.SENT + k] = mem[model.LAST_A + k] if acted else 0.0
        mem[model.SENT + 6 + k] = mem[model.LAST_B + k] if acted else 0.0


@jit
def predict(par: Array, mem: Array, sample: Array, h: float, out: Array) -> None:
    """Write the sample as it will be when its wrench acts into ``mem`` at AHEAD.

    A first sample is the reference configuration as it is; ``out`` is then written to on the way.
    """
    here = mem[model.AHEAD : model.AHEAD + layout.NSAMPLE]
    body_a, body_b = model.body(par, model.BODY_A), model.body(par, model.BODY_B)
    gone = 1
    if mem[model.STARTED] != 0.0 and mem[model.LAST_PERIOD] > 0.0:
        gone = max(int(mem[model.LAST_PERIOD] / h + 0.5), 1)
    for _ in range(min(gone - 1, MOST_LATE)):  # samples were lost: the last wrench was held
        for k in range(12 * MOST_LATE - 1, -1, -1):
            mem[model.SENT + 12 + k] = mem[model.SENT + k]
    for k in range(layout.NSAMPLE):
        here[k] = sample[k]
    for at in (layout.A_POSE, layout.B_POSE):
        q = normalised(model.quaternion(here, at + 3))
        for k in range(4):
            here[at + 3 + k] = q[k]
    if par[model.LATENCY] < 0.0:
        _measure(par, mem, here, body_a, body_b, h, gone == 1)
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


@inline
def _fits(par: Array, mem: Array, at: int, body: Body, load: Vector, v: Vector, h: float) -> None:
    """Add to every latency's misfit how badly it explains a body's change of velocity.

    The misfit is a force squared; ``at`` is the body's share of the wrenches.
    """
    before = model.vector(mem, model.SEEN + at // 2)
    weight = scale(body.mass, model.vector(par, model.GRAVITY))
    needed = sub(scale(body.mass / h, sub(v, before)), add_scaled(load, 1.0, weight))
    for d in range(MOST_LATE + 1):
        apart = sub(needed, model.vector(mem, model.SENT + 12 * d + at))
        mem[model.MISFIT + d] += dot(apart, apart)


@inline
def _measure(
    par: Array, mem: Array, here: Array, body_a: Body, body_b: Body, h: float, whole: bool
) -> None:
    """Keep the latency with which the wrenches sent explain the velocities seen."""
    va = motion_of(body_a, here, layout.A_POSE).velocity
    vb = motion_of(body_b, here, layout.B_POSE).velocity
    if whole and mem[model.STARTED] != 0.0:
        for d in range(MOST_LATE + 1):
            mem[model.MISFIT + d] *= KEPT
        if body_a.free:
            load = model.vector(here, layout.A_LOAD)
            _fits(par, mem, 0, body_a, load, va, h)
        if body_b.free:
            load = model.vector(here, layout.B_LOAD)
            _fits(par, mem, 6, body_b, load, vb, h)
        greatest, best, least = 0.0, 0, math.inf
        for d in range(MOST_LATE + 1):
            misfit = mem[model.MISFIT + d]
            greatest = max(greatest, misfit)
            if misfit < least:
                best, least = d, misfit
        now = mem[model.MISFIT + int(mem[model.LATE])]
        if least < BETTER * now and now > LEAST_MISFIT * greatest:
            mem[model.LATE] = best
    model.put(mem, model.SEEN, va)
    model.put(mem, model.SEEN + 3, vb)
