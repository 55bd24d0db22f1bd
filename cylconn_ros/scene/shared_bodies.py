"""Bodies that connectors share, and the rules for them.

Connectors whose bodies have the same ``frame`` share that body. Their parameters of the body must
agree. Connectors that share a moving body are coupled: they are solved together
(connector/group.py), and the parameters marked ``shared="coupled"`` in the schema must agree.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from cylconn_ros.errors import SceneError
from cylconn_ros.methods.traits import AUTO, TRAITS
from cylconn_ros.scene.elements import SEMI_IMPLICIT, inertia_of
from cylconn_ros.scene.fields import SceneFields, schema
from cylconn_ros.scene.schema import Value, show

BODIES = ("body_a", "body_b")
BodyOf = tuple[str, int]  # a connector's name and its body: 0 A, 1 B

_TOPIC = re.compile(r"[A-Za-z]\w*(?:/[A-Za-z]\w*)*", re.ASCII)


def shared(scenes: Mapping[str, SceneFields]) -> dict[str, list[BodyOf]]:
    """Moving bodies with several connectors: the connectors (name, body) by the body's frame."""
    found: dict[str, list[BodyOf]] = {}
    for name, scene in scenes.items():
        for k, body in enumerate(scene.bodies):
            if body.kind != "fixed":
                found.setdefault(body.frame, []).append((name, k))
    return {frame: places for frame, places in found.items() if len(places) > 1}


def groups(scenes: Mapping[str, SceneFields]) -> list[list[str]]:
    """Names of coupled connectors, one list per group, in the order of ``scenes``."""
    group = {name: [name] for name in scenes}
    for places in shared(scenes).values():
        together = [one for name, _ in places for one in group[name]]
        merged = [name for name in scenes if name in together]
        for name in merged:
            group[name] = merged
    found: list[list[str]] = []
    for names in group.values():
        if names not in found:
            found.append(names)
    return found


def check(scenes: Mapping[str, SceneFields]) -> None:
    """Raise SceneError, naming both, if two connectors disagree about a body that they share."""
    first: dict[str, BodyOf] = {}
    values = {name: scene.parameters() for name, scene in scenes.items()}
    for name, scene in scenes.items():
        for k, body in enumerate(scene.bodies):
            one = first.setdefault(body.frame, (name, k))
            if one[0] != name:
                _agree(values, one, (name, k), body.frame)
    for frame, places in shared(scenes).items():
        for name, k in places:
            if not _TOPIC.fullmatch(frame):
                raise SceneError(
                    f"{name}.{BODIES[k]}.frame = {show(frame)}: must be usable as the name of a "
                    f"topic, as the body is shared and its topics are {frame}/pose, …"
                )
    for names in groups(scenes):
        if len(names) > 1:
            _solvable(scenes, values, names)


def _agree(
    values: Mapping[str, Mapping[str, Value]], one: BodyOf, other: BodyOf, frame: str
) -> None:
    for name, rules in schema().items():
        if rules.shared == "body" and "body_a" in name:
            _same(values, one, other, name.replace("body_a", "{}"), f"both are the body {frame}")


def _same(
    values: Mapping[str, Mapping[str, Value]], one: BodyOf, other: BodyOf, pattern: str, why: str
) -> None:
    names = [pattern.format(BODIES[k]) for _, k in (one, other)]
    texts = [show(values[c][name]) for (c, _), name in zip((one, other), names, strict=True)]
    if texts[0] != texts[1]:
        raise SceneError(
            f"{one[0]}.{names[0]} = {texts[0]}, {other[0]}.{names[1]} = {texts[1]}: "
            f"must be the same, as {why}"
        )


def _solvable(
    scenes: Mapping[str, SceneFields], values: Mapping[str, Mapping[str, Value]], names: list[str]
) -> None:
    """Raise SceneError if connectors that share a body cannot be solved together."""
    why = "they share a body and are solved together"
    for name in names:
        scene = scenes[name]
        for k, body in enumerate(scene.bodies):
            if body.kind == "unknown":
                raise SceneError(
                    f"{name}.{BODIES[k]}.kind = 'unknown': must be known, as {name} shares a body "
                    "and is solved together with others"
                )
        traits = AUTO if scene.method == "auto" else TRAITS[scene.method]
        if not traits.couples or scene.tolerance > 0.0:
            raise SceneError(
                f"{name}.method = {show(scene.method)}, {name}.tolerance = "
                f"{show(scene.tolerance)}: must be impulse and 0.0, as {', '.join(names)} share "
                "bodies and are solved together"
            )
        if scene.latency > 0:
            raise SceneError(f"{name}.latency = {scene.latency}: must be 0 or -1, as {why}")
        if scene.plant_latency > 0.0:
            raise SceneError(
                f"{name}.plant.latency = {show(scene.plant.latency)}: must be 0, as {why}"
            )
        for parameter, rules in schema().items():
            if rules.shared == "coupled":
                _same(values, (names[0], 0), (name, 0), parameter, why)
    _check_springs({name: scenes[name] for name in names})


def _check_springs(scenes: Mapping[str, SceneFields]) -> None:
    """Raise SceneError if linear springs on shared bodies are together too stiff.

    As scene/elements.py for one connector: on a semi-implicit plant K h^2 G <= 4 for the greatest
    eigenvalue, K the stiffnesses and G the inverse inertia that the components share, for axes that
    are parallel.
    """
    first = next(iter(scenes.values()))
    if first.plant_integration != "semi_implicit" or first.period == 0.0:
        return
    names = list(scenes)
    for k, spring in enumerate(("k1", "kr1")):
        stiff = np.array([getattr(scene.elasticity, spring) for scene in scenes.values()])
        shared_inverse = np.zeros((len(names), len(names)))
        for i, one in enumerate(scenes.values()):
            for j, other in enumerate(scenes.values()):
                shared_inverse[i, j] = sum(
                    1.0 / max(inertia_of(one, m, k), inertia_of(other, n, k))
                    for m, body in enumerate(one.bodies)
                    for n, same in enumerate(other.bodies)
                    if body.kind == "free" and body.frame == same.frame
                )
        root = np.sqrt(stiff)
        found = np.linalg.eigvalsh(root[:, None] * shared_inverse * root)[-1] * first.period**2
        if found > SEMI_IMPLICIT * (1.0 + 1e-12):
            stiffest = names[int(np.argmax(stiff))]
            raise SceneError(
                f"{stiffest}.elasticity.{spring} = {show(float(stiff.max()))}: the springs of "
                f"{', '.join(names)}, which share bodies, are more than the period carries with "
                f"plant_integration semi_implicit: must be at most {SEMI_IMPLICIT / found:.3g} of "
                "their stiffness; give a shorter period or softer springs"
            )
