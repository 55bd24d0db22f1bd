"""From a sample to the connector's own quantities: what every method does first."""

import math
from typing import NamedTuple

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import (
    Frame,
    Nodes,
    Twist,
    aligned,
    angles,
    frame,
    orientation_in,
    relative_twist,
    swing_of,
    unwrapped,
)
from cylconn_ros.core.passivity import count, jumped, release
from cylconn_ros.core.rigid_body import Body, Motion, at_com
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.vectors import (
    Quaternion,
    Vector,
    add_scaled,
    conjugate,
    dot,
    into,
    multiply,
    norm,
    normalised,
    scale,
    sub,
)

Two = tuple[float, float]

HUGE = 1e15  # beyond it squares of squares leave the range of doubles: as good as infinite
TINY = 1e-6  # shorter quaternions have no direction worth trusting
LEAST_MISFIT = 1e-14  # m^2, over some ten samples
CONTRADICTION = 0.2  # share of the motion by which poses and twists may differ


class Observed(NamedTuple):
    """The connector at a sample: bodies at their mass centres, geometry, constraint error."""

    body_a: Body
    body_b: Body
    nodes: Nodes
    a: Motion
    b: Motion
    frame: Frame
    twist: Twist  # J(q) v
    length: float
    angle: float
    error: Four  # y, z less their targets, swing from S in N; its rates are (v2, v3, w2, w3)
    flags: int


@inline_function
def status_of(sample: Array) -> int:
    """OK, or why the sample cannot be used."""
    for k in range(out_at.NSAMPLE):
        if not abs(sample[k]) < HUGE:  # NaN too
            return out_at.NOT_FINITE
    for at in (out_at.A_POSE + 3, out_at.B_POSE + 3):
        size = 0.0
        for k in range(4):
            size += sample[at + k] * sample[at + k]
        if not size > TINY * TINY:
            return out_at.BAD_QUATERNION
    return out_at.OK


@inline_function
def _motion(body: Body, sample: Array, pose: int, twist: int) -> Motion:
    return at_com(
        body,
        model.vector(sample, pose),
        normalised(model.quaternion(sample, pose + 3)),
        model.vector(sample, twist),
        model.vector(sample, twist + 3),
    )


@inline_function
def _orientation(par: Array, mem: Array, a: Motion, b: Motion) -> Quaternion:
    """Node b's axes in node a's; the first sample fixes them in body B where they are not given."""
    axes_a = multiply(a.orientation, model.quaternion(par, model.NODE_A + 3))
    if mem[model.STARTED] == 0.0:
        axes_b = model.quaternion(par, model.NODE_B + 4)
        if par[model.NODE_B + 3] == 0.0:
            axes_b = normalised(multiply(conjugate(b.orientation), axes_a))
        for k in range(4):
            mem[model.AXES_B + k] = axes_b[k]
    axes_b = multiply(b.orientation, model.quaternion(mem, model.AXES_B))
    return orientation_in(axes_a, axes_b)


@inline_function
def violation(mem: Array, nodes: Nodes, a: Motion, b: Motion) -> Four:
    """The constraint's error in another place, once there is a reference configuration."""
    f = frame(nodes, a, b)
    axes_a = multiply(a.orientation, nodes.a_axes)
    axes_b = multiply(b.orientation, model.quaternion(mem, model.AXES_B))
    _, swing, _, _ = _swung(nodes, orientation_in(axes_a, axes_b))
    return _error(mem, into(f.axes, f.d), swing)


@inline_function
def observe(par: Array, mem: Array, sample: Array, out: Array) -> Observed:
    """Measure the connector; write the kinematic part of ``out``; keep reference, turns and work.

    Args:
        par, mem: the model's arrays; the first sample fills the reference configuration of ``mem``.
        sample: (NSAMPLE,) a sample for which :func:`status_of` is OK.
        out: (NOUT,).
    """
    body_a, body_b = model.body(par, model.BODY_A), model.body(par, model.BODY_B)
    a = _motion(body_a, sample, out_at.A_POSE, out_at.A_TWIST)
    b = _motion(body_b, sample, out_at.B_POSE, out_at.B_TWIST)
    seen = _orientation(par, mem, a, b)
    if mem[model.STARTED] == 0.0:
        _hold_swing(par, mem, seen)
    nodes = model.nodes(par, model.quaternion(mem, model.SWING))
    f = frame(nodes, a, b)
    rates = relative_twist(f, a, b)
    position = into(f.axes, f.d)
    angle, swing, misalignment, half_turn = _swung(nodes, seen)
    flags = out_at.HALF_TURN if half_turn else 0

    h = mem[model.LAST_PERIOD]
    if mem[model.STARTED] == 0.0:
        _start(par, mem, position, angle)
    else:
        predicted = mem[model.LAST_ANGLE] + 0.5 * h * (mem[model.LAST_SPIN] + rates.w[0])
        angle, unsure = unwrapped(angle, predicted)
        if unsure:
            flags |= out_at.TURN_AMBIGUOUS
        moved = sub(position, model.vector(mem, model.LAST_POSITION))
        told = scale(0.5 * h, _sum(model.vector(mem, model.LAST_VELOCITY), rates.v))
        if norm(sub(moved, told)) > CONTRADICTION * (norm(moved) + norm(told)) + 1e-6:
            flags |= out_at.TWIST_CONTRADICTS
        if _follow(par, mem, a, b, h):
            flags |= out_at.INTEGRATION
        slid, spun = moved[0], angle - mem[model.LAST_ANGLE]
        if mem[model.JUMPED] != 0.0:
            release(mem)
            by_twist = 0.5 * h * (mem[model.LAST_SPIN] + rates.w[0])
            mem[model.SHIFT], mem[model.SHIFT + 1] = slid - told[0], spun - by_twist
            slid, spun = told[0], by_twist
        mem[model.ACTUATED] += mem[model.LAST_ACTUATION] * slid
        mem[model.ACTUATED] += mem[model.LAST_ACTUATION + 1] * spun
    _keep_place(mem, a, model.LAST_A)
    _keep_place(mem, b, model.LAST_B)
    model.put(mem, model.LAST_VELOCITIES, a.velocity)
    model.put(mem, model.LAST_VELOCITIES + 3, b.velocity)

    mem[model.LAST_ANGLE], mem[model.LAST_SPIN] = angle, rates.w[0]
    model.put(mem, model.LAST_POSITION, position)
    model.put(mem, model.LAST_VELOCITY, rates.v)
    error = _error(mem, position, swing)
    if par[model.LATENCY] == 0.0:
        _rebase(par, mem, position[0], angle)
    _write(par, mem, out, position, angle, misalignment, rates, error)
    return Observed(body_a, body_b, nodes, a, b, f, rates, position[0], angle, error, flags)


@inline_function
def _follow(par: Array, mem: Array, a: Motion, b: Motion, h: float) -> bool:
    """Look how mass centres follow velocities, and count the last wrench's work on their motion.

    By h (v + v+)/2, or by h v+: whether it is otherwise than ``plant_integration`` says, as a
    target for the wrong one leaves disturbances undamped. By neither: a body has jumped. Where
    wrenches act late, core/latency.py has looked for jumps and counted.
    """
    at, prompt = model.INTEGRATED, par[model.LATENCY] == 0.0
    exact, other, jump = 0.9 * mem[at], 0.9 * mem[at + 1], False
    for k in range(2):
        m = a if k == 0 else b
        last = model.LAST_A if k == 0 else model.LAST_B
        before = model.vector(mem, model.LAST_VELOCITIES + 3 * k)
        moved, told = sub(m.com, model.vector(mem, last + 6)), scale(h, m.velocity)
        late = sub(moved, told)
        mean = add_scaled(late, 0.5 * h, sub(m.velocity, before))
        apart, apart_late = dot(mean, mean), dot(late, late)
        exact, other = exact + apart, other + apart_late
        if prompt:
            if jumped(par, moved, told, min(apart, apart_late), h):
                jump, moved = True, sub(moved, mean)
            turning = scale(0.5 * h, _sum(m.spin, model.vector(mem, last + 9)))
            by_force = dot(model.vector(mem, last), moved)
            count(mem, by_force + dot(model.vector(mem, last + 3), turning))
    if prompt:
        mem[model.JUMPED] = 1.0 if jump else 0.0
    mem[at], mem[at + 1] = exact, other
    if model.output(par).semi_implicit:
        exact, other = other, exact
    return exact > LEAST_MISFIT and other < 1e-2 * exact


@inline_function
def _error(mem: Array, position: Vector, swing: Two) -> Four:
    """Offsets less their targets, and the swing from the held one."""
    return (
        position[1] - mem[model.TARGET],
        position[2] - mem[model.TARGET + 1],
        swing[0],
        swing[1],
    )


@inline_function
def _swung(nodes: Nodes, seen: Quaternion) -> tuple[float, Two, Two, bool]:
    """The angle, the swing from the held one (in N), the misalignment (axes of a), a half turn.

    seen: node b's axes in node a's. As S R T with a remaining swing R, the angle is that of T: it
    turns at w1 also where S is near a half turn.
    """
    whole = angles(seen)
    m2, m3 = whole.misalignment_2, whole.misalignment_3
    if aligned(nodes.swing):
        return whole.angle, (-m2, -m3), (m2, m3), whole.half_turn
    rest = angles(multiply(conjugate(nodes.swing), seen))
    swing = (-rest.misalignment_2, -rest.misalignment_3)
    return rest.angle, swing, (m2, m3), whole.half_turn


@inline_function
def _hold_swing(par: Array, mem: Array, seen: Quaternion) -> None:
    """Keep the swing that is to be held, where one is: that of the first sample."""
    whole = angles(seen)
    swing = (0.0, 0.0, 0.0, 1.0)
    if par[model.REFERENCE + 1] != 0.0:
        swing = swing_of(whole.misalignment_2, whole.misalignment_3)
    for k in range(4):
        mem[model.SWING + k] = swing[k]


@inline_function
def _sum(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inline_function
def _start(par: Array, mem: Array, position: Vector, angle: float) -> None:
    """Take this sample as the reference configuration."""
    mem[model.STARTED] = 1.0
    mem[model.LENGTH0] = mem[model.HELD_LENGTH] = position[0]
    mem[model.ANGLE0] = mem[model.HELD_ANGLE] = angle
    hold = par[model.REFERENCE] != 0.0
    mem[model.TARGET] = position[1] if hold else 0.0
    mem[model.TARGET + 1] = position[2] if hold else 0.0
    mem[model.SPRING0] = _spring_energy(par, mem, position[0], angle)


@inline_function
def _spring_energy(par: Array, mem: Array, length: float, angle: float) -> float:
    """Energy in the springs on slide and spin, J."""
    u1 = length - model.given(par[model.REFERENCE + 2], mem[model.LENGTH0])
    ur = angle - model.given(par[model.REFERENCE + 3], mem[model.ANGLE0])
    return 0.5 * (par[model.ELASTICITY] * u1 * u1 + par[model.ELASTICITY + 1] * ur * ur)


@inline_function
def _rebase(par: Array, mem: Array, length: float, angle: float) -> None:
    """Leave out of the account by what a jump has changed the springs' energy."""
    if mem[model.JUMPED] != 0.0:
        without = (length - mem[model.SHIFT], angle - mem[model.SHIFT + 1])
        mem[model.SPRING0] += _spring_energy(par, mem, length, angle)
        mem[model.SPRING0] -= _spring_energy(par, mem, without[0], without[1])


@inline_function
def _keep_place(mem: Array, m: Motion, at: int) -> None:
    """Keep mass centre and spin for the coming interval."""
    model.put(mem, at + 6, m.com)
    model.put(mem, at + 9, m.spin)


@device_function
def write_measured(par: Array, mem: Array, sample: Array, early: float, out: Array) -> None:
    """Write the kinematic part of ``out`` for a sample answered ``early`` seconds ahead."""
    nodes = model.nodes(par, model.quaternion(mem, model.SWING))
    a = _motion(model.body(par, model.BODY_A), sample, out_at.A_POSE, out_at.A_TWIST)
    b = _motion(model.body(par, model.BODY_B), sample, out_at.B_POSE, out_at.B_TWIST)
    f = frame(nodes, a, b)
    rates = relative_twist(f, a, b)
    position = into(f.axes, f.d)
    angle, swing, misalignment, _ = _swung(nodes, _orientation(par, mem, a, b))
    angle, _ = unwrapped(angle, mem[model.LAST_ANGLE] - early * rates.w[0])
    error = _error(mem, position, swing)
    _rebase(par, mem, position[0], angle)
    _write(par, mem, out, position, angle, misalignment, rates, error)


@inline_function
def _write(
    par: Array,
    mem: Array,
    out: Array,
    position: Vector,
    angle: float,
    misalignment: Two,
    rates: Twist,
    error: Four,
) -> None:
    at = model.REFERENCE
    out[out_at.LENGTH] = position[0]
    out[out_at.ANGLE] = angle
    out[out_at.DISPLACEMENT] = position[0] - mem[model.LENGTH0]
    out[out_at.ROTATION] = angle - mem[model.ANGLE0]
    out[out_at.MATERIAL_DISPLACEMENT] = position[0] - model.given(par[at + 2], mem[model.LENGTH0])
    out[out_at.MATERIAL_ROTATION] = angle - model.given(par[at + 3], mem[model.ANGLE0])
    out[out_at.OFFSET], out[out_at.OFFSET + 1] = position[1], position[2]
    out[out_at.MISALIGNMENT], out[out_at.MISALIGNMENT + 1] = misalignment
    model.put(out, out_at.VELOCITY, rates.v)
    model.put(out, out_at.ANGULAR_VELOCITY, rates.w)
    out[out_at.OFFSET_VIOLATION] = math.sqrt(error[0] * error[0] + error[1] * error[1])
    out[out_at.ANGULAR_VIOLATION] = math.sqrt(error[2] * error[2] + error[3] * error[3])
    out[out_at.VELOCITY_VIOLATION] = math.sqrt(rates.v[1] * rates.v[1] + rates.v[2] * rates.v[2])
    out[out_at.SPIN_VIOLATION] = math.sqrt(rates.w[1] * rates.w[1] + rates.w[2] * rates.w[2])
    out[out_at.ENERGY_EXCHANGED] = mem[model.EXCHANGED]
    stored = _spring_energy(par, mem, position[0], angle) - mem[model.SPRING0]
    out[out_at.PASSIVITY_BALANCE] = mem[model.WORK] + stored - mem[model.ACTUATED]
    radius = par[model.FRICTION + 5]
    s1, s2 = rates.v[0], radius * rates.w[0]
    out[out_at.SLIP_VELOCITY], out[out_at.SLIP_VELOCITY + 1] = s1, s2
    out[out_at.SLIP_RATE] = math.sqrt(s1 * s1 + s2 * s2)
