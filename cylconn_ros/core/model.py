"""The flat arrays private to the methods: PAR, the scene in numbers, and MEM, what is remembered.

PAR is packed once from a scene; MEM is all that a connector knows of earlier samples, so that
saving and restoring it restores the connector. Readers turn stretches of PAR into the named tuples
of the physics.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core.friction import Array, Law
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.kinematics import Nodes
from cylconn_ros.core.rigid_body import Body
from cylconn_ros.core.vectors import Quaternion, Vector

# --- PAR ---
GRAVITY: Final = 0  # 3, world axes
BODY_A: Final = 3  # free, mass, 1/mass, com 3, inertia 6, inverse inertia 6
BODY_B: Final = 21
NODE_A: Final = 39  # position from the mass centre 3, orientation 4
NODE_B: Final = 46  # position from the mass centre 3, orientation given, orientation 4
REFERENCE: Final = 54  # hold offsets, hold misalignment, l1ref, theta1ref (NaN: first sample's)
PULL_IN: Final = 58  # greatest speed (m/s) and rate (rad/s) at which a violation is removed
FRICTION: Final = 60  # see `law`
ELASTICITY: Final = 72  # k1, kr1, c1, cr1
PENALTY: Final = 76  # stiffness, rotational stiffness, damping, rotational damping,
#                      stick stiffness, stick damping
OUTPUT: Final = (
    82  # world axes, mass centre, held in body axes, semi-implicit plant, force limit, torque limit
)
STOPS: Final = 88  # l_min, l_max, theta_min, theta_max (infinite: none), restitution
LOCK: Final = 93  # component (0 none, 1 slide, 2 spin), position, force (NaN: no criterion)
COMMAND: Final = 96  # of slide, of spin: position, velocity, force (NaN: not imposed)
AUGMENTED: Final = 102  # share of the spring's force that the multiplier takes over (NaN: chosen)
BAUMGARTE: Final = 103  # alpha, beta (NaN: from the period), regularisation velocity
LATENCY: Final = 106  # periods from a sample to the action of its wrench; -1: measured
REST_RATE: Final = 107  # slip rate below which a motion seen counts as rest, m/s
TOLERANCE: Final = 108  # of the steps of minimal; 0: as it is used to
TABLE: Final = 109  # rates, forces, values

# --- MEM ---
STARTED: Final = 0  # whether there is a reference configuration
LENGTH0: Final = 1
ANGLE0: Final = 2
TARGET: Final = 3  # y0, z0
AXES_B: Final = 7  # node b's orientation in body B, 4
LAST_ANGLE: Final = 11
LAST_SPIN: Final = 12
WAS_STICK: Final = 13
HELD_LENGTH: Final = 14  # where stick holds
HELD_ANGLE: Final = 15
STUCK: Final = 16  # samples in a row
SLIPPED: Final = 17  # accumulated slip, m
LAST_PERIOD: Final = 18  # s, of the last answer; 0: none
LAST_POSITION: Final = 19  # l, y, z
LAST_VELOCITY: Final = 22  # their rates
LAST_A: Final = 25  # force, torque about the mass centre, mass centre, angular velocity: 12
LAST_B: Final = 37
WORK: Final = 49  # sum of work with its sign, J
EXCHANGED: Final = 50  # sum of |work|, J
ELASTIC_SLIP: Final = 51  # 2, of the penalty method's stick, m
PENDING_SIDE: Final = 53  # 2: an impact's second half: -1 at the lower stop, 1 at the upper, 0
PENDING_RATE: Final = 55  # 2: the rate it leaves with
PENDING_RESTITUTION: Final = 57
LOCKED: Final = 58  # whether the lock has closed
LOCKED_AT: Final = 59  # and where
LOCK_LAST: Final = 60  # the locking component's last position
LAST_TOTAL: Final = 61  # 2: f1, m1 of the last answer
IMPOSED_AT: Final = 63  # 2: where imposed motion has got to
LAST_ACTUATION: Final = 65  # 2: force and moment of actuation and imposed motion in the last answer
ACTUATED: Final = 67  # work of those, J
SPRING0: Final = 68  # spring energy at the reference, J
MULTIPLIER: Final = 69  # 4, of the augmented Lagrangian: f2, f3, m2, m3
GUARD: Final = 73  # 2 x 18, of its gains on offsets and swings: methods/passivity_controller.py
INTEGRATED: Final = 109  # 2: misfit of positions to exact and to semi-implicit integration, m^2
LAST_VELOCITIES: Final = 111  # of the mass centres, 2 x 3, world axes
SENT: Final = 117  # the wrenches of the last MOST_LATE + 1 periods, newest first: forces and
#                    torques about the mass centres of A, of B, world axes
AHEAD: Final = 225  # the sample when its wrench acts (core/latency.py)
MISFIT: Final = 263  # of every latency, N^2
LATE: Final = 272  # the latency measured, periods
SEEN: Final = 273  # 26, poses and twists of the last sample
AFTER_SEEN: Final = 299
MOMENTUM: Final = 299  # 2 x 3, angular momenta about the mass centres at the last sample
HELD_LOADS: Final = 305  # 2 x 6, the last sample's loads about the mass centres, world axes
SWING: Final = 317  # the held swing S as a quaternion, 4
JUMPED: Final = 321  # whether a body is where its last motion does not lead
SHIFT: Final = 322  # 2: length and angle by which, in the sample where it is
UNEVEN: Final = 324  # how uneven samples have come of late, 0 to 1
NMEM: Final = 325


class Output(NamedTuple):
    """How wrenches leave the connector and how the plant takes them."""

    world_axes: bool
    at_com: bool
    held_in_body: bool
    semi_implicit: bool
    force_limit: float
    torque_limit: float


@inline_function
def vector(a: Array, at: int) -> Vector:
    """Three numbers of ``a``."""
    return (a[at], a[at + 1], a[at + 2])


@inline_function
def quaternion(a: Array, at: int) -> Quaternion:
    """Four numbers of ``a``."""
    return (a[at], a[at + 1], a[at + 2], a[at + 3])


@inline_function
def put(a: Array, at: int, v: Vector) -> None:
    """Write three numbers."""
    a[at], a[at + 1], a[at + 2] = v


@inline_function
def body(par: Array, at: int) -> Body:
    """The body at BODY_A or BODY_B."""
    return Body(
        par[at] != 0.0,
        par[at + 1],
        par[at + 2],
        vector(par, at + 3),
        (par[at + 6], par[at + 7], par[at + 8], par[at + 9], par[at + 10], par[at + 11]),
        (par[at + 12], par[at + 13], par[at + 14], par[at + 15], par[at + 16], par[at + 17]),
    )


@inline_function
def nodes(par: Array, swing: Quaternion) -> Nodes:
    """Where the end points are, and the swing that is held."""
    return Nodes(vector(par, NODE_A), quaternion(par, NODE_A + 3), vector(par, NODE_B), swing)


@inline_function
def law(par: Array) -> Law:
    """The law of friction."""
    at = FRICTION
    return Law(
        par[at] != 0.0,
        par[at + 1],
        par[at + 2],
        par[at + 3],
        par[at + 4],
        par[at + 5],
        par[at + 6],
        par[at + 7],
        par[at + 8],
        par[at + 9],
        int(par[at + 10]),
        int(par[at + 11]),
        TABLE,
    )


@inline_function
def output(par: Array) -> Output:
    """How wrenches leave the connector."""
    at = OUTPUT
    return Output(
        par[at] != 0.0,
        par[at + 1] != 0.0,
        par[at + 2] != 0.0,
        par[at + 3] != 0.0,
        par[at + 4],
        par[at + 5],
    )


@inline_function
def given(x: float, otherwise: float) -> float:
    """x, or what stands in for it where it is not set (NaN)."""
    return otherwise if math.isnan(x) else x
