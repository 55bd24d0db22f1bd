"""Relative state of the connector from a sample: the first part of a step of every method."""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import is_delayed
from cylconn_ros.core.driven_acceleration import update_acceleration
from cylconn_ros.core.elements import element_energy
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
from cylconn_ros.core.overlap import set_contact_range
from cylconn_ros.core.passivity import add_work, has_jumped, reset_stick_position
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

MAX_INPUT = 1e15  # fourth powers of larger inputs overflow: treated as not finite
MIN_QUATERNION_NORM = 1e-6  # shorter quaternions define no orientation
LEAST_MISFIT = 1e-14  # m^2, over some ten samples
CONTRADICTION = 0.2  # share of the motion by which poses and twists may differ


class RelativeState(NamedTuple):
    """The connector at a sample: bodies at their mass centres, geometry, constraint error.

    length (m) and angle (rad) are those of node b relative to node a.
    """

    body_a: Body
    body_b: Body
    nodes: Nodes
    a: Motion
    b: Motion
    frame: Frame
    twist: Twist  # J(q) v
    length: float
    angle: float
    error: Four  # y, z minus their targets, swing from S in N; its rates are (v2, v3, w2, w3)
    flags: int


@inline_function
def sample_status(sample: Array) -> int:
    """OK, or the reason why the sample cannot be used."""
    for k in range(layout.NSAMPLE):
        if not abs(sample[k]) < MAX_INPUT:  # NaN too
            return layout.NOT_FINITE
    for at in (layout.A_POSE + 3, layout.B_POSE + 3):
        size = 0.0
        for k in range(4):
            size += sample[at + k] * sample[at + k]
        if not size > MIN_QUATERNION_NORM * MIN_QUATERNION_NORM:
            return layout.BAD_QUATERNION
    return layout.OK


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
    """Orientation of node b in node a; the first sample defines it in body B if it is not given."""
    axes_a = multiply(a.orientation, model.quaternion(par, model.NODE_A + 3))
    if mem[model.HAS_REFERENCE] == 0.0:
        axes_b = model.quaternion(par, model.NODE_B + 4)
        if par[model.NODE_B + 3] == 0.0:
            axes_b = normalised(multiply(conjugate(b.orientation), axes_a))
        for k in range(4):
            mem[model.AXES_B + k] = axes_b[k]
    axes_b = multiply(b.orientation, model.quaternion(mem, model.AXES_B))
    return orientation_in(axes_a, axes_b)


@inline_function
def constraint_error(mem: Array, nodes: Nodes, a: Motion, b: Motion) -> Four:
    """The constraint error in another configuration; requires a reference configuration."""
    f = frame(nodes, a, b)
    axes_a = multiply(a.orientation, nodes.a_axes)
    axes_b = multiply(b.orientation, model.quaternion(mem, model.AXES_B))
    _, swing, _, _ = _angle_and_swing(nodes, orientation_in(axes_a, axes_b))
    return _error(mem, into(f.axes, f.d), swing)


@inline_function
def measure(par: Array, mem: Array, sample: Array, step: float, out: Array) -> RelativeState:
    """Compute the relative state; write the kinematic part of ``out``; update the memory.

    The memory gets the reference configuration, the number of turns and the work; ``par`` the
    contact in the middle of the step, if it changes with the slide (core/overlap.py).

    Args:
        par, mem: the model's arrays; the first sample fills the reference configuration of ``mem``.
        sample: (NSAMPLE,) a sample for which :func:`status_of` is OK.
        step: of the step that begins at the sample, s; negative for one that ends there.
        out: (NOUT,).
    """
    body_a, body_b = model.body(par, model.BODY_A), model.body(par, model.BODY_B)
    a = _motion(body_a, sample, layout.A_POSE, layout.A_TWIST)
    b = _motion(body_b, sample, layout.B_POSE, layout.B_TWIST)
    seen = _orientation(par, mem, a, b)
    if mem[model.HAS_REFERENCE] == 0.0:
        _store_swing(par, mem, seen)
    nodes = model.nodes(par, model.quaternion(mem, model.SWING))
    f = frame(nodes, a, b)
    rates = relative_twist(f, a, b)
    position = into(f.axes, f.d)
    angle, swing, misalignment, half_turn = _angle_and_swing(nodes, seen)
    flags = layout.HALF_TURN if half_turn else 0

    h = mem[model.LAST_PERIOD]
    if mem[model.HAS_REFERENCE] == 0.0:
        _store_reference(par, mem, position, angle)
    else:
        predicted = mem[model.LAST_ANGLE] + 0.5 * h * (mem[model.LAST_SPIN] + rates.w[0])
        angle, unsure = unwrapped(angle, predicted)
        if unsure:
            flags |= layout.TURN_AMBIGUOUS
        moved = sub(position, model.vector(mem, model.LAST_POSITION))
        expected = scale(0.5 * h, _add(model.vector(mem, model.LAST_VELOCITY), rates.v))
        if _check_motion(par, mem, a, b, h):
            flags |= layout.INTEGRATION
        if mem[model.CONTRADICTED] != 0.0:
            flags |= layout.TWIST_CONTRADICTS
        slid, spun = moved[0], angle - mem[model.LAST_ANGLE]
        if mem[model.JUMPED] != 0.0:
            reset_stick_position(mem)
            by_twist = 0.5 * h * (mem[model.LAST_SPIN] + rates.w[0])
            mem[model.JUMP_SHIFT], mem[model.JUMP_SHIFT + 1] = slid - expected[0], spun - by_twist
            slid, spun = expected[0], by_twist
        mem[model.ACTUATION_WORK] += mem[model.LAST_ACTUATION] * slid
        mem[model.ACTUATION_WORK] += mem[model.LAST_ACTUATION + 1] * spun
    if not body_a.free:
        update_acceleration(mem, a, 0, h)
    if not body_b.free:
        update_acceleration(mem, b, 1, h)
    _store_body(mem, a, model.LAST_A)
    _store_body(mem, b, model.LAST_B)
    model.write_vector(mem, model.LAST_VELOCITIES, a.velocity)
    model.write_vector(mem, model.LAST_VELOCITIES + 3, b.velocity)

    mem[model.LAST_ANGLE], mem[model.LAST_SPIN] = angle, rates.w[0]
    model.write_vector(mem, model.LAST_POSITION, position)
    model.write_vector(mem, model.LAST_VELOCITY, rates.v)
    ahead = min(step, 0.0) if model.output(par).semi_implicit else 0.5 * step
    if not set_contact_range(par, mem[model.LENGTH0], position[0] + ahead * rates.v[0], out):
        flags |= layout.DISENGAGED
    error = _error(mem, position, swing)
    if not is_delayed(par, mem):
        _exclude_jump(par, mem, position[0], angle)
    _write_kinematics(par, mem, out, position, angle, misalignment, rates, error)
    return RelativeState(body_a, body_b, nodes, a, b, f, rates, position[0], angle, error, flags)


@inline_function
def check_twist(mem: Array, k: int, moved: Vector, before: Vector, after: Vector, h: float) -> None:
    """Set CONTRADICTED in ``mem`` if the motion of body k within h contradicts its twists.

    ``moved``: the change of position of the mass centre; ``before``, ``after``: its velocities.

    An exact plant moves by h (v + v+)/2 and a semi-implicit one by h v+; if the velocity changes
    within h (a stop, an impact, the end of slip), the motion is between h v and h v+. A change of
    position farther than CONTRADICTION from all of these is not the motion of these velocities.
    """
    start, span = scale(h, before), scale(h, sub(after, before))
    off, size = sub(moved, start), dot(span, span)
    share = min(max(dot(off, span) / size, 0.0), 1.0) if size > 0.0 else 0.0
    nearest = add_scaled(start, share, span)
    apart = norm(sub(moved, nearest))
    if apart > CONTRADICTION * (norm(moved) + norm(nearest)) + 1e-6:
        by_twist = scale(0.5 * h, _add(before, after))
        at = model.CONTRADICTION + 3 * k
        mem[at], mem[at + 1] = dot(moved, moved), dot(by_twist, by_twist)
        mem[at + 2] = dot(moved, by_twist)
        mem[model.STAMP_PERIOD] = h
        mem[model.CONTRADICTED] = 1.0


@inline_function
def _check_motion(par: Array, mem: Array, a: Motion, b: Motion, h: float) -> bool:
    """Compare the motion of the mass centres with their velocities and add the work of the wrench.

    Positions change by h (v + v+)/2 (exact plant) or h v+ (semi-implicit plant). Returns True if
    the measured integration is not the one that ``plant_integration`` states: a target for the
    wrong one leaves disturbances undamped. If neither fits, the body has jumped. With delayed
    wrenches core/latency.py does all of this.
    """
    at, prompt = model.INTEGRATION_MISFIT, not is_delayed(par, mem)
    exact, other, jump = 0.9 * mem[at], 0.9 * mem[at + 1], False
    if prompt:
        mem[model.CONTRADICTED] = 0.0
    for k in range(2):
        m = a if k == 0 else b
        last = model.LAST_A if k == 0 else model.LAST_B
        before = model.vector(mem, model.LAST_VELOCITIES + 3 * k)
        moved, predicted = sub(m.com, model.vector(mem, last + 6)), scale(h, m.velocity)
        late = sub(moved, predicted)
        mean = add_scaled(late, 0.5 * h, sub(m.velocity, before))
        apart, apart_late = dot(mean, mean), dot(late, late)
        exact, other = exact + apart, other + apart_late
        if prompt:
            check_twist(mem, k, moved, before, m.velocity, h)
            if has_jumped(par, moved, predicted, min(apart, apart_late), h):
                jump, moved = True, sub(moved, mean)
            turning = scale(0.5 * h, _add(m.spin, model.vector(mem, last + 9)))
            by_force = dot(model.vector(mem, last), moved)
            add_work(mem, by_force + dot(model.vector(mem, last + 3), turning))
    if prompt:
        mem[model.JUMPED] = 1.0 if jump else 0.0
    if prompt:
        mem[at], mem[at + 1] = exact, other
    else:
        exact, other = mem[at], mem[at + 1]
    if model.output(par).semi_implicit:
        exact, other = other, exact
    return exact > LEAST_MISFIT and other < 1e-2 * exact


@inline_function
def _error(mem: Array, position: Vector, swing: Two) -> Four:
    """Offsets minus their targets, and the swing relative to the held one."""
    return (
        position[1] - mem[model.TARGET],
        position[2] - mem[model.TARGET + 1],
        swing[0],
        swing[1],
    )


@inline_function
def _angle_and_swing(nodes: Nodes, seen: Quaternion) -> tuple[float, Two, Two, bool]:
    """Angle, swing from the held one (in N), misalignment (axes of a), and a half turn.

    seen: orientation of node b in node a. It is split as S R T with a remaining swing R; the angle
    is that of T, which changes at the rate w1 even if S is near a half turn.
    """
    whole = angles(seen)
    m2, m3 = whole.misalignment_2, whole.misalignment_3
    if aligned(nodes.swing):
        return whole.angle, (-m2, -m3), (m2, m3), whole.half_turn
    rest = angles(multiply(conjugate(nodes.swing), seen))
    swing = (-rest.misalignment_2, -rest.misalignment_3)
    return rest.angle, swing, (m2, m3), whole.half_turn


@inline_function
def _store_swing(par: Array, mem: Array, seen: Quaternion) -> None:
    """Store the held swing: that of the first sample, or none."""
    whole = angles(seen)
    swing = (0.0, 0.0, 0.0, 1.0)
    if par[model.REFERENCE + 1] != 0.0:
        swing = swing_of(whole.misalignment_2, whole.misalignment_3)
    for k in range(4):
        mem[model.SWING + k] = swing[k]


@inline_function
def _add(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inline_function
def _store_reference(par: Array, mem: Array, position: Vector, angle: float) -> None:
    """Take this sample as the reference configuration."""
    mem[model.HAS_REFERENCE] = 1.0
    mem[model.LENGTH0] = mem[model.STICK_LENGTH] = position[0]
    mem[model.ANGLE0] = mem[model.STICK_ANGLE] = angle
    hold = par[model.REFERENCE] != 0.0
    mem[model.TARGET] = position[1] if hold else 0.0
    mem[model.TARGET + 1] = position[2] if hold else 0.0
    mem[model.SPRING0] = spring_energy_of(par, mem, position[0], angle)


@inline_function
def spring_energy_of(par: Array, mem: Array, length: float, angle: float) -> float:
    """Energy in the springs and compliant stops on slide and spin, J."""
    u1 = length - model.value_or(par[model.REFERENCE + 2], mem[model.LENGTH0])
    ur = angle - model.value_or(par[model.REFERENCE + 3], mem[model.ANGLE0])
    stored = 0.5 * (par[model.ELASTICITY] * u1 * u1 + par[model.ELASTICITY + 1] * ur * ur)
    if par[model.ELEMENTS] != 0.0:
        stored += element_energy(par, model.ELEMENTS, 0, u1, length)
    if par[model.ELEMENTS + 1] != 0.0:
        stored += element_energy(par, model.ELEMENTS, 1, ur, angle)
    return stored


@inline_function
def _exclude_jump(par: Array, mem: Array, length: float, angle: float) -> None:
    """Exclude the change of spring energy by a jump from the passivity balance."""
    if mem[model.JUMPED] != 0.0:
        without = (length - mem[model.JUMP_SHIFT], angle - mem[model.JUMP_SHIFT + 1])
        mem[model.SPRING0] += spring_energy_of(par, mem, length, angle)
        mem[model.SPRING0] -= spring_energy_of(par, mem, without[0], without[1])


@inline_function
def _store_body(mem: Array, m: Motion, at: int) -> None:
    """Store mass centre and angular velocity for the next interval."""
    model.write_vector(mem, at + 6, m.com)
    model.write_vector(mem, at + 9, m.spin)


@device_function
def write_measured(par: Array, mem: Array, sample: Array, early: float, out: Array) -> None:
    """Write the kinematic part of ``out`` for the sample, ``early`` s before the action."""
    nodes = model.nodes(par, model.quaternion(mem, model.SWING))
    a = _motion(model.body(par, model.BODY_A), sample, layout.A_POSE, layout.A_TWIST)
    b = _motion(model.body(par, model.BODY_B), sample, layout.B_POSE, layout.B_TWIST)
    f = frame(nodes, a, b)
    rates = relative_twist(f, a, b)
    position = into(f.axes, f.d)
    angle, swing, misalignment, _ = _angle_and_swing(nodes, _orientation(par, mem, a, b))
    angle, _ = unwrapped(angle, mem[model.LAST_ANGLE] - early * rates.w[0])
    error = _error(mem, position, swing)
    _exclude_jump(par, mem, position[0], angle)
    _write_kinematics(par, mem, out, position, angle, misalignment, rates, error)


@inline_function
def _write_kinematics(
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
    out[layout.LENGTH] = position[0]
    out[layout.ANGLE] = angle
    out[layout.DISPLACEMENT] = position[0] - mem[model.LENGTH0]
    out[layout.ROTATION] = angle - mem[model.ANGLE0]
    out[layout.MATERIAL_DISPLACEMENT] = position[0] - model.value_or(
        par[at + 2], mem[model.LENGTH0]
    )
    out[layout.MATERIAL_ROTATION] = angle - model.value_or(par[at + 3], mem[model.ANGLE0])
    out[layout.OFFSET], out[layout.OFFSET + 1] = position[1], position[2]
    out[layout.MISALIGNMENT], out[layout.MISALIGNMENT + 1] = misalignment
    model.write_vector(out, layout.VELOCITY, rates.v)
    model.write_vector(out, layout.ANGULAR_VELOCITY, rates.w)
    out[layout.OFFSET_VIOLATION] = math.sqrt(error[0] * error[0] + error[1] * error[1])
    out[layout.ANGULAR_VIOLATION] = math.sqrt(error[2] * error[2] + error[3] * error[3])
    out[layout.VELOCITY_VIOLATION] = math.sqrt(rates.v[1] * rates.v[1] + rates.v[2] * rates.v[2])
    out[layout.SPIN_VIOLATION] = math.sqrt(rates.w[1] * rates.w[1] + rates.w[2] * rates.w[2])
    out[layout.ENERGY_EXCHANGED] = mem[model.WORK_EXCHANGED]
    stored = spring_energy_of(par, mem, position[0], angle) - mem[model.SPRING0]
    mem[model.SPRING_ENERGY] = stored
    out[layout.PASSIVITY_BALANCE] = mem[model.WORK] + stored - mem[model.ACTUATION_WORK]
    radius = model.law(par).radius
    s1, s2 = rates.v[0], radius * rates.w[0]
    out[layout.SLIP_VELOCITY], out[layout.SLIP_VELOCITY + 1] = s1, s2
    out[layout.SLIP_RATE] = math.sqrt(s1 * s1 + s2 * s2)
