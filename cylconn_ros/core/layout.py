"""Indices of the flat float64 arrays at the interface of the compiled step: SAMPLE and OUT.

``SAMPLE`` (NSAMPLE,) holds the measurement, ``OUT`` (NOUT,) the outputs of the step. The memory
``MEM`` is private to the methods (core/model.py). Flat arrays have the lowest call overhead, and
the ``STATE`` block of ``OUT`` has the field order of ``msg/ConnectorState.msg``, so that a message
is filled with one copy.
"""

from typing import Final

# --- SAMPLE: poses (position m, quaternion x y z w), twists and loads in world axes ---
A_POSE: Final = 0  # x y z qx qy qz qw of body A's frame in the world
A_TWIST: Final = 7  # velocity of its origin (m/s), angular velocity (rad/s), world axes
B_POSE: Final = 13
B_TWIST: Final = 20
A_LOAD: Final = 26  # force (N), torque about the origin (N.m), world axes, besides gravity
B_LOAD: Final = 32
NSAMPLE: Final = 38
MAX_LATENCY: Final = 20  # periods between a sample and the action of its wrench
MOST_POINTS: Final = 16  # of a table of a spring or a damper
SENT_PERIODS: Final = MAX_LATENCY + 12  # periods of which the sent wrenches are kept
MOTION: Final = slice(0, 26)  # the part of a sample that is the plant's state
LOADS: Final = slice(26, 38)

# --- OUT: the two wrenches as published, the state block, enums and flags ---
FORCE_A: Final = 0
TORQUE_A: Final = 3
FORCE_B: Final = 6
TORQUE_B: Final = 9

STATE_FIELDS: Final[tuple[tuple[str, int], ...]] = (
    ("length", 1),
    ("angle", 1),
    ("displacement", 1),
    ("rotation", 1),
    ("material_displacement", 1),
    ("material_rotation", 1),
    ("offset", 2),
    ("misalignment", 2),
    ("velocity", 3),
    ("angular_velocity", 3),
    ("force", 3),
    ("moment", 3),
    ("force_elastic", 1),
    ("force_viscous", 1),
    ("force_friction", 1),
    ("force_actuation", 1),
    ("force_reaction", 1),
    ("moment_elastic", 1),
    ("moment_viscous", 1),
    ("moment_friction", 1),
    ("moment_actuation", 1),
    ("moment_reaction", 1),
    ("overlap", 1),
    ("contact_centre", 1),
    ("radial_force", 1),
    ("bending_moment", 1),
    ("bending_force", 1),
    ("normal_force", 1),
    ("friction_coefficient", 1),
    ("friction_limit", 1),
    ("traction", 1),
    ("slip_velocity", 2),
    ("slip_rate", 1),
    ("accumulated_slip", 1),
    ("stop_time", 1),
    ("offset_violation", 1),
    ("angular_violation", 1),
    ("velocity_violation", 1),
    ("spin_violation", 1),
    ("residual", 1),
    ("restitution", 1),
    ("energy_exchanged", 1),
    ("passivity_balance", 1),
    ("computing_time", 1),
)
"""Name and width of every float64 field of ConnectorState, in message order."""

STATE0: Final = 12
NSTATE: Final = sum(width for _, width in STATE_FIELDS)
STATE: Final = slice(STATE0, STATE0 + NSTATE)


def _offsets() -> dict[str, int]:
    at, offsets = STATE0, {}
    for name, width in STATE_FIELDS:
        offsets[name] = at
        at += width
    return offsets


STATE_INDEX: Final[dict[str, int]] = _offsets()
"""Index in ``OUT`` of the first number of each state field."""

# One constant per field, because kernels read module globals, not dictionaries.
LENGTH: Final = STATE_INDEX["length"]
ANGLE: Final = STATE_INDEX["angle"]
DISPLACEMENT: Final = STATE_INDEX["displacement"]
ROTATION: Final = STATE_INDEX["rotation"]
MATERIAL_DISPLACEMENT: Final = STATE_INDEX["material_displacement"]
MATERIAL_ROTATION: Final = STATE_INDEX["material_rotation"]
OFFSET: Final = STATE_INDEX["offset"]
MISALIGNMENT: Final = STATE_INDEX["misalignment"]
VELOCITY: Final = STATE_INDEX["velocity"]
ANGULAR_VELOCITY: Final = STATE_INDEX["angular_velocity"]
FORCE: Final = STATE_INDEX["force"]
MOMENT: Final = STATE_INDEX["moment"]
FORCE_ELASTIC: Final = STATE_INDEX["force_elastic"]
FORCE_VISCOUS: Final = STATE_INDEX["force_viscous"]
FORCE_FRICTION: Final = STATE_INDEX["force_friction"]
FORCE_ACTUATION: Final = STATE_INDEX["force_actuation"]
FORCE_REACTION: Final = STATE_INDEX["force_reaction"]
MOMENT_ELASTIC: Final = STATE_INDEX["moment_elastic"]
MOMENT_VISCOUS: Final = STATE_INDEX["moment_viscous"]
MOMENT_FRICTION: Final = STATE_INDEX["moment_friction"]
MOMENT_ACTUATION: Final = STATE_INDEX["moment_actuation"]
MOMENT_REACTION: Final = STATE_INDEX["moment_reaction"]
OVERLAP: Final = STATE_INDEX["overlap"]
CONTACT_CENTRE: Final = STATE_INDEX["contact_centre"]
RADIAL_FORCE: Final = STATE_INDEX["radial_force"]
BENDING_MOMENT: Final = STATE_INDEX["bending_moment"]
BENDING_FORCE: Final = STATE_INDEX["bending_force"]
NORMAL_FORCE: Final = STATE_INDEX["normal_force"]
FRICTION_COEFFICIENT: Final = STATE_INDEX["friction_coefficient"]
FRICTION_LIMIT: Final = STATE_INDEX["friction_limit"]
TRACTION: Final = STATE_INDEX["traction"]
SLIP_VELOCITY: Final = STATE_INDEX["slip_velocity"]
SLIP_RATE: Final = STATE_INDEX["slip_rate"]
ACCUMULATED_SLIP: Final = STATE_INDEX["accumulated_slip"]
STOP_TIME: Final = STATE_INDEX["stop_time"]
OFFSET_VIOLATION: Final = STATE_INDEX["offset_violation"]
ANGULAR_VIOLATION: Final = STATE_INDEX["angular_violation"]
VELOCITY_VIOLATION: Final = STATE_INDEX["velocity_violation"]
SPIN_VIOLATION: Final = STATE_INDEX["spin_violation"]
RESIDUAL: Final = STATE_INDEX["residual"]
RESTITUTION: Final = STATE_INDEX["restitution"]
ENERGY_EXCHANGED: Final = STATE_INDEX["energy_exchanged"]
PASSIVITY_BALANCE: Final = STATE_INDEX["passivity_balance"]
COMPUTING_TIME: Final = STATE_INDEX["computing_time"]

REGIME: Final = STATE0 + NSTATE
STOP: Final = REGIME + 1
LOCK: Final = REGIME + 2
STATUS: Final = REGIME + 3
FLAGS: Final = REGIME + 4
NOUT: Final = REGIME + 5

# --- enums and flags, as in ConnectorState.msg ---
FRICTIONLESS: Final = 0
STICK: Final = 1
SLIP: Final = 2

OK: Final = 0
NOT_FINITE: Final = 1
BAD_QUATERNION: Final = 2
NO_PERIOD: Final = 3

UNDERSAMPLED: Final = 1
TURN_AMBIGUOUS: Final = 2
TWIST_CONTRADICTS: Final = 4
HALF_TURN: Final = 8
LIMITED: Final = 16
SEVERAL_ROOTS: Final = 32
JAMMED: Final = 64
STOPPED: Final = 128
STOPPED_SAMPLES: Final = 3  # samples in stick that set STOPPED; one occurs at reversals of slip
MISALIGNED: Final = 256
GAINS_LOWERED: Final = 512
INTEGRATION: Final = 1024
NOT_CONVERGED: Final = 2048
CONTRADICTORY: Final = 4096
DRIVE_BLOCKED: Final = 8192
DISENGAGED: Final = 16384
