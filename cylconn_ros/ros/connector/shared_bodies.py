"""Which connectors of a node share a body: one topic for its motion, and one solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cylconn_ros.messages.coupled_pipeline import Together
from cylconn_ros.messages.pipeline import input_names
from cylconn_ros.ros.connector.endpoint import Served
from cylconn_ros.scene import shared_bodies
from cylconn_ros.scene.scene import Scene


def share_topics(connectors: Sequence[Served], scenes: Mapping[str, Scene]) -> list[list[Served]]:
    """Give the motion and load of a shared body topics of its own, below its frame's name.

    The first connector that has the body subscribes, and hands on to the others. Returns the
    connectors that belong together, each of them in one list.
    """
    by_name = {one.name: one for one in connectors}
    for frame, places in shared_bodies.shared(scenes).items():
        (first, body), *others = places
        for name in _inputs(scenes[first], body):
            kind = name.partition("/")[2]
            for other, k in places:
                by_name[other].topics.shared[f"{shared_bodies.BODIES[k]}/{kind}"] = (
                    f"{frame}/{kind}"
                )
            listening = [
                (by_name[other], f"{shared_bodies.BODIES[k]}/{kind}") for other, k in others
            ]
            by_name[first].listeners[name] = listening
            for connector, its in listening:
                connector.topics.foreign.add(its)
    return [[by_name[name] for name in names] for names in shared_bodies.groups(scenes)]


def _inputs(scene: Scene, body: int) -> list[str]:
    return [
        name for name in input_names(scene) if name.startswith(shared_bodies.BODIES[body] + "/")
    ]


def solve_together(group: Sequence[Served]) -> str:
    """Have connectors that share a body solved together, going on from where they are; in words."""
    answering = [one.answering for one in group if one.answering is not None]
    if len(group) == 1 or len(answering) < len(group):
        return ""
    together = Together(answering)
    for one in group:
        one.together, one.partners = together, list(group)
    names = ", ".join(one.name for one in group)
    return f"{names}: share bodies and are solved together; redundant reactions are the least"
