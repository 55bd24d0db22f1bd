"""Connectors of a node that share a body: one topic for its motion, and one coupled solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cylconn_ros.messages.coupled_pipeline import CoupledPipeline
from cylconn_ros.messages.pipeline import input_names
from cylconn_ros.ros.connector.endpoint import ConnectorEndpoint
from cylconn_ros.scene import shared_bodies
from cylconn_ros.scene.scene import Scene


def share_body_topics(
    connectors: Sequence[ConnectorEndpoint], scenes: Mapping[str, Scene]
) -> list[list[ConnectorEndpoint]]:
    """Move the motion and load of each shared body to topics below the name of its frame.

    The first connector that has the body subscribes and forwards messages to the others. Returns
    the groups of coupled connectors.
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
            forwards = [
                (by_name[other], f"{shared_bodies.BODIES[k]}/{kind}") for other, k in others
            ]
            by_name[first].forwards[name] = forwards
            for connector, input_name in forwards:
                connector.topics.remote.add(input_name)
    return [[by_name[name] for name in names] for names in shared_bodies.groups(scenes)]


def _inputs(scene: Scene, body: int) -> list[str]:
    return [
        name for name in input_names(scene) if name.startswith(shared_bodies.BODIES[body] + "/")
    ]


def couple_connectors(group: Sequence[ConnectorEndpoint]) -> str:
    """Couple connectors that share a body, keeping their histories; return the line to log."""
    pipelines = [one.pipeline for one in group if one.pipeline is not None]
    if len(group) == 1 or len(pipelines) < len(group):
        return ""
    coupled = CoupledPipeline(pipelines)
    for one in group:
        one.coupled, one.partners = coupled, list(group)
    names = ", ".join(one.name for one in group)
    return f"{names}: shared bodies, coupled solution; redundant reactions have minimum norm"
