"""Stops of connectors that share bodies: which contacts begin, with the forces of the others known.

A step of the group is solved without its stops first. The contacts of each connector are then those
of its own step, in which the forces of the others are those of that solution and its friction limit
is fixed; their bounds enter the problem of all. What is kept of the contacts of slide and spin is
written in NLIMITS numbers for each.
"""

import math
from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.free_gain import update_gain
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import Bounds, Two, drive_limit, has_stops
from cylconn_ros.core.relative_state import RelativeState, measure
from cylconn_ros.core.vectors import norm
from cylconn_ros.methods.dispatch import begin
from cylconn_ros.methods.drives.bounds import clipped, differs, drive_share, is_driven
from cylconn_ros.methods.free_axes.complementarity import (
    BY_RULE,
    FreeAxesSolution,
    ReducedStep,
    solve_case,
    solve_with_limits,
)
from cylconn_ros.methods.free_axes.contacts import LimitedSolution, with_stops
from cylconn_ros.methods.free_axes.elements import linearise_about
from cylconn_ros.methods.free_axes.impact_friction import NO_IMPACT
from cylconn_ros.methods.free_axes.step import PosedFreeAxes, pose_free_axes
from cylconn_ros.methods.free_axes.two_impacts import StopBounds

LOW: Final = 0  # bounds of w+
HIGH: Final = 1
REST: Final = 2
IMPACT: Final = 3
RESTITUTION: Final = 4
REBOUND: Final = 5
ACCELERATION: Final = 6
TIME: Final = 7
CONTINUES: Final = 8
CONTACT: Final = 9  # the stop that holds an imposed motion back
BELOW: Final = 10  # greatest force towards smaller, and towards greater positions
ABOVE: Final = 11
NLIMITS: Final = 12

# --- solution of the group for one connector ---
END: Final = 0  # w+, 2
FRICTION: Final = 2  # 2
REACTION: Final = 4  # 2
REGIME: Final = 6
NSOLUTION: Final = 7

AGREES: Final = 1e-6  # relative difference of a step from the group's solution that is rounding
SHARED: Final = 1e-6  # relative difference from a target that another stop with the same one leaves
ROUNDING: Final = 5e-15  # relative, of measured positions


@inline_function
def rounding(o: RelativeState, k: int) -> float:
    """Rounding of a measured slide (k = 0, m) or spin (k = 1, rad).

    Positions that several connectors hold differ by no less, and would set them against each other.
    """
    if k == 1:
        return ROUNDING * (1.0 + abs(o.angle))
    arms = norm(o.frame.arm_a) + norm(o.frame.arm_b)
    return ROUNDING * (abs(o.length) + norm(o.a.com) + norm(o.b.com) + arms)


@inline_function
def write_limits(
    par: Array, limits: Array, o: RelativeState, h: float, closed: tuple[bool, bool],
    slide: StopBounds, contact1: int, spin: StopBounds, contact2: int,
) -> None:  # fmt: skip
    """Write ``limits`` (2 NLIMITS,); ``closed``: whether a lock holds slide and spin."""
    for k in range(2):
        c, contact = (slide, contact1) if k == 0 else (spin, contact2)
        at = k * NLIMITS
        limits[at + LOW], limits[at + HIGH] = c.bounds.low, c.bounds.high
        if c.bounds.rest != 0:
            for bound in (LOW, HIGH):
                if abs(limits[at + bound]) <= rounding(o, k) / h:
                    limits[at + bound] = 0.0
        limits[at + REST], limits[at + IMPACT] = c.bounds.rest, c.bounds.impact
        limits[at + RESTITUTION], limits[at + REBOUND] = c.restitution, c.rebound
        limits[at + ACCELERATION], limits[at + TIME] = c.acceleration, c.time
        limits[at + CONTINUES], limits[at + CONTACT] = 1.0 if c.continues else 0.0, contact
        most = drive_limit(par, k) if is_driven(par, k, closed[k]) else math.inf
        limits[at + BELOW] = most if contact <= 0 else math.inf
        limits[at + ABOVE] = most if contact >= 0 else math.inf


@inline_function
def _read_limits(limits: Array, k: int) -> StopBounds:
    at = k * NLIMITS
    bounds = Bounds(
        limits[at + LOW], limits[at + HIGH], int(limits[at + IMPACT]), int(limits[at + REST])
    )
    return StopBounds(
        bounds, limits[at + RESTITUTION], limits[at + REBOUND], limits[at + ACCELERATION],
        limits[at + TIME], limits[at + CONTINUES] != 0.0, NO_IMPACT,
    )  # fmt: skip


@device_function
def find_contacts(
    par: Array, mem: Array, sample: Array, h: float, r: ReducedStep, out: Array, limits: Array,
    about: Two,
) -> bool:  # fmt: skip
    """Write the ``limits`` of a connector with stops; whether any stop bounds its step.

    ``r``: its step with the forces of the others known. ``mem`` is updated, so that the caller
    passes a copy; ``out`` is scratch space. ``about``: the group's rates of slide and spin.
    """
    if begin(par, mem, sample, h, out) != layout.OK:
        return False
    o = measure(par, mem, sample, h, out)
    update_gain(par, mem, o.twist.v[0], o.twist.w[0], h)
    linearise_about(mem, about, 1.0)
    q = pose_free_axes(par, mem, o, r, h)
    explicit = model.output(par).semi_implicit
    rates, b1, b2 = (o.twist.v[0], o.twist.w[0]), q.b1, q.b2
    side1, side2 = -1 if b1.low == b1.high else 0, -1 if b2.low == b2.high else 0
    free = solve_case(par, mem, o, rates, r, q.sp, h, explicit, side1, b1, side2, b2, BY_RULE)
    slide, spin = with_stops(par, mem, o, r, q.sp, h, explicit, b1, b2, free, q.eps)
    contact1, contact2 = 0, 0
    if is_driven(par, 0, q.closed[0]):
        slide, contact1 = clipped(par, mem, o, r, q.sp, h, explicit, 0, b1, b2, q.eps)
    if is_driven(par, 1, q.closed[1]):
        spin, contact2 = clipped(par, mem, o, r, q.sp, h, explicit, 1, b1, b2, q.eps)
    write_limits(par, limits, o, h, q.closed, slide, contact1, spin, contact2)
    return _bounds(slide.bounds, side1, contact1) or _bounds(spin.bounds, side2, contact2)


@inline_function
def _bounds(b: Bounds, side: int, contact: int) -> bool:
    """Whether a component is bounded by a stop: not by the rate alone that is prescribed for it."""
    return contact != 0 or (side == 0 and (b.low > -math.inf or b.high < math.inf))


@inline_function
def _kept_side(c: StopBounds, side: int, rate: float) -> int:
    """The side of a component in an impact: also without a force, where another stop bears it."""
    if side != 0 or c.bounds.impact == 0:
        return side
    target = c.bounds.low if c.bounds.impact < 0 else c.bounds.high
    return c.bounds.impact if abs(rate - target) <= SHARED * (abs(target) + c.rebound) else 0


@inline_function
def _pushing(reaction: float) -> int:
    """The stop that a reaction belongs to: -1 the lower, 1 the upper."""
    if reaction > 0.0:
        return -1
    return 1 if reaction < 0.0 else 0


@inline_function
def _agree(s: FreeAxesSolution, group: Array, q: PosedFreeAxes) -> bool:
    """Whether a step has the forces of the group's solution."""
    for k in range(2):
        mobility = q.sp.s[0] if k == 0 else q.sp.s[2]
        given = group[FRICTION + k] + group[REACTION + k]
        size = abs(given) + abs(s.friction[k]) + abs(s.reaction[k])
        if mobility > 0.0:
            size += (abs(q.sp.free[k]) + abs(s.end[k])) / mobility
        if abs(s.friction[k] + s.reaction[k] - given) > AGREES * size:
            return False
    return True


@inline_function
def _of_group(s: FreeAxesSolution, group: Array) -> FreeAxesSolution:
    """The group's solution in place of ``s``."""
    regime = s.regime if s.regime == layout.FRICTIONLESS else int(group[REGIME])
    return FreeAxesSolution(
        (group[END], group[END + 1]),
        (group[FRICTION], group[FRICTION + 1]),
        (group[REACTION], group[REACTION + 1]),
        regime, s.flags, s.s_mean, s.residual,
    )  # fmt: skip


@inline_function
def has_any_stop(par: Array) -> bool:
    """Whether slide or spin has a stop."""
    return has_stops(par, 0) or has_stops(par, 1)


@inline_function
def solve_limited(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, q: PosedFreeAxes, h: float,
    explicit: bool, limits: Array, group: Array,
) -> LimitedSolution:  # fmt: skip
    """The step of a connector within the bounds that its group found, with the others known.

    ``group``: (NSOLUTION,) the group's solution. It is taken where the step, to which friction may
    offer several solutions, has another one: only together do they satisfy the constraints.
    """
    slide, spin = _read_limits(limits, 0), _read_limits(limits, 1)
    contact1, contact2 = int(limits[CONTACT]), int(limits[NLIMITS + CONTACT])
    b1, b2 = slide.bounds, spin.bounds
    side1, side2 = -1 if b1.low == b1.high else 0, -1 if b2.low == b2.high else 0
    rates = (o.twist.v[0], o.twist.w[0])
    free = solve_case(par, mem, o, rates, r, q.sp, h, explicit, side1, b1, side2, b2, BY_RULE)
    solved, sides = free, (side1, side2)
    if has_any_stop(par):
        is_free = side1 == 0 and side2 == 0
        solved, sides = solve_with_limits(par, mem, o, r, q.sp, h, explicit, b1, b2, free, is_free)
    if not _agree(solved, group, q):
        solved = _of_group(solved, group)
        sides = (
            side1 if side1 != 0 else _pushing(group[REACTION]),
            side2 if side2 != 0 else _pushing(group[REACTION + 1]),
        )
    sides = (_kept_side(slide, sides[0], solved.end[0]), _kept_side(spin, sides[1], solved.end[1]))
    f, g = solved.reaction
    blocked, d1, d2 = False, f, g
    if is_driven(par, 0, q.closed[0]):
        blocked = contact1 != 0 and differs(par, 0, q.b1.low, solved.end[0])
        d1 = drive_share(0, drive_limit(par, 0), contact1, f)
    elif q.b1.low != q.b1.high:
        contact1 = sides[0] if f != 0.0 else 0
    if is_driven(par, 1, q.closed[1]):
        blocked = blocked or (contact2 != 0 and differs(par, 1, q.b2.low, solved.end[1]))
        d2 = drive_share(0, drive_limit(par, 1), contact2, g)
    elif q.b2.low != q.b2.high:
        contact2 = sides[1] if g != 0.0 else 0
    return LimitedSolution(solved, sides, (contact1, contact2), slide, spin, (d1, d2), blocked)
