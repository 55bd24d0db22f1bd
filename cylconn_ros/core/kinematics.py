"""Kinematics of the cylindrical connector: relative pose and relative twist of its two nodes.

The connector has two degrees of freedom. Node b, fixed to body B, slides along and spins about the
slot axis e1a of node a, which is fixed to body A:

    slide   l = e1a . (xb - xa)   positive if b moves away from a along +e1a, m
    spin    alpha                 rotation of b against a about e1a, right-handed, rad
    force   f1, m1                act on body B at node b along and about e1a; body A gets the
                                  opposite wrench at the same point

Symbols (axes of a unless stated): d = xb - xa; l = e1a.d; y = e2a.d, z = e3a.d are the offsets;
v, w is the twist of b relative to a at node b. The orientation of b in a is split into swing times
twist: the swing axis is normal to e1a, the twist axis is e1a. The constraint holds y, z and the two
components of the swing.

S is the held swing (misalignment). B then rotates about its own e1b, so that w and the moments are
expressed in the axes N = E S. E are the axes of a, with e1a first; the first axis of N is e1b.
Without a misalignment N equals E.
"""

import math
from typing import NamedTuple

from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.rigid_body import Motion
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

ROUNDING = 1e-15  # rad, of a swing
BELOW_ONE = 1.0 - 2.0**-53


class Nodes(NamedTuple):
    """Positions of the nodes from the mass centres, body axes, and the orientation of node a."""

    a: Vector
    a_axes: Quaternion
    b: Vector
    swing: Quaternion  # S; exactly (0, 0, 0, 1) if aligned


class Frame(NamedTuple):
    """The connector's geometry in one configuration, world axes."""

    axes: Matrix  # E: e1a, e2a, e3a
    swing: Quaternion  # S, the same in every configuration
    d: Vector  # xb - xa
    arm_a: Vector  # xb - mass centre of A: the wrench acts at b on both bodies
    arm_b: Vector  # xb - mass centre of B


class Twist(NamedTuple):
    """Relative velocity at node b in the axes of a, and relative angular velocity in N."""

    v: Vector
    w: Vector


class Angles(NamedTuple):
    """Orientation of b in a: angle about e1a in (-pi, pi], swing from e1b to e1a."""

    angle: float
    misalignment_2: float
    misalignment_3: float
    half_turn: bool  # misaligned by exactly pi: the swing axis is not unique


@inline_function
def aligned(swing: Quaternion) -> bool:
    """Whether there is no misalignment, so that N equals E."""
    return swing[3] == 1.0


@inline_function
def swing_of(misalignment_2: float, misalignment_3: float) -> Quaternion:
    """S, the rotation from e1a to e1b, for a misalignment: the rotation vector from e1b to e1a."""
    size = math.sqrt(misalignment_2 * misalignment_2 + misalignment_3 * misalignment_3)
    if size < ROUNDING:
        return (0.0, 0.0, 0.0, 1.0)
    s = -math.sin(0.5 * size) / size
    w = min(math.cos(0.5 * size), BELOW_ONE)  # so that `aligned` is False
    return (0.0, s * misalignment_2, s * misalignment_3, w)


@inline_function
def frame(nodes: Nodes, a: Motion, b: Motion) -> Frame:
    """The connector's geometry for two bodies, each given at its mass centre."""
    axes_a = matrix(a.orientation)
    arm_b = out_of(matrix(b.orientation), nodes.b)
    arm_a = sub(add(b.com, arm_b), a.com)
    d = sub(arm_a, out_of(axes_a, nodes.a))
    axes = matrix(multiply(a.orientation, nodes.a_axes))
    return Frame(axes, nodes.swing, d, arm_a, arm_b)


@inline_function
def into_swung(f: Frame, a: Vector) -> Vector:
    """N^T a: from world axes."""
    inner = into(f.axes, a)
    return inner if aligned(f.swing) else into(matrix(f.swing), inner)


@inline_function
def out_of_swung(f: Frame, a: Vector) -> Vector:
    """N a: to world axes."""
    return out_of(f.axes, a if aligned(f.swing) else out_of(matrix(f.swing), a))


@inline_function
def relative_twist(f: Frame, a: Motion, b: Motion) -> Twist:
    """J v: v is exactly the rate of (l, y, z); w is the rate of the angles if the swing equals S.

    v = E^T (vb - va - wa x (xb - xa)), written at the mass centres; w = N^T (wB - wA).
    """
    vb = add(b.velocity, cross(b.spin, f.arm_b))
    va = add(a.velocity, cross(a.spin, f.arm_a))
    return Twist(into(f.axes, sub(vb, va)), into_swung(f, sub(b.spin, a.spin)))


@inline_function
def angles(q: Quaternion) -> Angles:
    """Swing-twist decomposition of q, the orientation of b in the axes of a."""
    x, y, z, w = q
    n = math.sqrt(x * x + w * w)
    if n > 0.0:
        tx, tw = x / n, w / n
        sy, sz = y * tw - z * tx, z * tw + y * tx  # vector part of the swing
        s = math.sqrt(sy * sy + sz * sz)
        rate = 2.0 * math.atan2(s, n) / s if s > 0.0 else 2.0
        m2, m3, half_turn = -rate * sy, -rate * sz, False
    else:  # the swing takes e1a to -e1a; of the possible axes e2a is used
        tx, tw = -z, y
        m2, m3, half_turn = -math.pi, 0.0, True
    angle = 2.0 * math.atan2(tx, tw)
    if angle > math.pi:
        angle -= 2.0 * math.pi
    elif angle <= -math.pi:
        angle += 2.0 * math.pi
    return Angles(angle, m2, m3, half_turn)


@inline_function
def orientation_in(a: Quaternion, b: Quaternion) -> Quaternion:
    """The orientation b relative to a."""
    return multiply(conjugate(a), b)


@inline_function
def unwrapped(angle: float, predicted: float) -> tuple[float, bool]:
    """The angle plus the whole turns nearest to ``predicted``; whether the choice is ambiguous.

    Ambiguous: more than a quarter turn from the prediction.
    """
    turns = math.floor((predicted - angle) / (2.0 * math.pi) + 0.5)
    full = angle + 2.0 * math.pi * turns
    return full, abs(full - predicted) > 0.5 * math.pi
