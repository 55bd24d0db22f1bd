"""Problems of a connector as texts: topic, value seen, value expected, remedy.

A problem is reported while it lasts. Its key names its kind, so that the log has each kind once
although the numbers in the text change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.description import unknown_frame_text
from cylconn_ros.connector.start import start_warnings
from cylconn_ros.core import layout, model
from cylconn_ros.core.joint_limits import is_motion_imposed
from cylconn_ros.core.latency import REFUTED
from cylconn_ros.core.relative_state import MAX_INPUT
from cylconn_ros.messages.health import Health
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.messages.topic_names import prefix_log
from cylconn_ros.ros.connector.watchdog import missing_topics
from cylconn_ros.scene.inputs import BODIES, carrier
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

OK, WARN, ERROR = (
    level[0] for level in (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)
)

_INTEGRATION = {"exact": "semi_implicit", "semi_implicit": "exact"}  # measured, by the stated one
_INTEGRATES = {"exact": "exactly", "semi_implicit": "semi-implicitly"}
_ALIGNED = 10.0  # deg between two motions, below which their lengths differ, not their axes
_WHOLE, _STEADY = 0.15, 0.25  # samples: of a latency from a whole number, and its spread
_EVEN = 0.01  # of the period: differences of stamps within it are even
_UNEVEN_STAMPS = "uneven stamps"
_EXPLAINED = 0.25  # relative difference of motions that uneven stamps explain
TIMEOUT = "timeout"  # key of the problem that the watchdog logs itself, each time
_ZERO = "commanding zero wrench"


class Problem(NamedTuple):
    """A problem, or a hint (level OK): level, key and text."""

    level: int
    key: str
    text: str


IsNew = Callable[[str, int], bool]
"""Whether a count, given by name and value, has grown since the last report."""


def timeout_text(timeout: float) -> str:
    """Warning about an input timeout (s)."""
    return f"input timeout ({timeout:g} s): {_ZERO}"


def sample_problems(pipeline: MessagePipeline, health: Health, is_new: IsNew) -> Iterator[Problem]:
    """Problems of messages and of their synchronization to samples."""
    counts, scene = pipeline.matcher.counts, pipeline.scene
    if is_new("failed", health.failed):
        yield Problem(ERROR, "failed", f"computing a sample failed: {health.failure}; {_ZERO}")
    yield from _unusable(scene, health, is_new)
    if is_new("undecodable", health.undecodable):
        text = f"{health.undecodable_text}: the message cannot be decoded, ignored"
        yield Problem(ERROR, f"undecodable {health.undecodable_text.partition(':')[0]}", text)
    if is_new("refused", health.refused):
        yield Problem(WARN, f"refused {health.refusal}", f"command refused: {health.refusal}")
    if is_new("no period", health.no_period):
        text = "no time step between samples yet (period = 0.0: taken from the stamps)"
        yield Problem(WARN, "no period", text)
    if is_new("off period", health.off_period):
        yield _off_period(pipeline, health.seen_period)
    if is_new("late", counts.late):
        text = "messages older than the last sample arrive late, ignored; publish them in order"
        yield Problem(WARN, "late", text)
    yield from _load_problems(pipeline, is_new)
    if is_new("incomplete", counts.incomplete):
        yield Problem(WARN, "incomplete", _incomplete_text(pipeline))
    if is_new("restarts", counts.restarts):
        text = "stamps went back: restarted with a new reference configuration"
        yield Problem(WARN, "restarts", text)
    if is_new("unknown frame_ids", counts.unknown_frames):
        seen = pipeline.matcher.unknown_frame
        text = unknown_frame_text(pipeline.scene, seen) if seen is not None else ""
        yield Problem(WARN, text.partition(";")[0], text)


def _off_period(pipeline: MessagePipeline, seen: float) -> Problem:
    """Stamps that are ``seen`` s apart, not a period; each of the two that is used has a line."""
    declared, used = pipeline.scene.period, pipeline.connector.period
    text = f"stamps are {seen:g} s apart, period is {declared:g} s"
    if used == declared:
        remedy = "set period to the spacing of the stamps, or to 0.0 to take it from them"
        return Problem(WARN, "off period", f"{text}; {remedy}")
    text += f", which the motion contradicts: wrenches are computed for {used:.4g} s"
    remedy = f"set period: {used:.4g}, or 0.0 to take it from the stamps"
    return Problem(WARN, "period replaced", f"{text}; {remedy}")


def _load_problems(pipeline: MessagePipeline, is_new: IsNew) -> Iterator[Problem]:
    """Loads that do not come with their samples (connector/load_history.py)."""
    counts, scene = pipeline.matcher.counts, pipeline.scene
    topic = _topic(scene, counts.load_body, "load")
    if is_new("late loads", counts.late_loads):
        text = (
            f"{topic} arrives after the sample with its stamp was processed (expected before pose "
            "and twist, or right after); it acts from the next sample on; publish it first"
        )
        yield Problem(WARN, f"late {topic}", text)
    if is_new("unused loads", counts.unused_loads):
        text = f"{topic}: stamps are older than the load in force, ignored; publish them in order"
        yield Problem(WARN, f"unused {topic}", text)
    if is_new("early loads", counts.early_loads):
        text = (
            f"{topic}: stamps are {counts.load_lead * 1e-9:.4g} s after the samples', and the load "
            "acts from then on; use one clock for both"
        )
        yield Problem(WARN, f"early {topic}", text)


def _unusable(scene: Scene, health: Health, is_new: IsNew) -> Iterator[Problem]:
    """Samples whose numbers cannot be used, or are not what they should be."""
    if is_new("non-finite", health.not_finite):
        topic = topic_of(scene, health.not_finite_at)
        text = f"{topic} is not finite (expected finite numbers): {_ZERO}; check the simulator"
        yield Problem(ERROR, f"non-finite {topic}", text)
    if is_new("too large", health.too_large):
        topic = topic_of(scene, health.too_large_at)
        text = (
            f"{topic} has the value {health.seen_value:.3g} (expected less than {MAX_INPUT:g}): "
            f"{_ZERO}; the simulation has diverged, restart it and call ~/reset"
        )
        yield Problem(ERROR, f"too large {topic}", text)
    if is_new("overflowed", health.overflowed):
        text = (
            f"the forces of finite inputs are too large to be numbers: {_ZERO}, and the next "
            "sample is the reference configuration; the simulation has diverged, use a shorter "
            "period or limits.force"
        )
        yield Problem(ERROR, "overflowed", text)
    if is_new("bad quaternion", health.bad_quaternion):
        topics = " or ".join(_topic(scene, body, "pose") for body in _moving(scene))
        text = f"{topics}: orientation cannot be normalised (length 0, expected 1): {_ZERO}"
        yield Problem(ERROR, "bad quaternion", text)
    for body, (count, norm) in enumerate(zip(health.off_norm, health.seen_norm, strict=True)):
        if is_new(f"off norm {body}", count):
            topic = _topic(scene, body, "pose")
            text = (
                f"{topic}: orientation has norm {norm:.4g} (expected 1), normalised; publish unit "
                "quaternions"
            )
            yield Problem(WARN, f"off norm {topic}", text)


def topic_of(scene: Scene, at: int) -> str:
    """Relative topic of the input that gives number ``at`` of a sample (core/layout.py)."""
    if at >= layout.A_LOAD:
        return _topic(scene, int(at >= layout.B_LOAD), "load")
    body = int(at >= layout.B_POSE)
    is_twist = at >= (layout.A_TWIST, layout.B_TWIST)[body]
    return _topic(scene, body, "twist" if is_twist else "pose")


def solution_problems(
    connector: Connector, health: Health, is_new: IsNew, uneven: bool = False
) -> Iterator[Problem]:
    """Problems of the solution: flags, and wrenches that are scaled down.

    ``uneven``: whether stamps since the last report were not one period apart.
    """
    scene = connector.scene
    flags = health.flags
    if flags & layout.UNDERSAMPLED:
        text = "undersampled: rotation per sample is above 0.5 rad; use a shorter period"
        yield Problem(WARN, "undersampled", text)
    if flags & layout.TURN_AMBIGUOUS:
        text = (
            "number of turns is ambiguous: predicted and measured angle differ by more than pi/2; "
            "check the twist, or use a shorter period"
        )
        yield Problem(WARN, "turns", text)
    contradicts = bool(flags & layout.TWIST_CONTRADICTS)
    if contradicts or uneven:  # stamps that the motion replaces contradict no twist
        for problem in _contradictions(connector, uneven):
            if contradicts or problem.key == _UNEVEN_STAMPS:
                yield problem
    if flags & layout.MISALIGNED:
        text = (
            "correcting constraint drift: too large for one step (worst: "
            f"{health.worst_offset:.3g} m, {health.worst_angle:.3g} rad)"
        )
        yield Problem(WARN, "drift", text)
    for text in start_warnings(connector):
        stop = text.partition("stops.")[2].partition(" ")[0]
        if is_new(f"start {stop}", 1):
            yield Problem(WARN, f"start {stop}", text)
    if flags & layout.GAINS_LOWERED and scene.constraint == "connector":
        yield Problem(WARN, "gains", _lowered_gains(connector))
    if flags & layout.DRIVE_BLOCKED:
        yield from _blocked_drives(connector, health)
    if flags & layout.DISENGAGED:
        text = (
            f"shaft and sleeve have come apart: overlap below friction.overlap_min "
            f"({scene.friction.overlap_min:g} m), where it is held; set stops.l_min or stops.l_max "
            "so that they stay together"
        )
        yield Problem(WARN, "disengaged", text)
    if flags & layout.INTEGRATION:
        seen = _INTEGRATION[scene.plant_integration]
        text = (
            f"this simulator integrates {_INTEGRATES[seen]}: set plant_integration: {seen} "
            f"(now {scene.plant_integration})"
        )
        yield Problem(WARN, "integration", text)
    if flags & layout.CONTRADICTORY:
        text = (
            "connectors that share a body hold it against each other: nothing is left to slide or "
            "spin, or offsets exclude each other; make their axes parallel (node_a, node_b), or "
            "set reference.offsets: hold"
        )
        yield Problem(WARN, "contradictory", text)
    if flags & layout.NOT_CONVERGED:
        text = (
            f"connectors that share a body: residual {health.worst_residual:.1e}, expected at most "
            "1e-9: friction is limited to what feeds no slip; look for drives and stops that "
            "contradict each other, or for friction that jams"
        )
        yield Problem(WARN, "not converged", text)
    if is_new("saturated", health.saturated):
        text = (
            f"wrenches are scaled down to the limits (limits.force = {show(scene.limits.force)} N, "
            f"limits.torque = {show(scene.limits.torque)} Nm)"
        )
        yield Problem(WARN, "saturated", text)


def _blocked_drives(connector: Connector, health: Health) -> Iterator[Problem]:
    """Components with an imposed motion that a stop or a lock holds."""
    scene, par = connector.scene, connector.par
    limits = (("l_min", "l_max"), ("theta_min", "theta_max"))
    for k, name in enumerate(("slide", "spin")):
        if not is_motion_imposed(par, k):
            continue
        holding = [
            f"stops.{stop} = {show(getattr(scene.stops, stop))}"
            for bit, stop in enumerate(limits[k])
            if health.stops >> (2 * k + bit) & 1
        ]
        if health.lock >> k & 1:
            holding.append(f"lock.component = {show(scene.lock.component)}")
        if not holding:
            continue
        at = model.COMMAND + 3 * k
        wanted = ", ".join(
            f"{what} {value:g}"
            for what, value in zip(("position", "velocity"), par[at : at + 2], strict=True)
            if not math.isnan(value)
        )
        text = (
            f"the motion imposed on {name} (command.{name}: {wanted}) is held by "
            f"{' and '.join(holding)}, which has priority; command a motion away from it, or end "
            "the command"
        )
        yield Problem(WARN, f"blocked {name}", text)


def _lowered_gains(connector: Connector) -> str:
    if connector.method == "impulse":
        return (
            "wrenches scaled so that the bodies gain no energy: they turn too far in a period for "
            "the length of their arms; shorten the period"
        )
    stiffness, damping = connector.gain_shares
    penalty = connector.scene.penalty
    return (
        f"penalty gains lowered, stiffness to {stiffness:.2g} and damping to {damping:.2g} of the "
        "parameters, which are unstable at this period: set penalty.stiffness: "
        f"{stiffness * penalty.stiffness:.3g} and penalty.damping: {damping * penalty.damping:.3g}"
    )


def latency_problem(connector: Connector, before: float | None) -> Iterator[Problem]:
    """The measured latency, if there is one, and what to set; a declared one that it refutes.

    ``before``: samples, measured at the last report, None if unknown; a latency that changes is not
    reported yet.
    """
    latency, spread, period = (
        connector.measured_latency, connector.latency_spread, connector.period,
    )  # fmt: skip
    declared = connector.scene.latency
    expected = max(declared, 0)
    if latency is None or before is None or abs(latency - before) > _WHOLE:
        return
    if abs(latency - expected) < _WHOLE + (spread if declared >= 0 else 0.0):
        return
    time = f" ({latency * period * 1e3:.1f} ms)" if period else ""
    bound = latency > layout.MAX_LATENCY - _WHOLE  # no more is measured
    more = " or more" if bound else ""
    text = f"wrenches act {latency:.1f} samples{time}{more} after their sample"
    whole = round(latency)
    steady = abs(latency - whole) <= _WHOLE and spread <= _STEADY and not bound
    if declared >= 0:
        text = f"latency: {declared} is declared, but {text}"
        remedy = f"set latency: {whole}" if steady else "set latency: -1, which measures it"
        if declared and abs(latency - declared) > REFUTED:
            text += "; the measured latency is used"
        yield Problem(WARN, f"declared latency {declared}", f"{text}: {remedy}")
    elif whole and steady:
        yield Problem(WARN, f"latency {whole}", f"{text}: set latency: {whole}")
    else:
        if bound:
            text += ", the greatest latency that is measured"
        else:
            text += f", with a spread of {spread:.1f} samples"
        text += ": keep latency: -1, which follows it"
        yield Problem(OK, "latency", text)


def _contradictions(connector: Connector, uneven: bool) -> Iterator[Problem]:
    """Each body whose twist does not match its poses: ratio and direction of the two motions.

    A body that moves by the twist times the period, while the stamps are farther apart or closer,
    contradicts nothing: its stamps are not the times of its motion.
    """
    scene, memory = connector.scene, connector.memory
    interval = float(memory[model.STAMP_PERIOD])
    stretch = interval / connector.period if uneven and scene.period else 1.0
    for body in _moving(scene):
        at = model.CONTRADICTION + 3 * body
        by_poses, by_twists, product = memory[at : at + 3]
        if by_poses == by_twists == 0.0:
            continue
        ratio = math.sqrt(by_twists / by_poses) if by_poses else math.inf
        length = math.sqrt(by_poses * by_twists)
        apart = math.degrees(math.acos(min(max(product / length, -1.0), 1.0))) if length else 0.0
        remedy = "check its units and its reference point"
        directions = ""
        if apart > _ALIGNED:
            directions = f", directions {apart:.0f} deg apart"
            remedy = "check its axes (frame_id, twist_axes)"
        topic = _topic(scene, body, "twist")
        by_stamps = abs(stretch - 1.0) > _EVEN and abs(ratio / stretch - 1.0) < _EXPLAINED
        if by_stamps and apart <= _ALIGNED:
            yield Problem(WARN, _UNEVEN_STAMPS, _uneven_text(scene, interval))
            continue
        text = (
            f"{topic} does not match the pose differences (ratio {ratio:.1f}, expected 1.0"
            f"{directions}): {remedy}"
        )
        yield Problem(WARN, f"contradiction {topic}", text)


def _uneven_text(scene: Scene, interval: float) -> str:
    """Warning about stamps that are not the times of the motion."""
    off = 100.0 * abs(interval / scene.period - 1.0)
    return (
        f"stamps are {off:.0f} % off the period ({interval:.4g} s, expected {scene.period:g} s) "
        "although the bodies move by one period: stamp samples with the simulation time"
    )


def _moving(scene: Scene) -> list[int]:
    return [index for index, body in enumerate(scene.bodies) if body.kind != "fixed"]


def _topic(scene: Scene, body: int, quantity: str) -> str:
    """Relative topic of a quantity of a body."""
    kind = quantity if quantity == "load" else carrier(scene.input, quantity).topic
    return f"{BODIES[body]}/{kind}"


def _incomplete_text(pipeline: MessagePipeline) -> str:
    missing = missing_topics(pipeline.matcher, pipeline.scene)
    if missing:
        names = ", ".join(missing)
        return f"pose and twist with the same stamp never arrive together (missing: {names})"
    return (
        "samples stay incomplete: pose and twist with the same stamp do not both arrive before "
        "the next sample is complete"
    )


def log_model(logger: Any, connectors: Sequence[str], model: str, not_modelled: str) -> None:
    """Log what is modelled, at info level, and what is not, at debug level."""
    names = ", ".join(connectors)
    logger.info(prefix_log(names, model))
    if not_modelled:
        logger.debug(prefix_log(names, f"not modelled: {not_modelled}"))
