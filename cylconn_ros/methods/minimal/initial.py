"""Initial state: joint coordinates from a sample, with the constraint errors projected out."""

from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function
from cylconn_ros.core.joint_limits import is_motion_imposed
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.fixed_shaft import prepare
from cylconn_ros.methods.minimal.impacts import impose_rates

DEFAULT_TOLERANCE: Final = 1e-12
"""Relative tolerance of an integration step; a tenth of it is the absolute one, in SI units."""


@allocating_function
def tolerance_of(par: Array) -> float:
    """Relative tolerance of a step: the one that follows from the scene's, else the default."""
    return par[model.TOLERANCE] if par[model.TOLERANCE] > 0.0 else DEFAULT_TOLERANCE


@allocating_function
def mode_of(par: Array) -> int:
    """The prescribed body: A_PRESCRIBED, B_PRESCRIBED or BOTH_FREE."""
    if par[model.BODY_A] == 0.0:
        return coordinates.A_PRESCRIBED
    if par[model.BODY_B] == 0.0:
        return coordinates.B_PRESCRIBED
    return coordinates.BOTH_FREE


@allocating_function
def apply_imposed_motion(par: Array, joint: Array, y: Array) -> None:
    """Apply imposed motions to the coordinates: positions directly, rates by an impulse."""
    sides = (2 if is_motion_imposed(par, 0) else 0, 2 if is_motion_imposed(par, 1) else 0)
    if sides == (0, 0):
        return
    for k in range(2):
        at_k = model.COMMAND + 3 * k
        y[coordinates.LENGTH + k] = model.value_or(par[at_k], y[coordinates.LENGTH + k])
    rates = (
        model.value_or(par[model.COMMAND + 1], 0.0),
        model.value_or(par[model.COMMAND + 4], 0.0),
    )
    n = 17 if joint[coordinates.MODE] == coordinates.BOTH_FREE else 4
    impose_rates(par, joint, 0.0, y, n, sides, rates)


@allocating_function
def turn_imposed_motion(par: Array, joint: Array, t: float, y: Array, locked: bool) -> None:
    """Give imposed motions their rates after a kink over time, by an impulse."""
    held = int(par[model.LOCK]) if locked else 0
    sides = (
        2 if is_motion_imposed(par, 0) and held != 1 else 0,
        2 if is_motion_imposed(par, 1) and held != 2 else 0,
    )
    if sides == (0, 0):
        return
    rates = (
        model.value_or(par[model.COMMAND + 1], 0.0),
        model.value_or(par[model.COMMAND + 4], 0.0),
    )
    unchanged = True
    for k in range(2):
        unchanged = unchanged and (sides[k] == 0 or y[coordinates.SLIDE + k] == rates[k])
    if not unchanged:
        n = 17 if joint[coordinates.MODE] == coordinates.BOTH_FREE else 4
        impose_rates(par, joint, t, y, n, sides, rates)


@allocating_function
def _write_motion(a: Array, first: int, m: Motion) -> None:
    model.write_vector(a, first, m.com)
    for k in range(4):
        a[first + 3 + k] = m.orientation[k]
    model.write_vector(a, first + 7, m.velocity)
    model.write_vector(a, first + 10, m.spin)


@allocating_function
def initial_state(
    par: Array, mem: Array, sample: Array, o: RelativeState, joint: Array, y: Array
) -> None:
    """Fill ``joint`` (NJOINT,) and the coordinates of ``y``; constraint errors are left out."""
    mode = mode_of(par)
    joint[coordinates.MODE] = mode
    _write_motion(joint, coordinates.PRESCRIBED, o.b if mode == coordinates.B_PRESCRIBED else o.a)
    joint[coordinates.OFFSETS], joint[coordinates.OFFSETS + 1] = (
        mem[model.TARGET],
        mem[model.TARGET + 1],
    )
    for k in range(4):
        joint[coordinates.SWING + k] = mem[model.SWING + k]
        joint[coordinates.AXES_B + k] = mem[model.AXES_B + k]
    for k in range(12):
        joint[coordinates.LOADS + k] = sample[layout.A_LOAD + k]
    ref = model.REFERENCE
    joint[coordinates.SPRING_REFERENCE] = model.value_or(par[ref + 2], mem[model.LENGTH0])
    joint[coordinates.SPRING_REFERENCE + 1] = model.value_or(par[ref + 3], mem[model.ANGLE0])

    joint[coordinates.START] = mem[model.LENGTH0]

    y[coordinates.LENGTH], y[coordinates.ANGLE] = o.length, o.angle
    y[coordinates.SLIDE], y[coordinates.SPIN] = o.twist.v[0], o.twist.w[0]
    if mode == coordinates.BOTH_FREE:
        _write_motion(y, coordinates.A_COM, o.a)
    prepare(par, joint, y)
