"""Open one recorded run for all connectors of a node: its topics, and what it says of itself."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from rclpy.node import Node

from cylconn_ros import __version__
from cylconn_ros.errors import RecordingError
from cylconn_ros.messages.topic_names import said
from cylconn_ros.ros.connector.endpoint import Served
from cylconn_ros.ros.connector.recorder import Recorder, now
from cylconn_ros.scene.groups import Record
from cylconn_ros.scene.parameter_file import dump_several


def open_run(recorder: Recorder, node: Node, wanted: Record, connectors: Sequence[Served]) -> Path:
    """Begin to record; returns where. Raises RecordingError where that cannot be."""
    serving = [(one, one.answering) for one in connectors if one.answering is not None]
    if not serving:
        raise RecordingError(f"the node is {connectors[0].links.state}: nothing to record")
    told = {
        one.name: {
            "method": answering.connector.method,
            "model": answering.connector.model,
            "topics": one.topics.by_name(answering),
            "together": ", ".join(other.name for other in one.partners if other is not one),
        }
        for one, answering in serving
    }
    metadata = {
        "version": __version__,
        "node": node.get_fully_qualified_name(),
        "method": ", ".join(dict.fromkeys(answering.connector.method for _, answering in serving)),
        "model": "; ".join(said(one.name, answering.connector.model) for one, answering in serving),
        "parameters": dump_several(
            {one.name: answering.scene_in_force for one, answering in serving}
        ),
        "samples_before": str(sum(one.history for one in connectors)),  # 0: fit for replay
        "connectors": json.dumps(told),
    }
    recorded = {
        info.name: info for one, answering in serving for info in one.topics.recorded(answering)
    }
    directory = recorder.start(
        wanted.directory, node.get_name(), list(recorded.values()), metadata, wanted.compression
    )
    for one, answering in serving:
        for name, data in answering.held.items():  # what acts from the first sample on
            recorder.write(one.topics.resolved(name), data, now())
    return directory
