"""Replay of all connectors of a recording; those that share bodies are solved together."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping

from cylconn_ros.messages.coupled_pipeline import CoupledPipeline
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.replay.replay import Item, Replay
from cylconn_ros.scene import shared_bodies
from cylconn_ros.scene.scene import Scene


class ReplayTogether:
    """Process a recording's inputs with the pipelines of several connectors.

    Attributes
    ----------
        bag: the whole recording. members: the replay of each connector, by its name.

    Raises RecordingError and SceneError as :class:`~cylconn_ros.replay.replay.Replay` does.
    """

    def __init__(self, bag: Bag, scenes: Mapping[str, Scene]) -> None:
        self.bag = bag
        self.members = {name: Replay(Bag(bag.source, name), s) for name, s in scenes.items()}
        for names in shared_bodies.groups(scenes):
            if len(names) > 1:
                group = [self.members[name] for name in names]
                coupled = CoupledPipeline([one.pipeline for one in group])
                for one in group:
                    one.beside = functools.partial(_others, coupled, group)

    def messages(self) -> Iterator[Item]:
        """Yield every recorded input and output message once, and every replayed output."""
        members = list(self.members.values())
        for member in members:
            member.begin()
        end = 0
        for topic, log_time, data in self.bag.messages():
            shown = False
            for member in members:
                for item in member.process(topic, log_time, data):
                    if item.replayed or not shown:
                        yield item
                    shown = shown or not item.replayed
            end = log_time
        for member in members:
            yield from member.flush(end)

    @property
    def input_topics(self) -> frozenset[str]:
        """Recorded topics that are an input of a connector."""
        return frozenset[str]().union(*(one.input_topics for one in self.members.values()))

    def topics(self) -> list[TopicInfo]:
        """The topics of a recording of the inputs and the replayed outputs."""
        found = {info.name: info for one in self.members.values() for info in one.topics()}
        return list(found.values())


def _others(coupled: CoupledPipeline, group: list[Replay], log_time: int) -> Iterator[Item]:
    """Outputs of the connectors that the last message did not complete."""
    for k, response in coupled.take_responses().items():
        yield from group[k].respond(response, log_time)
