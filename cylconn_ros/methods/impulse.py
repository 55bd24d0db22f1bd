"""Method impulse, known inertia: constraint reactions and friction of one step, solved together.

The wrench Lambda = (f1 f2 f3 m1 m2 m3) acts on B at node b and is held over the next period h;
forces in the axes of a, moments in N (core/kinematics.py):

    v+ = vf + h M^-1 J~^T Lambda       vf: free velocity from gravity, loads, gyroscopic terms
    w+ = J~ v+                         relative twist at node b, J~ in the configuration q~
    w+_c = target_c                    c: the constrained components, y, z and both swings
    s+ = (v1, R w1)+ and friction      see core/friction_disc.py

q~ is the middle of the step. Each mass centre is at its mean over the free step, x + h v/2 + h^2
a/6. Since a force does not displace its body across its own direction, the two wrenches exchange
linear and angular momentum exactly over the step, not only to second order.

The connector only sends the wrench; positions are measured at the next sample. With the constraint
error e and q^ = q + h v the targets are

    exact plant          w+_c = -e/h - J(q)v_c/2 - [(J(q^) - J~) v]_c       deadbeat, second order
      fast rotation      the same for the predicted end                     methods/predicted_end.py
      faster rotation    w+_c = -e/h                                        dissipative
    semi-implicit plant  w+_c = -e/h, all in the configuration q

The bracket (jacobian_change) converts J~v+ to the end of the step; it applies to slide and spin as
well, so that s+ is the slip at the end. -e/h is limited to the pull-in speed.

Springs and dampers act at the mean of the step, -k (u + h (w- + w+)/4) - c (w- + w+)/2: implicit,
second order, and included in S before friction is solved (methods/free_axes/step.py).
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delassus import DelassusOperator, in_swing_axes, of_body, sum_of_bodies
from cylconn_ros.core.delay import correction_share, feedback_gain, rate_share
from cylconn_ros.core.free_gain import (
    free_gain,
    is_simulators,
    is_stopped,
    store_step,
    update_gain,
)
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import Frame, Nodes, Twist, frame, relative_twist
from cylconn_ros.core.output_wrenches import (
    ComWrenches,
    add_reactions,
    limited_wrenches,
    write_wrenches,
)
from cylconn_ros.core.relative_state import RelativeState, measure
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.core.small_matrices import Four, factor, solve
from cylconn_ros.core.vectors import (
    Vector,
    add_scaled,
    norm,
    scale,
    sub,
    turned,
)
from cylconn_ros.methods.free_axes.complementarity import ReducedStep, reactions
from cylconn_ros.methods.free_axes.step import FreeAxes, solve_free_axes, write_state
from cylconn_ros.methods.free_step import FreeStep, free_step
from cylconn_ros.methods.never_gains import Halves, kept_share, turns_far
from cylconn_ros.methods.predicted_end import (
    GAIN,
    MAX_TURN,
    MIN_TURN,
    NEWTON_ITERATIONS,
    predict_end,
)
from cylconn_ros.methods.simulator_constraint import kept_target, predicted_jacobian_change

UNDERSAMPLED_ABOVE = 0.5  # |w| h, rad
ROUNDING = 4e-16  # relative


@inline_function
def _extrapolated(m: Motion, h: float) -> Motion:
    """q^ = q + h v with unchanged velocity."""
    return Motion(
        add_scaled(m.com, h, m.velocity),
        turned(m.orientation, scale(h, m.spin)),
        m.velocity,
        m.spin,
    )


@inline_function
def correction_rate(e1: float, e2: float, h: float, greatest: float) -> tuple[float, float, bool]:
    """-e/h with its norm limited to ``greatest``; whether it was limited."""
    size = math.sqrt(e1 * e1 + e2 * e2)
    if size <= greatest * h:
        return -e1 / h, -e2 / h, False
    return -greatest * e1 / size, -greatest * e2 / size, True


class PreparedStep(NamedTuple):
    """A step with the constraint eliminated, before the forces on slide and spin are known."""

    a: FreeStep
    b: FreeStep
    acting: Frame  # the configuration q~
    g: DelassusOperator
    free: Twist  # J~ vf
    jacobian_change: Twist
    target: Four
    reduced: ReducedStep
    flags: int


@inline_function
def prepare_step(
    par: Array, mem: Array, sample: Array, o: RelativeState, h: float, alone: bool
) -> PreparedStep:
    """Prepare a step: q~, vf, the Delassus operator, and elimination of the constraint.

    ``alone``: no other connector acts on the bodies, so that the end of the step can be predicted.
    """
    body_a, body_b = o.body_a, o.body_b
    explicit = model.output(par).semi_implicit
    flags = o.flags
    turn = max(norm(o.a.spin), norm(o.b.spin)) * h
    if turn > UNDERSAMPLED_ABOVE:
        flags |= layout.UNDERSAMPLED
    free_a = free_step(par, mem, body_a, o.a, sample, layout.A_LOAD, model.LAST_A, h, explicit)
    free_b = free_step(par, mem, body_b, o.b, sample, layout.B_LOAD, model.LAST_B, h, explicit)
    f = frame(o.nodes, free_a.middle, free_b.middle)
    g = in_swing_axes(
        sum_of_bodies(
            of_body(body_a, f.axes, free_a.middle.orientation, f.arm_a),
            of_body(body_b, f.axes, free_b.middle.orientation, f.arm_b),
        ),
        f.swing,
    )
    wf = relative_twist(f, free_a.end, free_b.end)
    coarse = explicit or min(norm(o.a.spin), norm(o.b.spin)) * h > MAX_TURN
    jacobian_change = _jacobian_change(o.nodes, f, o, h, coarse)
    if is_simulators(par):
        jacobian_change = predicted_jacobian_change(mem, o, f, free_a.end, free_b.end, h, explicit)
        target, far, alone = kept_target(jacobian_change), False, False
    else:
        target, far = _target(par, mem, o, jacobian_change, h, coarse)
    reduced = eliminate_constraint(g, wf, jacobian_change, target, h)
    predictable = alone and not explicit and not model.output(par).held_in_body
    if predictable and MIN_TURN < turn < MAX_TURN and feedback_gain(par, mem) == 1.0:
        jacobian_change, target, reduced, far = _with_predicted_end(
            par, mem, sample, o, f, g, wf, jacobian_change, target, reduced, far, h
        )
    if far:
        flags |= layout.MISALIGNED
    return PreparedStep(free_a, free_b, f, g, wf, jacobian_change, target, reduced, flags)


@device_function
def _with_predicted_end(
    par: Array, mem: Array, sample: Array, o: RelativeState, f: Frame, g: DelassusOperator,
    wf: Twist, jacobian_change: Twist, target: Four, r: ReducedStep, far: bool, h: float,
) -> tuple[Twist, Four, ReducedStep, bool]:  # fmt: skip
    """jacobian_change, target and reduced step for the predicted end: methods/predicted_end.py."""
    f1, m1 = mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1]
    limits, share = _correction_limits(par, o, h), 1.0 / (1.0 + 0.5 * GAIN)
    arms = norm(f.arm_a) + norm(f.arm_b)
    begun, least = (jacobian_change, target, r, far), 0.0
    for iteration in range(NEWTON_ITERATIONS):
        c = reactions(r, f1, m1)
        end = predict_end(par, mem, sample, o, f, (f1, c[0], c[1]), (m1, c[2], c[3]), h)
        if not end.known:
            return begun
        v1 = r.free[0] - jacobian_change.v[0] + r.a[0] * f1 + r.a[1] * m1
        w1 = r.free[1] - jacobian_change.w[0] + r.a[1] * f1 + r.a[2] * m1
        v, w, e = end.twist.v, end.twist.w, end.error
        jacobian_change = Twist(
            (v[0] - v1, v[1] - target[0], v[2] - target[1]),
            (w[0] - w1, w[1] - target[2], w[2] - target[3]),
        )
        e = scaled(e, correction_share(par, mem))
        y, z, far_offset = correction_rate(GAIN * e[0], GAIN * e[1], h, limits[0])
        p2, p3, far_angle = correction_rate(GAIN * e[2], GAIN * e[3], h, limits[1])
        d = (v[1] - y, v[2] - z, w[1] - p2, w[2] - p3)
        left = d[0] * d[0] + d[1] * d[1] + arms * arms * (d[2] * d[2] + d[3] * d[3])
        if iteration == 0:
            least = left
        elif not left <= least:  # it diverges
            return begun
        target = (
            target[0] - share * d[0],
            target[1] - share * d[1],
            target[2] - share * d[2],
            target[3] - share * d[3],
        )
        r, far = eliminate_constraint(g, wf, jacobian_change, target, h), far_offset or far_angle
    return jacobian_change, target, r, far


@inline_function
def write_outputs(
    par: Array, mem: Array, out: Array, o: RelativeState, s: PreparedStep, av: FreeAxes, h: float,
    share: float,
) -> int:  # fmt: skip
    """Write wrenches and state for the forces on slide and spin; returns the flags.

    ``share``: factor on the wrenches (methods/never_gains.py).
    """
    f1, m1 = mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1]
    force = (f1, av.constraint[0], av.constraint[1])
    moment = (m1, av.constraint[2], av.constraint[3])
    flags = s.flags | av.solved.flags | av.flags
    sent_force, sent_moment = force, moment
    if is_simulators(par):
        sent_force, sent_moment = (f1, 0.0, 0.0), (m1, 0.0, 0.0)
    flags |= write_wrenches(
        par, mem, out, s.acting, sent_force, sent_moment,
        o.body_a, o.body_b, o.a, o.b,
        s.a.orientation, s.b.orientation, share,
    )  # fmt: skip
    if is_simulators(par):
        add_reactions(mem, s.acting, (0.0, force[1], force[2]), (0.0, moment[1], moment[2]))
        if free_gain(par, mem) < 1.0:
            flags |= layout.GAINS_LOWERED
    write_state(par, mem, out, o, s.reduced, av, force, moment, h)
    unsolved = constraint_residual(s.g, s.free, s.jacobian_change, s.target, force, moment, h)
    out[layout.RESIDUAL] = max(av.solved.residual, unsolved)
    held = is_stopped(par, mem)
    if mem[model.STICK_SAMPLES] >= layout.STOPPED_SAMPLES and held:
        flags |= layout.STOPPED
    return flags


@inline_function
def _kept_share(
    par: Array, mem: Array, sample: Array, o: RelativeState, s: PreparedStep, av: FreeAxes, h: float
) -> float:
    """Factor on the wrenches for law N; 1 where they turn little in the step."""
    if is_simulators(par):
        return 1.0
    f1, m1 = mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1]
    force, moment = (
        (f1, av.constraint[0], av.constraint[1]),
        (m1, av.constraint[2], av.constraint[3]),
    )
    w, limited = limited_wrenches(par, s.acting, force, moment)
    if not turns_far(o, s.acting, w, h):
        return 1.0
    if limited < 1.0:
        push = scale(limited, w.force)
        w = ComWrenches(push, scale(limited, w.torque_a), scale(limited, w.torque_b))
    halves = Halves(s.a.orientation, s.b.orientation)
    return kept_share(par, mem, sample, o, s.g, halves, w, limited, h)


@device_function
def step(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Compute one step: sample (NSAMPLE,), out (NOUT,), ``mem`` updated; returns the flags."""
    o = measure(par, mem, sample, h, out)
    s = prepare_step(par, mem, sample, o, h, True)
    update_gain(par, mem, o.twist.v[0], o.twist.w[0], h)
    av = solve_free_axes(par, mem, o, s.reduced, h, model.output(par).semi_implicit)
    share = _kept_share(par, mem, sample, o, s, av, h)
    flags = write_outputs(par, mem, out, o, s, av, h, share)
    if share < 1.0:
        flags |= layout.GAINS_LOWERED
    store_step(par, mem, s.reduced.free, s.reduced.a, flags & layout.LIMITED != 0)
    return flags


@inline_function
def _jacobian_change(nodes: Nodes, f: Frame, o: RelativeState, h: float, coarse: bool) -> Twist:
    """(J(q^) - J~) v: the change of J~v+ by the motion until the end of the step."""
    if coarse:
        return Twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    a, b = _extrapolated(o.a, h), _extrapolated(o.b, h)
    there = relative_twist(frame(nodes, a, b), a, b)
    here = relative_twist(f, o.a, o.b)
    return Twist(sub(there.v, here.v), sub(there.w, here.w))


@inline_function
def _target(
    par: Array, mem: Array, o: RelativeState, jacobian_change: Twist, h: float, coarse: bool
) -> tuple[Four, bool]:
    """target_c, and whether the correction is limited to the pull-in speed."""
    e, w = scaled(o.error, correction_share(par, mem)), o.twist
    limits = _correction_limits(par, o, h)
    y, z, far_offset = correction_rate(e[0], e[1], h, limits[0])
    p2, p3, far_angle = correction_rate(e[2], e[3], h, limits[1])
    keep = rate_share(par, mem, coarse)
    target = (
        y - keep * w.v[1] - jacobian_change.v[1],
        z - keep * w.v[2] - jacobian_change.v[2],
        p2 - keep * w.w[1] - jacobian_change.w[1],
        p3 - keep * w.w[2] - jacobian_change.w[2],
    )
    return target, far_offset or far_angle


@inline_function
def scaled(e: Four, share: float) -> Four:
    """The error e times ``share``."""
    return (share * e[0], share * e[1], share * e[2], share * e[3])


@inline_function
def _correction_limits(par: Array, o: RelativeState, h: float) -> tuple[float, float]:
    """Greatest speed of offsets (m/s) and rate of swings (rad/s) of constraint correction."""
    own = _truncation_rate(o, h)
    arms = norm(o.frame.arm_a) + norm(o.frame.arm_b)
    return par[model.PULL_IN] + own * arms, par[model.PULL_IN + 1] + own


@inline_function
def _truncation_rate(o: RelativeState, h: float) -> float:
    """Correction rate for the truncation error of a step, up to (|w| h)^3 times the arms, rad/s.

    Zero if one wrench per sample cannot hold the constraint: it would add energy.
    """
    spin = max(norm(o.a.spin), norm(o.b.spin))
    turn = spin * h
    held = min(max(6.0 - 10.0 * turn, 0.0), 1.0)  # from |w| h = 0.5 to 0.6
    return held * turn * turn * spin


@inline_function
def _dot4(a: Four, b: Four) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@inline_function
def eliminate_constraint(
    g: DelassusOperator, wf: Twist, jacobian_change: Twist, target: Four, h: float
) -> ReducedStep:
    """Solve w+_c = target_c for (f2, f3, m2, m3): for zero f1, m1 and for unit f1 and m1."""
    ff, fm, mm = g.ff, g.fm, g.mm
    lower = factor(ff[3], ff[4], ff[5], fm[1][1], fm[2][1], mm[3], fm[1][2], fm[2][2], mm[4], mm[5])
    base = solve(
        lower,
        (target[0] - wf.v[1]) / h,
        (target[1] - wf.v[2]) / h,
        (target[2] - wf.w[1]) / h,
        (target[3] - wf.w[2]) / h,
    )
    of_f1 = (ff[1], ff[2], fm[0][1], fm[0][2])  # G_c,f1
    of_m1 = (fm[1][0], fm[2][0], mm[1], mm[2])  # G_c,m1
    by_f1 = solve(lower, -of_f1[0], -of_f1[1], -of_f1[2], -of_f1[3])
    by_m1 = solve(lower, -of_m1[0], -of_m1[1], -of_m1[2], -of_m1[3])
    free = (
        wf.v[0] + jacobian_change.v[0] + h * _dot4(of_f1, base),
        wf.w[0] + jacobian_change.w[0] + h * _dot4(of_m1, base),
    )
    a = (  # never below rounding: the mobility is positive
        h * max(ff[0] + _dot4(of_f1, by_f1), ROUNDING * ff[0]),
        h * (fm[0][0] + _dot4(of_f1, by_m1)),
        h * max(mm[0] + _dot4(of_m1, by_m1), ROUNDING * mm[0]),
    )
    return ReducedStep(base, by_f1, by_m1, free, a)


@inline_function
def constraint_residual(
    g: DelassusOperator,
    wf: Twist,
    jacobian_change: Twist,
    target: Four,
    f: Vector,
    m: Vector,
    h: float,
) -> float:
    """Relative residual of w+_c = target_c: per row, over the sum of the terms' magnitudes."""
    mm = (
        (g.mm[0], g.mm[1], g.mm[2]), (g.mm[1], g.mm[3], g.mm[4]), (g.mm[2], g.mm[4], g.mm[5]),
    )  # fmt: skip
    ff = (
        (g.ff[0], g.ff[1], g.ff[2]), (g.ff[1], g.ff[3], g.ff[4]), (g.ff[2], g.ff[4], g.ff[5]),
    )  # fmt: skip
    worst = 0.0
    for k in range(4):
        row = 1 + k % 2
        total = (wf.v[row] if k < 2 else wf.w[row]) - target[k]
        size = abs(wf.v[row] if k < 2 else wf.w[row]) + abs(target[k])
        for j in range(3):
            by_f = ff[row][j] if k < 2 else g.fm[j][row]
            by_m = g.fm[row][j] if k < 2 else mm[row][j]
            total += h * (by_f * f[j] + by_m * m[j])
            size += h * (abs(by_f * f[j]) + abs(by_m * m[j]))
        if size > 0.0:
            worst = max(worst, abs(total) / size)
    return worst
