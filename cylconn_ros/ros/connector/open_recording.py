"""Open one recorded run for all connectors of a node: topics and metadata."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from rclpy.node import Node

from cylconn_ros import __version__
from cylconn_ros.errors import RecordingError
from cylconn_ros.messages.topic_names import prefix_log
from cylconn_ros.ros.connector.endpoint import ConnectorEndpoint
from cylconn_ros.ros.connector.recorder import Recorder, now
from cylconn_ros.scene.outputs import Record
from cylconn_ros.scene.parameter_file import dump_several


def open_recording(
    recorder: Recorder, node: Node, wanted: Record, endpoints: Sequence[ConnectorEndpoint]
) -> Path:
    """Start a recording; return its directory. Raises RecordingError if it cannot be started."""
    open_ones = [(one, one.pipeline) for one in endpoints if one.pipeline is not None]
    if not open_ones:
        raise RecordingError(f"the node is {endpoints[0].status.state}: nothing to record")
    connectors = {
        one.name: {
            "method": pipeline.connector.method,
            "model": pipeline.connector.model,
            "topics": one.topics.resolved_names(pipeline),
            "together": ", ".join(other.name for other in one.partners if other is not one),
        }
        for one, pipeline in open_ones
    }
    metadata = {
        "version": __version__,
        "node": node.get_fully_qualified_name(),
        "method": ", ".join(dict.fromkeys(pipeline.connector.method for _, pipeline in open_ones)),
        "model": "; ".join(
            prefix_log(one.name, pipeline.connector.model) for one, pipeline in open_ones
        ),
        "parameters": dump_several(
            {one.name: pipeline.commands.scene_in_force for one, pipeline in open_ones}
        ),
        "samples_before": str(sum(one.remembered for one in endpoints)),  # 0: can be replayed
        "connectors": json.dumps(connectors),
    }
    topics = {
        info.name: info
        for one, pipeline in open_ones
        for info in one.topics.recorded_topics(pipeline)
    }
    directory = recorder.start(
        wanted.directory, node.get_name(), list(topics.values()), metadata, wanted.compression
    )
    for one, pipeline in open_ones:
        for name, data in pipeline.loads.current(pipeline.matcher.last_stamp):
            recorder.write(one.topics.resolved(name), data, now())
    return directory
