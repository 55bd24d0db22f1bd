"""Model and data of a connector as flat arrays: PAR, the parameters, and MEM, the memory.

PAR is packed once from a scene (scene/packing.py). MEM holds everything that a connector knows of
earlier samples, so that saving and restoring it restores the connector. The functions below read
sections of PAR as named tuples. Constants are the index of the first number of each section.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import elements
from cylconn_ros.core.friction import SIZE, Array, Law, unpack
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.kinematics import Nodes
from cylconn_ros.core.layout import MAX_LATENCY, SENT_PERIODS
from cylconn_ros.core.rigid_body import Body
from cylconn_ros.core.vectors import Quaternion, Vector

# --- PAR ---
GRAVITY: Final = 0  # 3, m/s^2, world axes
BODY_A: Final = GRAVITY + 3  # free, mass, 1/mass, com 3, inertia 6, inverse inertia 6
BODY_B: Final = BODY_A + 18
NODE_A: Final = BODY_B + 18  # position from the mass centre 3, orientation 4
NODE_B: Final = NODE_A + 7  # position from the mass centre 3, orientation given, orientation 4
REFERENCE: Final = NODE_B + 8  # hold offsets, hold misalignment, l1ref, theta1ref
#                                (NaN: those of the first sample)
PULL_IN: Final = REFERENCE + 4  # greatest speed (m/s) and rate (rad/s) of constraint correction
FRICTION: Final = PULL_IN + 2  # see core/friction.py
ELASTICITY: Final = FRICTION + SIZE  # k1, kr1, c1, cr1
PENALTY: Final = ELASTICITY + 4  # stiffness, rotational stiffness, damping, rotational damping,
#                                  stick stiffness, stick damping
OUTPUT: Final = PENALTY + 6  # world axes, mass centre, held in body axes, semi-implicit plant,
#                              force limit, torque limit
STOPS: Final = OUTPUT + 6  # l_min, l_max, theta_min, theta_max (infinite: none), restitution
LOCK: Final = STOPS + 5  # component (0 none, 1 slide, 2 spin), position, force (NaN: no criterion)
COMMAND: Final = LOCK + 3  # of slide, of spin: position, velocity, force (NaN: not imposed)
AUGMENTED: Final = COMMAND + 6  # multiplier gain (NaN: automatic)
BAUMGARTE: Final = AUGMENTED + 1  # alpha, beta (NaN: from the period), regularisation velocity
LATENCY: Final = BAUMGARTE + 3  # periods from a sample to the action of its wrench, or MEASURED, or
#                                 ADAPTED: unknown inertia, the gains follow from the energy
MEASURED: Final = -1.0
ADAPTED: Final = -2.0
REST_RATE: Final = LATENCY + 1  # method observe: slip rate below which a motion is stick, m/s
TOLERANCE: Final = REST_RATE + 1  # of the steps of method minimal; 0: its default
LATENCY_CHECKED: Final = TOLERANCE + 1  # whether the measured latency may refute a declared one
CONSTRAINT: Final = (
    LATENCY_CHECKED + 1
)  # 0: the connector keeps it; the simulator does: 1 with a declared
#                                    latency, 2 without (core/free_gain.py)
DRIVE: Final = CONSTRAINT + 1  # of slide, of spin: greatest force or moment (infinite: no limit),
#                                speed of approach of an imposed position
OVERLAP: Final = DRIVE + 4  # how the contact changes with the slide: see core/overlap.py
OFFSET: Final = OVERLAP + 6  # of slide, of spin: constant force (N), moment that resists them
ELEMENTS: Final = OFFSET + 2  # tables of springs and dampers, compliant stops: core/elements.py
TABLE: Final = ELEMENTS + elements.SIZE  # of the friction coefficient: rates, forces, values

# --- MEM ---
HAS_REFERENCE: Final = 0  # whether the reference configuration is defined
LENGTH0: Final = 1  # length and angle of the reference configuration
ANGLE0: Final = 2
TARGET: Final = 3  # y0, z0
AXES_B: Final = 7  # orientation of node b in body B, 4
LAST_ANGLE: Final = 11
LAST_SPIN: Final = 12
WAS_STICK: Final = 13
STICK_LENGTH: Final = 14  # the position that stick holds
STICK_ANGLE: Final = 15
STICK_SAMPLES: Final = 16  # number of consecutive samples in stick
ACCUMULATED_SLIP: Final = 17  # m
LAST_PERIOD: Final = 18  # s, between the last two samples; 0: none
LAST_POSITION: Final = 19  # l, y, z
LAST_VELOCITY: Final = 22  # their rates
LAST_A: Final = 25  # force, torque about the mass centre, mass centre, angular velocity: 12
LAST_B: Final = 37
WORK: Final = 49  # sum of signed work, J
WORK_EXCHANGED: Final = 50  # sum of |work|, J
ELASTIC_SLIP: Final = 51  # 2, of the penalty method's stick, m
# 2: impact at the lower (-1) or upper (1) stop that has another step, doubled: none; 0: no impact
PENDING_SIDE: Final = 53
PENDING_RATE: Final = 55  # 2: rate of the gap after the impact
LOCKED: Final = 58  # whether the lock has closed
LOCK_POSITION: Final = 59  # position at which it holds
LAST_LOCK_POSITION: Final = 60  # last position of the component that the lock holds
LAST_FREE_FORCES: Final = 61  # 2: f1, m1 of the last step
IMPOSED_POSITION: Final = 63  # 2: present positions of imposed motions
LAST_ACTUATION: Final = 65  # 2: force and moment of actuation and imposed motion in the last step
ACTUATION_WORK: Final = 67  # work of actuation and imposed motion, J
SPRING0: Final = 68  # spring energy at the reference, J
MULTIPLIER: Final = 69  # 4, of the augmented Lagrangian: f2, f3, m2, m3
INTEGRATION_MISFIT: Final = 73  # 2: of positions to exact, to semi-implicit integration, m^2
LAST_VELOCITIES: Final = 75  # of the mass centres, 2 x 3, world axes
PREDICTED_SAMPLE: Final = 81  # the sample predicted for the time of action (core/latency.py)
LAST_SAMPLE: Final = PREDICTED_SAMPLE + 38
LAST_SAMPLE_END: Final = LAST_SAMPLE + 38
ANGULAR_MOMENTUM: Final = LAST_SAMPLE_END  # 2 x 3, about the mass centres at the last sample
LAST_LOADS: Final = ANGULAR_MOMENTUM + 6  # 2 x 6, loads of the last sample about the origins,
#                                           world axes
SWING: Final = LAST_LOADS + 12  # the held swing S as a quaternion, 4
JUMPED: Final = SWING + 4  # whether a body jumped in the last interval (core/passivity.py)
JUMP_SHIFT: Final = JUMPED + 1  # 2: changes of length and angle by the jump
PERIOD_VARIATION: Final = JUMP_SHIFT + 2  # recent variation of the measured period, 0 to 1
SENT_WRENCHES: Final = PERIOD_VARIATION + 1  # of the last SENT_PERIODS periods, newest first:
#                             forces and torques about the mass centres of A, of B, world axes
DELAYED: Final = SENT_WRENCHES + 12 * SENT_PERIODS  # whether a latency was measured
MEASURED_LATENCY: Final = DELAYED + 1  # periods, with their fraction
LOCK_STEP: Final = MEASURED_LATENCY + 1  # intervals in succession that agree with lock step
LATENCY_FIT: Final = LOCK_STEP + 1  # S0, S1, S2 of every j (core/latency_estimation.py)
FIT_CHANGE: Final = LATENCY_FIT + 3 * (MAX_LATENCY + 1)  # sum of S2 of the intervals in it
INTERVAL_FIT: Final = FIT_CHANGE + 1  # the sums of the last interval
LAST_NEEDED: Final = INTERVAL_FIT + 3 * (MAX_LATENCY + 1)  # 12: wrenches of the last interval
FILTERED_NEEDED: Final = LAST_NEEDED + 12  # 12
FILTERED_SENT: Final = FILTERED_NEEDED + 12  # 12 of every latency
LAST_INTERVAL: Final = FILTERED_SENT + 12 * (MAX_LATENCY + 2)  # periods in it; 0: none
SPREAD_SUMS: Final = LAST_INTERVAL + 1  # 2
LATENCY_SPREAD: Final = SPREAD_SUMS + 2  # periods, standard deviation
FEEDBACK_GAIN: Final = LATENCY_SPREAD + 1  # alpha; 0: not estimated yet
GAIN_REDUCTION: Final = FEEDBACK_GAIN + 1  # by the passivity account, share
LEAST_BALANCE: Final = GAIN_REDUCTION + 1  # J, least passivity balance
RECENT_EXCHANGE: Final = LEAST_BALANCE + 1  # J, energy exchanged over the last samples
SPRING_ENERGY: Final = RECENT_EXCHANGE + 1  # J, in the springs since the reference, last sample
SIMULATED_SAMPLE: Final = SPRING_ENERGY + 1  # 38, the last sample as its motion is simulated again
CONTRADICTED: Final = (
    SIMULATED_SAMPLE + 38
)  # whether the last measured motion contradicts the twists
CONTRADICTION: Final = CONTRADICTED + 1  # 2 x 3: of each body, the squares of its motions by poses
#                             and by twists when these last differed, and their product, m^2
FREE_GAIN: Final = CONTRADICTION + 6  # 24: gain of slide and spin (core/free_gain.py)
STAMP_PERIOD: Final = FREE_GAIN + 24  # s, the interval of CONTRADICTION
ENERGY_RISE: Final = STAMP_PERIOD + 1  # J, put in since the least energy (methods/never_gains.py)
ACCELERATIONS: Final = ENERGY_RISE + 1  # 2 x 6: linear and angular, of the last interval, of driven
#                             bodies A and B; then the ones in use, 2 x 6
HELD_WRENCH: Final = ACCELERATIONS + 24  # 12: the last wrench as at LAST_A, at the start of its
#                             step: turned back if it is held in body axes
PENDING_ACCELERATION: Final = HELD_WRENCH + 12  # 2: of the gap after the impact
PENDING_TIME: Final = PENDING_ACCELERATION + 2  # 2: from the first step's sample to the impact, s
PENDING_RESTITUTION: Final = PENDING_TIME + 2  # 2
PENDING_FRICTION: Final = PENDING_RESTITUTION + 2  # 2 x 7: whether the friction of an impact acts;
#                             rates at the impact, friction before and after it (free_axes/
#                             impact_friction.py), 2 each
DRIVE_POSITION: Final = PENDING_FRICTION + 14  # 2: method penalty, position that a drive holds
STALLED: Final = DRIVE_POSITION + 2  # intervals through which a wrench has been held
STALLED_WRENCH: Final = STALLED + 1  # 12: that wrench, as at SENT_WRENCHES
AGREED: Final = STALLED_WRENCH + 12  # intervals that confirmed the latency
UNKNOWN_LOAD: Final = AGREED + 1  # 12: mean of what was needed beside the sent wrenches
USUAL_LATENCY: Final = UNKNOWN_LOAD + 12  # periods, mean over the last intervals
LATENCIES: Final = USUAL_LATENCY + 1  # intervals in it
REFUTED: Final = LATENCIES + 1  # whether the measured latency replaces the declared one
CONTRARY: Final = REFUTED + 1  # intervals in succession that speak against REFUTED
PASSIVITY_CONTROLLER: Final = CONTRARY + 1  # 8 x 20: of offsets, swings, slide, spin;
#                             oscillations of both offsets, swings (methods/passivity_controller.py)
END_RATES: Final = PASSIVITY_CONTROLLER + 160  # 2: rates at the end of the step about which tables
#                             and compliant stops are linearised (free_axes/elements.py)
PERIOD_IN_USE: Final = END_RATES + 2  # 5: the period that replaces the declared one, and what is
#                             known of it (core/sample_period.py)
SAMPLE_BEFORE: Final = PERIOD_IN_USE + 5  # 26: motion of the last sample, to be compared with it
NMEM: Final = SAMPLE_BEFORE + 26


class Output(NamedTuple):
    """Form of the published wrenches, their limits (N, N.m), and the integration of the plant."""

    world_axes: bool
    at_com: bool
    held_in_body: bool
    semi_implicit: bool
    force_limit: float
    torque_limit: float


@inline_function
def vector(a: Array, at: int) -> Vector:
    """Three numbers of ``a`` from index ``at``."""
    return (a[at], a[at + 1], a[at + 2])


@inline_function
def quaternion(a: Array, at: int) -> Quaternion:
    """Four numbers of ``a`` from index ``at``."""
    return (a[at], a[at + 1], a[at + 2], a[at + 3])


@inline_function
def write_vector(a: Array, at: int, v: Vector) -> None:
    """Write three numbers to ``a`` from index ``at``."""
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
    """Positions and orientations of the nodes, and the held swing."""
    return Nodes(vector(par, NODE_A), quaternion(par, NODE_A + 3), vector(par, NODE_B), swing)


@inline_function
def law(par: Array) -> Law:
    """The friction law."""
    return unpack(par, FRICTION, TABLE)


@inline_function
def output(par: Array) -> Output:
    """The output settings."""
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
def value_or(x: float, otherwise: float) -> float:
    """x, or ``otherwise`` if x is not given (NaN)."""
    return otherwise if math.isnan(x) else x
