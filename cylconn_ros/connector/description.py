"""The model description: one line that says what a connector models; logged and recorded."""

import math

from cylconn_ros.connector.synchronized_sample import UnknownFrame
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.behaviour import INPUTS
from cylconn_ros.scene.elements import damper_tables, spring_tables
from cylconn_ros.scene.inputs import BODIES, carrier
from cylconn_ros.scene.scene import Friction, Scene
from cylconn_ros.scene.schema import show

_KEPT = (
    "constraint: simulator: only what acts on slide and spin is sent, as an opposite pair; "
    "reactions are computed for the normal force and not sent"
)
_COUPLED = (
    "shares a body with other connectors: solved with them; the latency is not measured, and taken "
    "as 0 (lock step)"
)


def describe_model(scene: Scene, method: str, coupled: bool = False) -> tuple[str, str]:
    """What is modelled, and what is not: two lines for logs, recordings and the terminal.

    ``method`` is the method in use; the scene's may be ``auto``. ``coupled``: whether the connector
    is solved with others that share its bodies.
    """
    automatic = " (auto)" if scene.method == "auto" else ""
    modelled = [f"method {method}{automatic}: {TRAITS[method].summary}"]
    absent = []
    if scene.constraint == "simulator":
        modelled.append(_KEPT)
        absent.append("slot and revolute (the simulator's joint keeps them)")
    if scene.latency != 0 and TRAITS[method].sends_wrench:
        modelled.append(_COUPLED if coupled else _latency(scene))
    for name, body in (("A", scene.body_a), ("B", scene.body_b)):
        modelled.append(f"body {name} {body.kind}")
        if body.kind in ("fixed", "driven"):
            absent.append(f"inertia of {name} ({body.kind})")
    if scene.friction.on:
        modelled.append(_friction(scene.friction))
        if scene.friction.overlap == 0.0:
            absent.append("bending in the normal force (overlap 0)")
    else:
        absent.append("friction (coefficient 0): the reactions follow from a linear solve")
    for text, present in _on_free_components(scene):
        (modelled if present else absent).append(text)
    if not any(scene.gravity):
        absent.append("gravity")
    return "; ".join(modelled), ", ".join(absent)


def _latency(scene: Scene) -> str:
    if "unknown" in (scene.body_a.kind, scene.body_b.kind):
        if scene.latency < 0:
            return "inertia unknown: gains are lowered if the wrenches put in energy"
        lag = 1 + 2 * scene.latency
        return (
            f"latency {scene.latency} samples, inertia unknown: "
            f"stiffness reduced to 1/{lag**2}, damping to 1/{lag}"
        )
    if scene.latency < 0 and scene.constraint == "simulator":
        return "latency not declared: stick, stops and drives act with the gain that the lag allows"
    latency = "measured" if scene.latency < 0 else f"{scene.latency} samples"
    return f"latency {latency}: computes for the predicted state at which the wrench acts"


def _friction(friction: Friction) -> str:
    forward, backward = friction.by_direction
    if friction.table is not None:
        mu = "from a table"
    elif forward != backward:
        mu = f"by direction, {show(forward)} forward and {show(backward)} backward"
    else:
        mu = show(forward)
    if friction.static_coefficient > friction.mean_coefficient:
        mean = "" if forward == backward else "mean "
        static, decay = show(friction.static_coefficient), show(friction.decay)
        mu += f", {mean}static {static}, decay {decay} s/m"
    text = f"friction {mu}, radius {show(friction.radius)} m"
    if friction.overlap > 0.0:
        text += f", overlap {show(friction.overlap)} m"
        if friction.overlap_change != "constant":
            text += f" {friction.overlap_change} with the slide"
        if friction.contact_centre in ("body_a", "between"):
            text += f", its middle carried by {friction.contact_centre}"
    if friction.preload != 0.0:
        text += f", preload {show(friction.preload)} N"
    if len(friction.inputs) < len(INPUTS):
        text += f", pressed by {' and '.join(friction.inputs)} only"
    if math.isfinite(friction.max_force):
        text += f", at most {show(friction.max_force)} N"
    return text


def _on_free_components(scene: Scene) -> list[tuple[str, bool]]:
    """What can act on slide and rotation besides friction, and whether the scene has it."""
    spring, damper, stops, lock = scene.elasticity, scene.damping, scene.stops, scene.lock
    bounds = (stops.l_min, stops.l_max, stops.theta_min, stops.theta_max)
    imposed = [
        value
        for motion in (scene.command.slide, scene.command.spin)
        for value in (motion.position, motion.velocity, motion.force)
    ]
    offset_force = scene.friction.offset_force
    tables = [any(table.points for table in of(scene)) for of in (spring_tables, damper_tables)]
    soft = ["slide", "spin"] if all(stops.compliant) else ["slide"] if stops.compliant[0] else []
    soft = soft or (["spin"] if stops.compliant[1] else [])
    return [
        ("springs by table" if tables[0] else "springs",
         spring.k1 > 0.0 or spring.kr1 > 0.0 or tables[0]),
        ("dampers by table" if tables[1] else "dampers",
         damper.c1 > 0.0 or damper.cr1 > 0.0 or tables[1]),
        (f"stops, compliant on {' and '.join(soft)}" if soft else "stops",
         not all(map(math.isnan, bounds))),
        (f"lock of {lock.component}" if lock.component != "none" else "lock",
         lock.component != "none"),
        ("imposed motion or force", not all(map(math.isnan, imposed))),
        *[(f"offset force {show(offset)} N", True) for offset in [offset_force] if offset != 0.0],
    ]  # fmt: skip


def unknown_frame_text(scene: Scene, seen: UnknownFrame) -> str:
    """Return topic, frame and expected frames, and how the message was treated."""
    odometry = scene.input == "odometry" and seen.quantity != "load"
    expected = [scene.world_frame]
    if seen.quantity != "pose":
        expected.append(scene.bodies[seen.body].frame)
    field = "child_frame_id" if odometry and seen.quantity == "twist" else "frame_id"
    kind = seen.quantity if seen.quantity == "load" else carrier(scene.input, seen.quantity).topic
    return (
        f"{BODIES[seen.body]}/{kind}: unknown {field} {seen.frame!r}, expected "
        f"{' or '.join(repr(frame) for frame in expected)}; treated as {seen.axes} axes"
    )
