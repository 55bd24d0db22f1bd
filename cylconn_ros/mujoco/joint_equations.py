"""The equations of a joint in a MuJoCo model, compiled: mobility and reactions for (f1, m1).

MuJoCo's Euler step is v+ = v + h (M + h D)^-1 f with the joint damping D. M is stored by rows of a
lower triangle whose columns are a degree of freedom's ancestors, and is factored without fill-in as
L^T D L (Featherstone, Rigid Body Dynamics Algorithms, section 6.5).

The joint's wrench on the subtree of body B is the change of its momentum less known forces; MuJoCo
computes it by mj_rnePostConstraint for the acceleration in mjData.qacc. It changes with another
acceleration by the composite inertia of the subtree: for degrees of freedom up to B by that of B,
for those beyond by that of their own body. Spatial vectors are (rotational, translational) about
the mass centre of the kinematic tree, world axes.
"""

from typing import Final

from cylconn_ros.core import layout
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function, kernel
from cylconn_ros.core.vectors import Vector
from cylconn_ros.mechanism import step

# The integers that describe the joint. -1: the joint does not have this component.
NV: Final = 0
DOFS: Final = 1  # of slide and spin
POSITIONS: Final = 3  # their places in qpos
BODY_A: Final = 5
BODY_B: Final = 6
SUBTREE: Final = 7  # first body that the joint moves
ROOT: Final = 8  # of the kinematic tree
CHAIN: Final = 9  # degrees of freedom up to SUBTREE: their number
BEYOND: Final = 10  # those of bodies beyond it
LISTS: Final = 11  # the degrees of freedom of the chain, those beyond, and the bodies of the latter

# The numbers that describe it.
ORIGIN: Final = 0  # 2: qpos at which length and angle are those of OFFSET
NODE_A: Final = 2  # position in body A
NODE_B: Final = 5  # position in body B
AXES: Final = 8  # e1, e2, e3 in body A
NGEOMETRY: Final = 17


@inline_function
def _rotated(matrix: Array, body: int, a: Array, at: int) -> Vector:
    """The vector at ``a[at]`` in body axes, in world axes."""
    m = 9 * body
    x, y, z = a[at], a[at + 1], a[at + 2]
    return (
        matrix[m] * x + matrix[m + 1] * y + matrix[m + 2] * z,
        matrix[m + 3] * x + matrix[m + 4] * y + matrix[m + 5] * z,
        matrix[m + 6] * x + matrix[m + 7] * y + matrix[m + 8] * z,
    )


@device_function
def factor(
    nv: int, low: Array, source: Array, damping: Array, h: float, start: Array, count: Array,
    columns: Array,
) -> None:  # fmt: skip
    """L and D of source + h damping, in the storage of ``source``; D in place of the diagonal."""
    for k in range(start[nv - 1] + count[nv - 1]):
        low[k] = source[k]
    for i in range(nv):
        low[start[i] + count[i] - 1] += h * damping[i]
    for k in range(nv - 1, -1, -1):
        at, n = start[k], count[k] - 1
        pivot = low[at + n]
        for p in range(n - 1, -1, -1):
            row = start[columns[at + p]]
            share = low[at + p] / pivot
            for q in range(p + 1):
                low[row + q] -= share * low[at + q]
            low[at + p] = share


@device_function
def solve_factored(
    nv: int, low: Array, x: Array, at: int, start: Array, count: Array, columns: Array
) -> None:
    """Solve for the (nv,) right side in ``x`` from index ``at``, in place."""
    for k in range(nv - 1, -1, -1):
        value = x[at + k]
        if value != 0.0:
            row = start[k]
            for p in range(count[k] - 1):
                x[at + columns[row + p]] -= low[row + p] * value
    for k in range(nv):
        row = start[k]
        value = x[at + k] / low[row + count[k] - 1]
        for p in range(count[k] - 1):
            value -= low[row + p] * x[at + columns[row + p]]
        x[at + k] = value


@inline_function
def _momentum(crb: Array, body: int, motion: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """Composite inertia of a body times a spatial vector."""
    i = 10 * body
    (p, q, r), (x, y, z) = motion
    a, b, c, mass = crb[i + 6], crb[i + 7], crb[i + 8], crb[i + 9]
    return (
        (
            crb[i] * p + crb[i + 3] * q + crb[i + 4] * r + b * z - c * y,
            crb[i + 3] * p + crb[i + 1] * q + crb[i + 5] * r + c * x - a * z,
            crb[i + 4] * p + crb[i + 5] * q + crb[i + 2] * r + a * y - b * x,
        ),
        (
            mass * x + q * c - r * b,
            mass * y + r * a - p * c,
            mass * z + p * b - q * a,
        ),
    )


@device_function
def wrench_change(
    index: Array, x: Array, at: int, cdof: Array, crb: Array
) -> tuple[Vector, Vector]:
    """Change of the subtree's wrench (torque, force) by the accelerations in ``x`` from ``at``."""
    p = q = r = u = v = w = 0.0
    chain, beyond = index[CHAIN], index[BEYOND]
    for k in range(chain):
        dof = index[LISTS + k]
        a, c = x[at + dof], 6 * dof
        p, q, r = p + a * cdof[c], q + a * cdof[c + 1], r + a * cdof[c + 2]
        u, v, w = u + a * cdof[c + 3], v + a * cdof[c + 4], w + a * cdof[c + 5]
    (p, q, r), (u, v, w) = _momentum(crb, index[SUBTREE], ((p, q, r), (u, v, w)))
    for k in range(beyond):
        dof, body = index[LISTS + chain + k], index[LISTS + chain + beyond + k]
        a, c = x[at + dof], 6 * dof
        torque, force = _momentum(
            crb, body,
            ((a * cdof[c], a * cdof[c + 1], a * cdof[c + 2]),
             (a * cdof[c + 3], a * cdof[c + 4], a * cdof[c + 5])),
        )  # fmt: skip
        p, q, r = p + torque[0], q + torque[1], r + torque[2]
        u, v, w = u + force[0], v + force[1], w + force[2]
    return (p, q, r), (u, v, w)


@inline_function
def _write_reaction(
    s: Array, at: int, arm: Vector, e2: Vector, e3: Vector, wrench: tuple[Vector, Vector]
) -> None:
    """f2, f3, m2, m3 about node b. arm: from node b to the point that the torque is about."""
    (p, q, r), (u, v, w) = wrench
    p, q, r = (
        p + arm[1] * w - arm[2] * v,
        q + arm[2] * u - arm[0] * w,
        r + arm[0] * v - arm[1] * u,
    )
    s[at] = e2[0] * u + e2[1] * v + e2[2] * w
    s[at + 1] = e3[0] * u + e3[1] * v + e3[2] * w
    s[at + 2] = e2[0] * p + e2[1] * q + e2[2] * r
    s[at + 3] = e3[0] * p + e3[1] * q + e3[2] * r


@inline_function
def _place(
    s: Array, index: Array, geometry: Array, position: Array, matrix: Array, com: Array,
    qpos: Array, qvel: Array,
) -> tuple[Vector, Vector, Vector]:  # fmt: skip
    """Write length, angle and rates; return the arm from node b to the mass centre, e2, e3."""
    a, b, root = index[BODY_A], index[BODY_B], 3 * index[ROOT]
    e1 = _rotated(matrix, a, geometry, AXES)
    e2, e3 = _rotated(matrix, a, geometry, AXES + 3), _rotated(matrix, a, geometry, AXES + 6)
    node_b, node_a = _rotated(matrix, b, geometry, NODE_B), _rotated(matrix, a, geometry, NODE_A)
    x = position[3 * b] + node_b[0]
    y = position[3 * b + 1] + node_b[1]
    z = position[3 * b + 2] + node_b[2]
    s[step.LENGTH] = (
        e1[0] * (x - position[3 * a] - node_a[0])
        + e1[1] * (y - position[3 * a + 1] - node_a[1])
        + e1[2] * (z - position[3 * a + 2] - node_a[2])
    )
    s[step.ANGLE] = 0.0
    if index[POSITIONS + 1] >= 0:
        s[step.ANGLE] = qpos[index[POSITIONS + 1]] - geometry[ORIGIN + 1]
    for k in range(2):
        dof = index[DOFS + k]
        s[step.RATES + k] = qvel[dof] if dof >= 0 else 0.0
    return (com[root] - x, com[root + 1] - y, com[root + 2] - z), e2, e3


@inline_function
def _take_back(applied: Array, dof: int, sent: Array, k: int) -> float:
    """Remove the last step's force, unless another one has been written since; returns it."""
    if applied[dof] != sent[2 + k]:
        return 0.0
    applied[dof] -= sent[k]
    return sent[k]


@device_function
def send_forces(index: Array, applied: Array, sent: Array, out: Array) -> None:
    """Add (f1, m1) to ``applied`` and remember them."""
    for k in range(2):
        dof = index[DOFS + k]
        if dof >= 0:
            sent[k] = out[layout.FORCE + 3 * k]
            applied[dof] += sent[k]
            sent[2 + k] = applied[dof]


@kernel
def take_back(index: Array, applied: Array, sent: Array) -> None:
    """Remove the forces of the last step from ``applied``."""
    for k in range(2):
        if index[DOFS + k] >= 0:
            _take_back(applied, index[DOFS + k], sent, k)


@kernel
def write_response(
    s: Array, index: Array, geometry: Array, wrench: Array, position: Array, matrix: Array,
    com: Array, qpos: Array, qvel: Array, cfrc: Array, at: int,
) -> None:  # fmt: skip
    """Write place and rates of the joint, and its reaction as in ``cfrc_int`` to ``wrench[at]``."""
    arm, e2, e3 = _place(s, index, geometry, position, matrix, com, qpos, qvel)
    i = 6 * index[SUBTREE]
    joint = ((cfrc[i], cfrc[i + 1], cfrc[i + 2]), (cfrc[i + 3], cfrc[i + 4], cfrc[i + 5]))
    _write_reaction(wrench, at, arm, e2, e3, joint)


@kernel
def accelerate(
    work: Array, force: Array, source: Array, damping: Array, h: float, start: Array, count: Array,
    columns: Array, acceleration: Array,
) -> None:  # fmt: skip
    """(M + h D)^-1 force, to ``acceleration``; work: (nC,)."""
    nv = len(force)
    factor(nv, work, source, damping, h, start, count, columns)
    for k in range(nv):
        acceleration[k] = force[k]
    solve_factored(nv, work, acceleration, 0, start, count, columns)


@kernel
def solve_unconstrained(
    par: Array, mem: Array, s: Array, out: Array, low: Array, x: Array, h: float,
    index: Array, geometry: Array, start: Array, count: Array, columns: Array, damping: Array,
    source: Array, force: Array, qacc: Array, qpos: Array, qvel: Array, position: Array,
    matrix: Array, com: Array, cdof: Array, crb: Array, cfrc: Array, applied: Array, sent: Array,
) -> int:  # fmt: skip
    """Solve a step of MuJoCo's Euler integrator without active constraints; returns the status.

    Args:
        par, mem, s, out: see mechanism/step.py. low: (nC,), x: (3 nv,) work arrays. h: s.
        index, geometry: of the joint, see above. start, count, columns: mjModel.M_rowadr,
            M_rownnz, M_colind. damping: dof_damping, or zeros.
        source, force: mjData.M and qfrc_smooth. qacc: the acceleration for which ``cfrc``, that is
            cfrc_int, was computed. applied: qfrc_applied, which gets (f1, m1) in place of those of
            the last step. sent: (4,) those of the last step and what qfrc_applied had with them.
            The rest: mjData, flattened.
    """
    nv = index[NV]
    factor(nv, low, source, damping, h, start, count, columns)
    for k in range(nv):
        x[k], x[nv + k], x[2 * nv + k] = force[k], 0.0, 0.0
    for k in range(2):
        if index[DOFS + k] >= 0:
            x[index[DOFS + k]] -= _take_back(applied, index[DOFS + k], sent, k)
    solve_factored(nv, low, x, 0, start, count, columns)
    arm, e2, e3 = _place(s, index, geometry, position, matrix, com, qpos, qvel)
    for k in range(2):
        dof = index[DOFS + k]
        s[step.FREE + k] = 0.0
        if dof >= 0:
            s[step.FREE + k] = qvel[dof] + h * x[dof]
            x[(k + 1) * nv + dof] = 1.0
            solve_factored(nv, low, x, (k + 1) * nv, start, count, columns)
    i, j = index[DOFS], index[DOFS + 1]
    s[step.MOBILITY] = h * x[nv + i] if i >= 0 else 1.0
    s[step.MOBILITY + 1] = h * x[2 * nv + i] if i >= 0 and j >= 0 else 0.0
    s[step.MOBILITY + 2] = h * x[2 * nv + j] if j >= 0 else 1.0
    for k in range(nv):
        x[k] -= qacc[k]
    b = 6 * index[SUBTREE]
    (p, q, r), (u, v, w) = wrench_change(index, x, 0, cdof, crb)
    joint = (
        (cfrc[b] + p, cfrc[b + 1] + q, cfrc[b + 2] + r),
        (cfrc[b + 3] + u, cfrc[b + 4] + v, cfrc[b + 5] + w),
    )
    _write_reaction(s, step.BASE, arm, e2, e3, joint)
    _write_reaction(s, step.BY_F1, arm, e2, e3, wrench_change(index, x, nv, cdof, crb))
    _write_reaction(s, step.BY_M1, arm, e2, e3, wrench_change(index, x, 2 * nv, cdof, crb))
    status = step.solve_step(par, mem, s, h, out)
    send_forces(index, applied, sent, out)
    return status


@kernel
def send(index: Array, applied: Array, sent: Array, out: Array) -> None:
    """As :func:`send_forces`, called from Python."""
    send_forces(index, applied, sent, out)
