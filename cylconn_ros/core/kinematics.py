"""Relative motion of node b against node a, and its Jacobian applied to velocities.

Symbols (axes of a, unless said): d = xb - xa; l = e1a.d; y = e2a.d, z = e3a.d; v, w the relative
twist at node b. The orientation of b in a is split as swing times twist, swing across e1a and twist
about it.
"""

import math
from typing import NamedTuple

from cylconn_ros.core.bodies import Motion
from cylconn_ros.core.compiled import inline
from cylconn_ros.core.vectors import (
    Matrix,
    Quaternion,
    Vector,
    add,
    conjugate,
    cross,
    into,
    matrix,
    multiply,
    out_of,
    sub,
)


class Nodes(NamedTuple):
    """Where the end points are fixed: from each body's mass centre, in body axes; node a's axes."""

    a: Vector
    a_axes: Quaternion
    b: Vector


class Frame(NamedTuple):
    """The connector's geometry in one configuration, world axes."""

    axes: Matrix  # e1a, e2a, e3a
    d: Vector  # xb - xa
    arm_a: Vector  # xb - mass centre of A: the wrench acts at b on both bodies
    arm_b: Vector  # xb - mass centre of B


class Twist(NamedTuple):
    """Relative velocity at node b and relative angular velocity, axes of a."""

    v: Vector
    w: Vector


class Angles(NamedTuple):
    """Orientation of b in a: angle about e1a in (-pi, pi], swing from e1b to e1a."""

    angle: float
    misalignment_2: float
    misalignment_3: float
    half_turn: bool  # misaligned by exactly pi: the swing axis is a choice


@inline
def frame(nodes: Nodes, a: Motion, b: Motion) -> Frame:
    """The connector's geometry for two bodies, each given at its mass centre."""
    axes_a = matrix(a.orientation)
    arm_b = out_of(matrix(b.orientation), nodes.b)
    arm_a = sub(add(b.com, arm_b), a.com)
    d = sub(arm_a, out_of(axes_a, nodes.a))
    return Frame(matrix(multiply(a.orientation, nodes.a_axes)), d, arm_a, arm_b)


@inline
def relative_twist(f: Frame, a: Motion, b: Motion) -> Twist:
    """J v: the rates of (l, y, z) are exactly v; those of the angles are w where aligned.

    v = axes^T (vb - va - wa x (xb - xa)), written at the mass centres; w = axes^T (wB - wA).
    """
    vb = add(b.velocity, cross(b.spin, f.arm_b))
    va = add(a.velocity, cross(a.spin, f.arm_a))
    return Twist(into(f.axes, sub(vb, va)), into(f.axes, sub(b.spin, a.spin)))


@inline
def angles(q: Quaternion) -> Angles:
    """Swing-twist split of q, the orientation of b in the axes of a."""
    x, y, z, w = q
    n = math.sqrt(x * x + w * w)
    if n > 0.0:
        tx, tw = x / n, w / n
        sy, sz = y * tw - z * tx, z * tw + y * tx  # vector part of the swing
        s = math.sqrt(sy * sy + sz * sz)
        rate = 2.0 * math.atan2(s, n) / s if s > 0.0 else 2.0
        m2, m3, half_turn = -rate * sy, -rate * sz, False
    else:  # the swing takes e1a to -e1a about any axis across it: take e2a
        tx, tw = -z, y
        m2, m3, half_turn = -math.pi, 0.0, True
    angle = 2.0 * math.atan2(tx, tw)
    if angle > math.pi:
        angle -= 2.0 * math.pi
    elif angle <= -math.pi:
        angle += 2.0 * math.pi
    return Angles(angle, m2, m3, half_turn)


@inline
def orientation_in(a: Quaternion, b: Quaternion) -> Quaternion:
    """The orientation b seen from a."""
    return multiply(conjugate(a), b)


@inline
def unwrapped(angle: float, predicted: float) -> tuple[float, bool]:
    """The angle with the whole turns nearest to ``predicted``, and whether that is unsure."""
    turns = math.floor((predicted - angle) / (2.0 * math.pi) + 0.5)
    full = angle + 2.0 * math.pi * turns
    return full, abs(full - predicted) > 0.5 * math.pi
