"""From a sample to the scene's own coordinates."""

from typing import Final

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.joint_limits import imposed
from cylconn_ros.core.relative_state import Observed
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.core.vectors import cross, matrix, out_of, sub
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.fixed_shaft import prepare
from cylconn_ros.methods.minimal.impacts import bring_to

LIVE: Final = 1e-9
OFFLINE: Final = 1e-12


@device_function
def tolerance_of(par: Array, otherwise: float) -> float:
    """The tolerance of a step: what the scene's leads to, or ``otherwise`` if it states none.

    LIVE, the error is far below what a held wrench leaves; OFFLINE, the solution is a reference.
    """
    return par[model.TOLERANCE] if par[model.TOLERANCE] > 0.0 else otherwise


@device_function
def mode_of(par: Array) -> int:
    """Which body moves by itself, if any."""
    if par[model.BODY_A] == 0.0:
        return at.A_MOVES
    if par[model.BODY_B] == 0.0:
        return at.B_MOVES
    return at.BOTH_FREE


@device_function
def begin_imposed(par: Array, joint: Array, y: Array) -> None:
    """Put imposed motions into the coordinates: their position, and by an impulse their rate."""
    sides = (2 if imposed(par, 0) else 0, 2 if imposed(par, 1) else 0)
    if sides == (0, 0):
        return
    for k in range(2):
        at_k = model.COMMAND + 3 * k
        y[at.LENGTH + k] = model.given(par[at_k], y[at.LENGTH + k])
    rates = (model.given(par[model.COMMAND + 1], 0.0), model.given(par[model.COMMAND + 4], 0.0))
    n = 17 if joint[at.MODE] == at.BOTH_FREE else 4
    bring_to(par, joint, 0.0, y, n, sides, rates)


@device_function
def _put_motion(a: Array, first: int, m: Motion) -> None:
    model.put(a, first, m.com)
    for k in range(4):
        a[first + 3 + k] = m.orientation[k]
    model.put(a, first + 7, m.velocity)
    model.put(a, first + 10, m.spin)


@device_function
def start(
    par: Array, mem: Array, sample: Array, o: Observed, hold_torque: bool, joint: Array, y: Array
) -> None:
    """Fill ``joint`` (NJOINT,) and the coordinates of ``y``, without what violates the constraint.

    ``hold_torque``: the loads' torques about the mass centres stay as they are in this sample (a
    held wrench), instead of turning with the body.
    """
    mode = mode_of(par)
    joint[at.MODE] = mode
    _put_motion(joint, at.PRESCRIBED, o.b if mode == at.B_MOVES else o.a)
    joint[at.OFFSETS], joint[at.OFFSETS + 1] = mem[model.TARGET], mem[model.TARGET + 1]
    for k in range(4):
        joint[at.SWING + k] = mem[model.SWING + k]
        joint[at.AXES_B + k] = mem[model.AXES_B + k]
    for k in range(12):
        joint[at.LOADS + k] = sample[out_at.A_LOAD + k]
    joint[at.HELD_TORQUE] = 0.0
    if hold_torque:
        joint[at.HELD_TORQUE] = 1.0
        for k in range(2):
            body = model.body(par, model.BODY_A if k == 0 else model.BODY_B)
            m = o.a if k == 0 else o.b
            load = at.LOADS + 6 * k
            arm = cross(out_of(matrix(m.orientation), body.com), model.vector(joint, load))
            model.put(joint, load + 3, sub(model.vector(joint, load + 3), arm))
    ref = model.REFERENCE
    joint[at.CONSTITUTIVE] = model.given(par[ref + 2], mem[model.LENGTH0])
    joint[at.CONSTITUTIVE + 1] = model.given(par[ref + 3], mem[model.ANGLE0])

    y[at.LENGTH], y[at.ANGLE] = o.length, o.angle
    y[at.SLIDE], y[at.SPIN] = o.twist.v[0], o.twist.w[0]
    if mode == at.BOTH_FREE:
        _put_motion(y, at.A_COM, o.a)
    prepare(par, joint, y)
