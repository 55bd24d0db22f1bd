"""What a connector models and what it leaves out, in one line: printed at start-up, recorded."""

import math

from cylconn_ros.scene.scene import Friction, Scene
from cylconn_ros.scene.schema import show

_IDEAS = {
    "impulse": "friction and reactions of a step solved together",
    "baumgarte": "accelerations with feedback, regularised friction: a loaded sleeve creeps",
    "penalty": "springs and dampers: gives by load/stiffness, stick is elastic",
    "augmented_lagrangian": "springs, dampers and a multiplier: stick is elastic",
    "observe": "no wrench is sent; forces and friction of the motion seen",
    "minimal": "the scene in its own coordinates",
}


def describe_model(scene: Scene, method: str) -> str:
    """One line: what is modelled, what is left out and why.

    ``method`` is the one that answers; the scene's may be ``auto``.
    """
    idea = f": {_IDEAS[method]}" if method in _IDEAS else ""
    parts = [f"method {method}" + (" (auto)" if scene.method == "auto" else "") + idea]
    left_out = []
    if scene.latency != 0:
        parts.append(_latency(scene))
    for name, body in (("A", scene.body_a), ("B", scene.body_b)):
        parts.append(f"body {name} {body.kind}")
        if body.kind in ("fixed", "driven"):
            left_out.append(f"inertia of {name} ({body.kind})")
    if scene.friction.on:
        parts.append(_friction(scene.friction))
        if scene.friction.overlap == 0.0:
            left_out.append("bending in the normal force (overlap 0)")
    else:
        left_out.append("friction (coefficient 0), so that the reactions are a linear solve")
    for text, given in _available(scene):
        (parts if given else left_out).append(text)
    if not any(scene.gravity):
        left_out.append("gravity")
    return "; ".join(parts) + ("; left out: " + ", ".join(left_out) if left_out else "")


def _latency(scene: Scene) -> str:
    if "unknown" in (scene.body_a.kind, scene.body_b.kind):
        lag = 1 + 2 * scene.latency
        return (
            f"wrenches {scene.latency} samples late, inertia unknown: "
            f"stiffness lowered to 1/{lag**2}, damping to 1/{lag}"
        )
    how = "as measured" if scene.latency < 0 else f"{scene.latency} samples"
    return f"answers for the state when the wrench acts, {how} after the sample"


def _friction(friction: Friction) -> str:
    if friction.table is not None:
        mu = "from a table"
    elif friction.static_coefficient > friction.coefficient:
        static, decay = show(friction.static_coefficient), show(friction.decay)
        mu = f"{show(friction.coefficient)}, static {static}, decay {decay} s/m"
    else:
        mu = show(friction.coefficient)
    text = f"friction {mu}, radius {show(friction.radius)} m"
    if friction.overlap > 0.0:
        text += f", overlap {show(friction.overlap)} m"
    if friction.preload != 0.0:
        text += f", preload {show(friction.preload)} N"
    if math.isfinite(friction.max_force):
        text += f", at most {show(friction.max_force)} N"
    return text


def _available(scene: Scene) -> list[tuple[str, bool]]:
    """What can act on slide and spin besides friction, and whether it does in this scene."""
    spring, damper, stops, lock = scene.elasticity, scene.damping, scene.stops, scene.lock
    bounds = (stops.l_min, stops.l_max, stops.theta_min, stops.theta_max)
    imposed = [
        value
        for motion in (scene.command.slide, scene.command.spin)
        for value in (motion.position, motion.velocity, motion.force)
    ]
    return [
        ("springs", spring.k1 > 0.0 or spring.kr1 > 0.0),
        ("dampers", damper.c1 > 0.0 or damper.cr1 > 0.0),
        ("stops", not all(map(math.isnan, bounds))),
        (f"lock of {lock.component}" if lock.component != "none" else "lock",
         lock.component != "none"),
        ("imposed motion or force", not all(map(math.isnan, imposed))),
    ]  # fmt: skip
