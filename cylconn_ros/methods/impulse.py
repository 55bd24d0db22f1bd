"""Known inertia: constraint reactions and friction of one step, solved together.

The wrench Lambda = (f1 f2 f3 m1 m2 m3), on B at node b, held over the coming period h; forces
in the axes of a, moments in N (core/kinematics.py):

    v+ = vf + h M^-1 J~^T Lambda       vf: free velocity, of gravity, loads, gyroscopic terms
    w+ = J~ v+                         relative twist at node b, J~ in the configuration q~
    w+_c = target_c                    c: the constrained components, y, z and both swings
    s+ = (v1, R w1)+ and friction      see core/friction_disc.py

q~ is the middle of the step. Each mass centre stands at its mean over the free step, x + h v/2 +
h^2 a/6, and as a body's own force does not move it across that force, the two wrenches exchange
linear and angular momentum exactly over the step, not only to second order.

Only the wrench goes out, and positions are measured at the next sample: e the constraint's error,
q^ = q + h v

    exact plant          w+_c = -e/h - J(q)v_c/2 - [(J(q^) - J~) v]_c       deadbeat, second order
      fast turning       the same asked of the end foreseen                 methods/predicted_end.py
      faster still       w+_c = -e/h                                        dissipative
    semi-implicit plant  w+_c = -e/h, all in the configuration q

The bracket takes J~v+ to the end of the step; the available components carry it too, so that s+ is
the slip at the end. -e/h is limited to the pull-in speed.

Springs and dampers act at the mean of the step, -k (u + h (w- + w+)/4) - c (w- + w+)/2: implicit,
second order, and taken into S before friction is solved.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.delassus import Inertia, of_body, of_both, swung
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import Frame, Nodes, Twist, frame, relative_twist
from cylconn_ros.core.latency import share_removed
from cylconn_ros.core.output_wrenches import write_wrenches
from cylconn_ros.core.relative_state import Observed, observe
from cylconn_ros.core.rigid_body import Body, Motion, angular_acceleration
from cylconn_ros.core.small_matrices import Four, factor, solve
from cylconn_ros.core.vectors import (
    Quaternion,
    Vector,
    add_scaled,
    cross,
    matrix,
    norm,
    out_of,
    scale,
    sub,
    turned,
)
from cylconn_ros.methods.complementarity import Reduced, reactions
from cylconn_ros.methods.free_axes import Available, available, report
from cylconn_ros.methods.predicted_end import GAIN, MOST_TURNS, PASSES, TURNS, end_of

UNDERSAMPLED_ABOVE = 0.5  # |w| h
ROUNDING = 4e-16  # a relative error that counts as none
STOPPED_AFTER = 3  # stuck samples in a row: a single one occurs at turning points


class Free(NamedTuple):
    """A body's free step: the configuration q~ and the end of the free velocity."""

    middle: Motion  # its velocity is not used
    end: Motion  # its configuration is not used
    orientation: Quaternion  # at the half of the step


@inline_function
def _free(
    par: Array, body: Body, m: Motion, load: Vector, torque: Vector, h: float, explicit: bool
) -> Free:
    """The free step; ``explicit``: all frozen at its start, as a semi-implicit plant does."""
    if not body.free:
        q = turned(m.orientation, scale(0.5 * h, m.spin))
        if explicit:
            return Free(m, m, q)
        return Free(Motion(add_scaled(m.com, 0.5 * h, m.velocity), q, m.velocity, m.spin), m, q)
    a = add_scaled(model.vector(par, model.GRAVITY), body.inverse_mass, load)
    velocity = add_scaled(m.velocity, h, a)
    half = turned(m.orientation, scale(0.5 * h, m.spin))
    if explicit:
        dw = angular_acceleration(body, m.orientation, m.spin, torque)
        return Free(m, Motion(m.com, half, velocity, add_scaled(m.spin, h, dw)), half)
    com = add_scaled(add_scaled(m.com, 0.5 * h, m.velocity), h * h / 6.0, a)
    # The load's torque is left out of the spin at the half: mostly the connector will balance it.
    dw = angular_acceleration(body, m.orientation, m.spin, (0.0, 0.0, 0.0))
    dw = angular_acceleration(body, half, add_scaled(m.spin, 0.5 * h, dw), torque)
    spin = add_scaled(m.spin, h, dw)
    return Free(Motion(com, half, velocity, spin), Motion(com, half, velocity, spin), half)


@inline_function
def _ahead(m: Motion, h: float) -> Motion:
    """q^ = q + h v, with the velocity as it is."""
    return Motion(
        add_scaled(m.com, h, m.velocity),
        turned(m.orientation, scale(h, m.spin)),
        m.velocity,
        m.spin,
    )


@inline_function
def pulled(e1: float, e2: float, h: float, greatest: float) -> tuple[float, float, bool]:
    """-e/h, its size limited to the pull-in speed."""
    size = math.sqrt(e1 * e1 + e2 * e2)
    if size <= greatest * h:
        return -e1 / h, -e2 / h, False
    return -greatest * e1 / size, -greatest * e2 / size, True


class Step(NamedTuple):
    """What a step is before anybody says what acts on slide and spin."""

    a: Free
    b: Free
    acting: Frame  # the configuration q~
    g: Inertia
    free: Twist  # J~ vf
    turning: Twist
    target: Four
    reduced: Reduced
    flags: int


@inline_function
def frozen(par: Array, mem: Array, sample: Array, o: Observed, h: float, alone: bool) -> Step:
    """q~, vf, the inertia that the wrench meets, and the constraint eliminated.

    ``alone``: no other connector acts on the bodies, so that their end can be foreseen.
    """
    body_a, body_b = o.body_a, o.body_b
    explicit = model.output(par).semi_implicit
    flags = o.flags
    turn = max(norm(o.a.spin), norm(o.b.spin)) * h
    if turn > UNDERSAMPLED_ABOVE:
        flags |= out_at.UNDERSAMPLED
    free_a = _loaded(par, body_a, o.a, sample, out_at.A_LOAD, h, explicit)
    free_b = _loaded(par, body_b, o.b, sample, out_at.B_LOAD, h, explicit)
    f = frame(o.nodes, free_a.middle, free_b.middle)
    g = swung(
        of_both(
            of_body(body_a, f.axes, free_a.middle.orientation, f.arm_a),
            of_body(body_b, f.axes, free_b.middle.orientation, f.arm_b),
        ),
        f.swing,
    )
    wf = relative_twist(f, free_a.end, free_b.end)
    coarse = explicit or min(norm(o.a.spin), norm(o.b.spin)) * h > MOST_TURNS
    turning = _turning(o.nodes, f, o, h, coarse)
    target, far = _target(par, o, turning, h, coarse, share_removed(par, mem))
    reduced = eliminated(g, wf, turning, target, h)
    if alone and TURNS < turn < MOST_TURNS and not explicit and not model.output(par).held_in_body:
        turning, target, reduced, far = _foreseen(
            par, mem, sample, o, f, g, wf, turning, target, reduced, far, h
        )
    if far:
        flags |= out_at.MISALIGNED
    return Step(free_a, free_b, f, g, wf, turning, target, reduced, flags)


@device_function
def _foreseen(
    par: Array, mem: Array, sample: Array, o: Observed, f: Frame, g: Inertia, wf: Twist,
    turning: Twist, target: Four, r: Reduced, far: bool, h: float,
) -> tuple[Twist, Four, Reduced, bool]:  # fmt: skip
    """Bracket, target and what follows from them, for the end foreseen: methods/predicted_end.py."""
    f1, m1 = mem[model.LAST_TOTAL], mem[model.LAST_TOTAL + 1]
    limits, share = _limits(par, o, h), 1.0 / (1.0 + 0.5 * GAIN)
    for _ in range(PASSES):
        c = reactions(r, f1, m1)
        end = end_of(par, mem, sample, o, f, (f1, c[0], c[1]), (m1, c[2], c[3]), h)
        if not end.known:
            break
        v1 = r.free[0] - turning.v[0] + r.a[0] * f1 + r.a[1] * m1
        w1 = r.free[1] - turning.w[0] + r.a[1] * f1 + r.a[2] * m1
        v, w, e = end.twist.v, end.twist.w, end.error
        turning = Twist(
            (v[0] - v1, v[1] - target[0], v[2] - target[1]),
            (w[0] - w1, w[1] - target[2], w[2] - target[3]),
        )
        e = scaled(e, share_removed(par, mem))
        y, z, far_offset = pulled(GAIN * e[0], GAIN * e[1], h, limits[0])
        p2, p3, far_angle = pulled(GAIN * e[2], GAIN * e[3], h, limits[1])
        target = (
            target[0] - share * (v[1] - y),
            target[1] - share * (v[2] - z),
            target[2] - share * (w[1] - p2),
            target[3] - share * (w[2] - p3),
        )
        r, far = eliminated(g, wf, turning, target, h), far_offset or far_angle
    return turning, target, r, far


@inline_function
def answer(
    par: Array, mem: Array, out: Array, o: Observed, s: Step, av: Available, h: float
) -> int:
    """Write wrenches and state for what acts on slide and spin; returns the flags."""
    f1, m1 = mem[model.LAST_TOTAL], mem[model.LAST_TOTAL + 1]
    force = (f1, av.constraint[0], av.constraint[1])
    moment = (m1, av.constraint[2], av.constraint[3])
    flags = s.flags | av.solved.flags
    flags |= write_wrenches(
        par, mem, out, s.acting, force, moment,
        o.body_a, o.body_b, o.a, o.b,
        s.a.orientation, s.b.orientation,
    )  # fmt: skip
    report(par, mem, out, o, s.reduced, av, force, moment, h)
    unsolved = unmet(s.g, s.free, s.turning, s.target, force, moment, h)
    out[out_at.RESIDUAL] = max(av.solved.residual, unsolved)
    if mem[model.STUCK] >= STOPPED_AFTER:
        flags |= out_at.STOPPED
    return flags


@device_function
def step(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """One sample: (NSAMPLE,) in, (NOUT,) out, ``mem`` advanced; returns the flags."""
    o = observe(par, mem, sample, out)
    s = frozen(par, mem, sample, o, h, True)
    av = available(par, mem, o, s.reduced, h, model.output(par).semi_implicit)
    return answer(par, mem, out, o, s, av, h)


@inline_function
def _loaded(
    par: Array, body: Body, m: Motion, sample: Array, at: int, h: float, explicit: bool
) -> Free:
    """The free step under a load that is given at the body frame's origin."""
    load = model.vector(sample, at)
    arm = out_of(matrix(m.orientation), body.com)
    torque = sub(model.vector(sample, at + 3), cross(arm, load))
    return _free(par, body, m, load, torque, h, explicit)


@inline_function
def _turning(nodes: Nodes, f: Frame, o: Observed, h: float, coarse: bool) -> Twist:
    """(J(q^) - J~) v: what the geometry adds to J~v+ until the end of the step."""
    if coarse:
        return Twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    a, b = _ahead(o.a, h), _ahead(o.b, h)
    there = relative_twist(frame(nodes, a, b), a, b)
    here = relative_twist(f, o.a, o.b)
    return Twist(sub(there.v, here.v), sub(there.w, here.w))


@inline_function
def _target(
    par: Array, o: Observed, turning: Twist, h: float, coarse: bool, share: float
) -> tuple[Four, bool]:
    """target_c, and whether an error is being pulled in at its bounded speed.

    ``share``: of the error, what is to be removed.
    """
    e, w = scaled(o.error, share), o.twist
    limits = _limits(par, o, h)
    y, z, far_offset = pulled(e[0], e[1], h, limits[0])
    p2, p3, far_angle = pulled(e[2], e[3], h, limits[1])
    keep = 0.0 if coarse else 0.5
    target = (
        y - keep * w.v[1] - turning.v[1],
        z - keep * w.v[2] - turning.v[2],
        p2 - keep * w.w[1] - turning.w[1],
        p3 - keep * w.w[2] - turning.w[2],
    )
    return target, far_offset or far_angle


@inline_function
def scaled(e: Four, share: float) -> Four:
    """``share`` of an error."""
    return (share * e[0], share * e[1], share * e[2], share * e[3])


@inline_function
def _limits(par: Array, o: Observed, h: float) -> tuple[float, float]:
    """The greatest speed of offsets and rate of swings at which a violation is removed."""
    own = _own_rate(o, h)
    arms = norm(o.frame.arm_a) + norm(o.frame.arm_b)
    return par[model.PULL_IN] + own * arms, par[model.PULL_IN + 1] + own


@inline_function
def _own_rate(o: Observed, h: float) -> float:
    """The rate at which a step's own error, up to (|w| h)^3 of the arms, is to be removed.

    None where one wrench a sample cannot hold the constraint: there it would feed the motion.
    """
    spin = max(norm(o.a.spin), norm(o.b.spin))
    turn = spin * h
    held = min(max(6.0 - 10.0 * turn, 0.0), 1.0)  # from |w| h = 0.5 to 0.6
    return held * turn * turn * spin


@inline_function
def _dot4(a: Four, b: Four) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@inline_function
def eliminated(g: Inertia, wf: Twist, turning: Twist, target: Four, h: float) -> Reduced:
    """Solve w+_c = target_c for (f2, f3, m2, m3), for no force and for a unit f1 and m1."""
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
        wf.v[0] + turning.v[0] + h * _dot4(of_f1, base),
        wf.w[0] + turning.w[0] + h * _dot4(of_m1, base),
    )
    a = (  # never below its rounding: a body always gives way
        h * max(ff[0] + _dot4(of_f1, by_f1), ROUNDING * ff[0]),
        h * (fm[0][0] + _dot4(of_f1, by_m1)),
        h * max(mm[0] + _dot4(of_m1, by_m1), ROUNDING * mm[0]),
    )
    return Reduced(base, by_f1, by_m1, free, a)


@inline_function
def unmet(
    g: Inertia, wf: Twist, turning: Twist, target: Four, f: Vector, m: Vector, h: float
) -> float:
    """Residual of w+_c = target_c, row by row over the sum of the terms' sizes."""
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
