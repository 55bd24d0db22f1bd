"""The Delassus operator at node b, G = J M^-1 J^T: relative velocity per unit impulse."""

from typing import NamedTuple

from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.kinematics import aligned
from cylconn_ros.core.rigid_body import Body
from cylconn_ros.core.vectors import (
    Matrix,
    Quaternion,
    Symmetric,
    Vector,
    add,
    cross,
    into,
    matrix,
    product,
    scale,
    tensor_in,
)


class DelassusOperator(NamedTuple):
    """G by its 3x3 blocks: force to velocity, moment to velocity, moment to angular velocity.

    Forces and velocities are in the axes of a, E; moments and angular velocities in E or N = E S.
    """

    ff: Symmetric
    fm: Matrix  # rows: dv_i / dm_j
    mm: Symmetric


@inline_function
def of_body(body: Body, axes: Matrix, orientation: Quaternion, arm: Vector) -> DelassusOperator:
    """The operator of one body, axes of a; ``arm``: node b from the mass centre, world axes."""
    zero = (0.0, 0.0, 0.0)
    if not body.free:
        none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return DelassusOperator(none, (zero, zero, zero), none)
    j = tensor_in(product(axes, matrix(orientation)), body.inverse_inertia)
    r = into(axes, arm)
    # dv = f/m + (j (r x f + m)) x r;  dw = j (r x f + m)
    j0, j1, j2 = (j[0], j[1], j[2]), (j[1], j[3], j[4]), (j[2], j[4], j[5])
    m0, m1, m2 = cross(j0, r), cross(j1, r), cross(j2, r)  # dv of a unit moment about each axis
    i = body.inverse_mass
    # columns of r x (.): unit force k gives the moment r x e_k
    f0 = add(scale(r[2], m1), scale(-r[1], m2))
    f1 = add(scale(-r[2], m0), scale(r[0], m2))
    f2 = add(scale(r[1], m0), scale(-r[0], m1))
    ff = (i + f0[0], f0[1], f0[2], i + f1[1], f1[2], i + f2[2])
    fm = ((m0[0], m1[0], m2[0]), (m0[1], m1[1], m2[1]), (m0[2], m1[2], m2[2]))
    return DelassusOperator(ff, fm, j)


@inline_function
def sum_of_bodies(a: DelassusOperator, b: DelassusOperator) -> DelassusOperator:
    """The operator of the relative velocity: opposite wrenches act on both bodies."""
    x, y = a.ff, b.ff
    u, v = a.mm, b.mm
    return DelassusOperator(
        (x[0] + y[0], x[1] + y[1], x[2] + y[2], x[3] + y[3], x[4] + y[4], x[5] + y[5]),
        (add(a.fm[0], b.fm[0]), add(a.fm[1], b.fm[1]), add(a.fm[2], b.fm[2])),
        (u[0] + v[0], u[1] + v[1], u[2] + v[2], u[3] + v[3], u[4] + v[4], u[5] + v[5]),
    )


@inline_function
def in_swing_axes(g: DelassusOperator, swing: Quaternion) -> DelassusOperator:
    """G with moments and angular velocities in N = E S instead of E."""
    if aligned(swing):
        return g
    n = matrix(swing)  # columns: N in the axes of a
    back = ((n[0][0], n[1][0], n[2][0]), (n[0][1], n[1][1], n[2][1]), (n[0][2], n[1][2], n[2][2]))
    fm = (into(n, g.fm[0]), into(n, g.fm[1]), into(n, g.fm[2]))
    return DelassusOperator(g.ff, fm, tensor_in(back, g.mm))
