"""Law N, "never gains": a wrench is checked on its predicted motion before it is sent.

A held wrench turns against the arms on which it acts, by |w| h times arm over radius of gyration.
Above SMALL_TURN it is held over its period on the predicted motion, with the integrator of the
plant as declared (core/held_step.py). Its work W on both bodies, the spring energy V and the work D
of the drives on slide and spin give the energy that the step puts into the bodies,

    gain = W + V+ - V - D         beyond TOLERANCE (|W_A| + |W_B| + |V+ - V| + |D|)

A step of second order gains and loses a share of (|w| h)^2 of the energy in turns. What counts is
the sum, from its least value on:

    rise <- max(rise + gain, 0) <= ALLOWED_RISE T + max(1/2 u G_cc^-1 u - T, 0)

with T the kinetic energy of the bodies' relative motion and the energy of pull-in at the rate
u = -e/h, at most the pull-in speed, which bodies that move faster have already. A scaled wrench
takes less energy than a spring stores meanwhile: that counts as gain, and a later step returns less
of it. Without a wrench the bodies then gain what the spring stores, and no factor need do
better. Requiring gain <= 0 of each step would give the constraint up where it is kept well: offsets
of 0.2 mm became 0.4 m.

Where the bound would be exceeded, the wrenches on both bodies are scaled by one factor, like those
of output limits: the greatest factor found that keeps to it. No wrench, factor 0, gains nothing but
what springs store. The flag GAINS_LOWERED reports it.
"""

from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delassus import DelassusOperator
from cylconn_ros.core.friction import Array
from cylconn_ros.core.held_step import (
    HeldStep,
    Load,
    held_step,
    rotational_energy,
    semi_implicit_step,
)
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import Frame, frame
from cylconn_ros.core.output_wrenches import ComWrenches
from cylconn_ros.core.relative_state import RelativeState, spring_energy_of
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.small_matrices import factor, solve
from cylconn_ros.core.vectors import Quaternion, Vector, dot, into, matrix, norm, out_of, scale, sub

TOLERANCE = 1e-6  # of the energy exchanged in the step: not counted as gain
ALLOWED_RISE = 5e-3  # of the kinetic energy
SMALL_TURN = 0.05  # rad: greatest turn times arm over radius of gyration that is not checked
RESOLUTION = 0.02  # of the factor
LEAST_SHARE = 1e-3  # smaller factors send no wrench


class Halves(NamedTuple):
    """Orientations of the bodies in which a wrench held in body axes has its mean."""

    a: Quaternion
    b: Quaternion


@inline_function
def _turning(body: Body, arm: Vector, torque: Vector, h: float) -> tuple[float, float]:
    """1 + (arm / radius of gyration)^2 and the change of spin by a torque in h/2, from above."""
    if not body.free:
        return 0.0, 0.0
    j = body.inverse_inertia
    trace = j[0] + j[3] + j[5]
    return 1.0 + dot(arm, arm) * body.mass * trace, 0.5 * h * trace * norm(torque)


@inline_function
def turns_far(o: RelativeState, f: Frame, w: ComWrenches, h: float) -> bool:
    """Whether a wrench held over h turns far against the arms on which it acts."""
    ratio_a, faster_a = _turning(o.body_a, f.arm_a, w.torque_a, h)
    ratio_b, faster_b = _turning(o.body_b, f.arm_b, w.torque_b, h)
    turn = h * max(norm(o.a.spin) + faster_a, norm(o.b.spin) + faster_b)
    return turn * turn * max(ratio_a, ratio_b) > SMALL_TURN * SMALL_TURN


@inline_function
def _load(par: Array, body: Body, sample: Array, at: int) -> Load:
    weight = scale(body.mass if body.free else 0.0, model.vector(par, model.GRAVITY))
    return Load(model.vector(sample, at), model.vector(sample, at + 3), weight)


@inline_function
def _at_start(m: Motion, half: Quaternion, v: Vector, in_body: bool) -> Vector:
    """A vector of the wrench at the start of its step."""
    return out_of(matrix(m.orientation), into(matrix(half), v)) if in_body else v


@device_function
def _moved(
    par: Array, body: Body, m: Motion, half: Quaternion, force: Vector, torque: Vector, load: Load,
    h: float,
) -> HeldStep:  # fmt: skip
    """The step of one body under a wrench about its mass centre."""
    out = model.output(par)
    force = _at_start(m, half, force, out.held_in_body)
    torque = _at_start(m, half, torque, out.held_in_body)
    if out.semi_implicit:
        return semi_implicit_step(body, m, force, torque, load, h)
    return held_step(body, m, force, torque, load, h, out.held_in_body)


@device_function
def energy_gain(
    par: Array, mem: Array, sample: Array, o: RelativeState, halves: Halves, w: ComWrenches,
    limited: float, share: float, h: float,
) -> float:  # fmt: skip
    """Energy that wrenches scaled by ``share`` put into the bodies in the step, J.

    limited: the factor of the output limits, which ``w`` already contains.
    """
    la = _load(par, o.body_a, sample, layout.A_LOAD)
    lb = _load(par, o.body_b, sample, layout.B_LOAD)
    push, turn_a, turn_b = scale(share, w.force), scale(share, w.torque_a), scale(share, w.torque_b)
    a = _moved(par, o.body_a, o.a, halves.a, scale(-1.0, push), turn_a, la, h)
    b = _moved(par, o.body_b, o.b, halves.b, push, turn_b, lb, h)
    gain, exchanged = a.work + b.work, abs(a.work) + abs(b.work)
    elastic = par[model.ELASTICITY] != 0.0 or par[model.ELASTICITY + 1] != 0.0
    elastic = elastic or par[model.ELEMENTS] != 0.0 or par[model.ELEMENTS + 1] != 0.0
    driven = mem[model.LAST_ACTUATION] != 0.0 or mem[model.LAST_ACTUATION + 1] != 0.0
    if elastic or driven:
        f = frame(o.nodes, a.end, b.end)
        slid = dot(f.axes[0], f.d) - o.length
        spun = 0.5 * h * (o.twist.w[0] + dot(f.axes[0], sub(b.end.spin, a.end.spin)))
        stored = spring_energy_of(par, mem, o.length + slid, o.angle + spun)
        stored -= spring_energy_of(par, mem, o.length, o.angle)
        work = mem[model.LAST_ACTUATION] * slid + mem[model.LAST_ACTUATION + 1] * spun
        # a scaled wrench takes or returns less than the spring stores or gives: the rest counts
        gain += stored - share * limited * work
        exchanged += abs(stored) + abs(work)
    return gain - TOLERANCE * exchanged if gain > 0.0 else gain


@inline_function
def _relative_energy(o: RelativeState) -> float:
    """Kinetic energy of the motion of the bodies relative to each other, J."""
    a, b = o.body_a, o.body_b
    total = a.inverse_mass + b.inverse_mass
    apart = sub(o.b.velocity, o.a.velocity)
    energy = 0.5 * dot(apart, apart) / total if total > 0.0 else 0.0
    if a.free:
        energy += rotational_energy(a, o.a.orientation, o.a.spin)
    if b.free:
        energy += rotational_energy(b, o.b.orientation, o.b.spin)
    return energy


@device_function
def pull_in_energy(par: Array, o: RelativeState, g: DelassusOperator, h: float) -> float:
    """Kinetic energy of the constrained components at the rate of pull-in, J."""
    e = o.error
    far = (e[0] * e[0] + e[1] * e[1]) ** 0.5
    askew = (e[2] * e[2] + e[3] * e[3]) ** 0.5
    u = min(1.0 / h, par[model.PULL_IN] / far) if far > 0.0 else 0.0
    v = min(1.0 / h, par[model.PULL_IN + 1] / askew) if askew > 0.0 else 0.0
    ff, fm, mm = g.ff, g.fm, g.mm
    lower = factor(ff[3], ff[4], ff[5], fm[1][1], fm[2][1], mm[3], fm[1][2], fm[2][2], mm[4], mm[5])
    y, z, p, q = u * e[0], u * e[1], v * e[2], v * e[3]
    x = solve(lower, y, z, p, q)
    return 0.5 * (x[0] * y + x[1] * z + x[2] * p + x[3] * q)


@device_function
def kept_share(
    par: Array, mem: Array, sample: Array, o: RelativeState, g: DelassusOperator, halves: Halves,
    w: ComWrenches, limited: float, h: float,
) -> float:  # fmt: skip
    """The factor on the wrenches with which the bodies gain no energy; the rise is stored."""
    moving = _relative_energy(o)
    bound = ALLOWED_RISE * moving + max(pull_in_energy(par, o, g, h) - moving, 0.0)
    room = bound - mem[model.ENERGY_RISE]
    gain = energy_gain(par, mem, sample, o, halves, w, limited, 1.0, h)
    share = 1.0
    if not gain <= max(room, 0.0):
        share, low, high = 0.0, 0.0, 1.0
        gain = energy_gain(par, mem, sample, o, halves, w, limited, 0.0, h)
        least = max(room, gain)
        while high - low > RESOLUTION * high and high > LEAST_SHARE:
            middle = 0.5 * (low + high)
            found = energy_gain(par, mem, sample, o, halves, w, limited, middle, h)
            if found <= least:
                low, share, gain = middle, middle, found
                least = max(room, gain)  # a spring stores more without its force than with it
            else:
                high = middle
    mem[model.ENERGY_RISE] = max(mem[model.ENERGY_RISE] + gain, 0.0)
    return share
