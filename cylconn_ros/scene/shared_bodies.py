"""Which connectors have bodies in common, and whether they can.

A body is one and the same where its ``frame`` is. What connectors say of it must then agree; those
that share one that moves are solved together (connector/group.py).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.schema import Value, show

if TYPE_CHECKING:
    from cylconn_ros.scene.scene import Scene

BODIES = ("body_a", "body_b")
Place = tuple[str, int]  # a connector and its body: 0 A, 1 B

_ALIKE = (  # of connectors that are solved together
    "input", "period", "latency", "plant_integration", "world_frame", "twist_axes", "gravity",
    "stamp_tolerance", "wrench.axes", "wrench.point", "wrench.hold", "plant.lock_step",
)  # fmt: skip
_TOPIC = re.compile(r"[A-Za-z]\w*(?:/[A-Za-z]\w*)*", re.ASCII)


def shared(scenes: Mapping[str, Scene]) -> dict[str, list[Place]]:
    """Frame of every body that moves and that several connectors have; who has it."""
    found: dict[str, list[Place]] = {}
    for name, scene in scenes.items():
        for k, body in enumerate(scene.bodies):
            if body.kind != "fixed":
                found.setdefault(body.frame, []).append((name, k))
    return {frame: places for frame, places in found.items() if len(places) > 1}


def groups(scenes: Mapping[str, Scene]) -> list[list[str]]:
    """Connectors that belong together, in their order: each of them in one list."""
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


def check(scenes: Mapping[str, Scene]) -> None:
    """Raise SceneError, naming both, where connectors disagree about a body that they share."""
    first: dict[str, Place] = {}
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


def _agree(values: Mapping[str, Mapping[str, Value]], one: Place, other: Place, frame: str) -> None:
    for parameter in ("kind", "pose", "mass", "com", "inertia"):
        _same(values, one, other, f"{{}}.{parameter}", f"both are the body {frame}")
    for parameter in ("pose", "twist", "load"):
        _same(values, one, other, f"plant.{{}}.{parameter}", f"both are the body {frame}")


def _same(
    values: Mapping[str, Mapping[str, Value]], one: Place, other: Place, pattern: str, why: str
) -> None:
    names = [pattern.format(BODIES[k]) for _, k in (one, other)]
    texts = [show(values[c][name]) for (c, _), name in zip((one, other), names, strict=True)]
    if texts[0] != texts[1]:
        raise SceneError(
            f"{one[0]}.{names[0]} = {texts[0]}, {other[0]}.{names[1]} = {texts[1]}: "
            f"must be the same, as {why}"
        )


def _solvable(
    scenes: Mapping[str, Scene], values: Mapping[str, Mapping[str, Value]], names: list[str]
) -> None:
    """What is needed for connectors to be solved together."""
    why = "they share a body and are solved together"
    for name in names:
        scene = scenes[name]
        for k, body in enumerate(scene.bodies):
            if body.kind == "unknown":
                raise SceneError(
                    f"{name}.{BODIES[k]}.kind = 'unknown': must be known, as {name} shares a body "
                    "and is solved together with others"
                )
        if scene.method not in ("auto", "impulse") or scene.tolerance > 0.0:
            raise SceneError(
                f"{name}.method = {show(scene.method)}, {name}.tolerance = "
                f"{show(scene.tolerance)}: must be impulse and 0.0, as {', '.join(names)} share "
                "bodies and are solved together"
            )
        if scene.latency != 0:
            raise SceneError(f"{name}.latency = {scene.latency}: must be 0, as {why}")
        for parameter in _ALIKE:
            _same(values, (names[0], 0), (name, 0), parameter, why)
