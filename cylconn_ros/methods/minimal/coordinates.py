r"""Joint coordinates: configuration of both bodies and equations of motion of slide and spin.

y = (l, alpha, l', alpha', ...): slide and spin if one body is prescribed (fixed, or driven at
constant twist); followed by pose and twist of A at its mass centre if both are free:

    y = (l, alpha, v1, w1 | x_A 3, q_A 4, v_A 3, w_A 3)

The offsets y0, z0 and the misalignment are constant, so that B rotates about its own e1b, which is
e1a without a misalignment. Moments are expressed in the untwisted axes of node b, N = E S (S the
held swing), forces in the axes of a, E; both rotate with A. With rA, rB the arms of xb,

    (l'', 0, 0)     = E^T [aB + w'B x rB + wB x (wB x rB) - aA - w'A x rA - wA x (wA x rA)
                           - 2 wA x l' e1a]
    (alpha'', 0, 0) = N^T [w'B - w'A - wA x alpha' e1b]

are six equations for l'', alpha'' and the constraint reactions f2 f3 m2 m3.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.delassus import DelassusOperator, in_swing_axes, of_body, sum_of_bodies
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.kinematics import Frame
from cylconn_ros.core.rigid_body import Body, Motion, angular_acceleration
from cylconn_ros.core.small_matrices import Four, factor, solve
from cylconn_ros.core.vectors import (
    Matrix,
    Quaternion,
    Vector,
    add,
    add_scaled,
    conjugate,
    cross,
    into,
    matrix,
    multiply,
    normalised,
    out_of,
    scale,
    sub,
    turned,
)

# --- y ---
LENGTH: Final = 0
ANGLE: Final = 1
SLIDE: Final = 2
SPIN: Final = 3
A_COM: Final = 4
A_ORIENTATION: Final = 7
A_VELOCITY: Final = 11
A_SPIN: Final = 14

# --- constants of the coordinates: (NJOINT,) ---
MODE: Final = 0  # the prescribed body
PRESCRIBED: Final = 1  # its mass centre, orientation, velocity, spin at t = 0: 13
OFFSETS: Final = 14  # y0, z0
SWING: Final = 16  # the held swing as a quaternion, 4
AXES_B: Final = 20  # node b's orientation in body B, 4
LOADS: Final = 24  # force, torque about the frame's origin, on A, on B: 12, world axes
SPRING_REFERENCE: Final = 36  # l1ref, theta1ref
FIXED_SHAFT: Final = 38  # whether the reduction of methods/minimal/fixed_shaft.py holds; constants:
HARMONICS: Final = 39  # of l'', alpha'', base 4: k0 k1 k2 k3 each
MOBILITY: Final = 63  # S, 3
BY_F1: Final = 66  # 4
BY_M1: Final = 70  # 4
START: Final = 74  # length of the reference configuration
OVER_TIME: Final = 75  # whether anything changes over time (methods/minimal/over_time.py); then:
BASE: Final = 76  # what the factors multiply: loads 12, preload, position, velocity and force of
#                   slide, of spin (NaN: not imposed)
PIECES: Final = BASE + 19  # of each of 5 factors: start, value, slope, sine, omega, phase
IMPOSED_ACCELERATION: Final = PIECES + 30  # of slide, of spin
HELD: Final = IMPOSED_ACCELERATION + 2  # component that a lock holds: 1 slide, 2 spin; 0: none
LONGEST_STEP: Final = HELD + 1  # s; 0: any
NJOINT: Final = LONGEST_STEP + 1

A_PRESCRIBED: Final = 0  # the motion of A is prescribed, B is free
B_PRESCRIBED: Final = 1
BOTH_FREE: Final = 2


class Configuration(NamedTuple):
    """Motion of both bodies, geometry of the connector, axes N."""

    a: Motion
    b: Motion
    frame: Frame
    untwisted: Matrix


class ReducedEquations(NamedTuple):
    """Accelerations of slide and spin, constraint reactions, as functions of (f1, m1).

    (l'', alpha'') = free + S (f1, m1);    (f2 f3 m2 m3) = base + by_f1 f1 + by_m1 m1
    """

    free: tuple[float, float]
    s: tuple[float, float, float]  # 11, 12, 22
    base: Four
    by_f1: Four
    by_m1: Four


@inline_function
def _rotation_about_e1(angle: float) -> Quaternion:
    return (math.sin(0.5 * angle), 0.0, 0.0, math.cos(0.5 * angle))


@inline_function
def _prescribed_motion(joint: Array, t: float) -> Motion:
    """The motion of the prescribed body at t."""
    at = PRESCRIBED
    v, w = model.vector(joint, at + 7), model.vector(joint, at + 10)
    q = model.quaternion(joint, at + 3)
    return Motion(
        add_scaled(model.vector(joint, at), t, v),
        turned(q, scale(t, w)) if w[0] != 0.0 or w[1] != 0.0 or w[2] != 0.0 else q,
        v,
        w,
    )


@inline_function
def configuration(par: Array, joint: Array, t: float, y: Array) -> Configuration:
    """The configuration at time t and coordinates y."""
    swing = model.quaternion(joint, SWING)
    nodes = model.nodes(par, swing)
    axes_b = model.quaternion(joint, AXES_B)
    at_b = (y[LENGTH], joint[OFFSETS], joint[OFFSETS + 1])
    twist = _rotation_about_e1(y[ANGLE])
    if joint[MODE] == B_PRESCRIBED:
        b = _prescribed_motion(joint, t)
        arm_b = out_of(matrix(b.orientation), nodes.b)
        qn = multiply(multiply(b.orientation, axes_b), conjugate(twist))
        qe = multiply(qn, conjugate(swing))
        qa = multiply(qe, conjugate(nodes.a_axes))
        axes, untwisted = matrix(qe), matrix(qn)
        wa = add_scaled(b.spin, -y[SPIN], untwisted[0])
        d = out_of(axes, at_b)
        arm_a = add(out_of(matrix(qa), nodes.a), d)
        va = sub(add(b.velocity, cross(b.spin, arm_b)), cross(wa, arm_a))
        va = add_scaled(va, -y[SLIDE], axes[0])
        a = Motion(sub(add(b.com, arm_b), arm_a), qa, va, wa)
        return Configuration(a, b, Frame(axes, swing, d, arm_a, arm_b), untwisted)
    if joint[MODE] == BOTH_FREE:
        a = Motion(
            model.vector(y, A_COM),
            normalised(model.quaternion(y, A_ORIENTATION)),
            model.vector(y, A_VELOCITY),
            model.vector(y, A_SPIN),
        )
    else:
        a = _prescribed_motion(joint, t)
    qe = multiply(a.orientation, nodes.a_axes)
    qn = multiply(qe, swing)
    axes, untwisted = matrix(qe), matrix(qn)
    qb = multiply(multiply(qn, twist), conjugate(axes_b))
    arm_b = out_of(matrix(qb), nodes.b)
    d = out_of(axes, at_b)
    arm_a = add(out_of(matrix(a.orientation), nodes.a), d)
    wb = add_scaled(a.spin, y[SPIN], untwisted[0])
    vb = add_scaled(add(a.velocity, cross(a.spin, arm_a)), y[SLIDE], axes[0])
    b = Motion(sub(add(a.com, arm_a), arm_b), qb, sub(vb, cross(wb, arm_b)), wb)
    return Configuration(a, b, Frame(axes, swing, d, arm_a, arm_b), untwisted)


@inline_function
def acceleration(
    par: Array, joint: Array, body: Body, m: Motion, load: int, force: Vector, torque: Vector
) -> tuple[Vector, Vector]:
    """Linear and angular acceleration under gravity, load and a further force and torque."""
    if not body.free:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    outer, moment = model.vector(joint, LOADS + load), model.vector(joint, LOADS + load + 3)
    moment = sub(moment, cross(out_of(matrix(m.orientation), body.com), outer))
    a = add_scaled(model.vector(par, model.GRAVITY), body.inverse_mass, add(force, outer))
    return a, angular_acceleration(body, m.orientation, m.spin, add(torque, moment))


@inline_function
def delassus_at(par: Array, p: Configuration) -> DelassusOperator:
    """G with forces in the axes of a, moments and angular velocities in N."""
    body_a, body_b = model.body(par, model.BODY_A), model.body(par, model.BODY_B)
    g = sum_of_bodies(
        of_body(body_a, p.frame.axes, p.a.orientation, p.frame.arm_a),
        of_body(body_b, p.frame.axes, p.b.orientation, p.frame.arm_b),
    )
    return in_swing_axes(g, p.frame.swing)


@inline_function
def _dot4(a: Four, b: Four) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@inline_function
def eliminate_constraint(g: DelassusOperator, v: Vector, w: Vector) -> ReducedEquations:
    """Reduce to slide and spin; v, w: relative accelerations (or rates) without a wrench."""
    ff, fm, mm = g.ff, g.fm, g.mm
    lower = factor(ff[3], ff[4], ff[5], fm[1][1], fm[2][1], mm[3], fm[1][2], fm[2][2], mm[4], mm[5])
    base = solve(lower, -v[1], -v[2], -w[1], -w[2])
    of_f1 = (ff[1], ff[2], fm[0][1], fm[0][2])  # columns of f1, m1 in the constrained rows
    of_m1 = (fm[1][0], fm[2][0], mm[1], mm[2])
    by_f1 = solve(lower, -of_f1[0], -of_f1[1], -of_f1[2], -of_f1[3])
    by_m1 = solve(lower, -of_m1[0], -of_m1[1], -of_m1[2], -of_m1[3])
    return ReducedEquations(
        (v[0] + _dot4(of_f1, base), w[0] + _dot4(of_m1, base)),
        (ff[0] + _dot4(of_f1, by_f1), fm[0][0] + _dot4(of_f1, by_m1), mm[0] + _dot4(of_m1, by_m1)),
        base,
        by_f1,
        by_m1,
    )


@inline_function
def reduced_equations(par: Array, joint: Array, y: Array, p: Configuration) -> ReducedEquations:
    """The equations of motion of slide and spin in the configuration p."""
    none = (0.0, 0.0, 0.0)
    a, alpha = acceleration(par, joint, model.body(par, model.BODY_A), p.a, 0, none, none)
    b, beta = acceleration(par, joint, model.body(par, model.BODY_B), p.b, 6, none, none)
    wa, wb, f = p.a.spin, p.b.spin, p.frame
    b = add(b, add(cross(beta, f.arm_b), cross(wb, cross(wb, f.arm_b))))
    a = add(a, add(cross(alpha, f.arm_a), cross(wa, cross(wa, f.arm_a))))
    a = add_scaled(a, 2.0 * y[SLIDE], cross(wa, f.axes[0]))
    v = into(f.axes, sub(b, a))
    w = sub(sub(beta, alpha), scale(y[SPIN], cross(wa, p.untwisted[0])))
    return eliminate_constraint(delassus_at(par, p), v, into(p.untwisted, w))


@inline_function
def wrench_on_b(p: Configuration, x: tuple[float, float], c: Four) -> tuple[Vector, Vector]:
    """Force and moment on B at node b, world axes, of (f1, m1) and the reactions f2 f3 m2 m3."""
    return (
        out_of(p.frame.axes, (x[0], c[0], c[1])),
        out_of(p.untwisted, (x[1], c[2], c[3])),
    )
