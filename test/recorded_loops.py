"""Recorded runs of live loops, compared with the same loop in one process."""

import numpy as np
from paths import CONFIG
from ros_processes import parameters

from cylconn_ros.core import layout
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.recording.run import Run
from cylconn_ros.scene.scene import Scene

MS = 1_000_000


def scene_arguments(name: str, *rules: str) -> list[str]:
    path = str(CONFIG / f"{name}.yaml")
    return ["--ros-args", "--params-file", path, *parameters(*rules, least=False)[1:]]


def states(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Stamps, and the states as in OUT."""
    table = run.state
    columns = [np.reshape(table[name], (len(table), -1)) for name, _ in layout.STATE_FIELDS]
    return table.stamp, np.hstack(columns)


def assert_replayed(run: Run, scene: Scene) -> None:
    """Assert that the recorded inputs, processed again, give the recorded wrenches."""
    pipeline = MessagePipeline(scene)
    inputs = {run.topic(name.removeprefix("~/")): one for name, one in pipeline.inputs.items()}
    received = [
        (log_time, order, topic, data)
        for order, topic in enumerate(inputs)
        for log_time, _, data in run.raw(topic)
    ]
    responses = [inputs[topic].receive(data) for _, _, topic, data in sorted(received)]
    for body in ("a", "b"):
        recorded = [data for _, _, data in run.raw(run.topic(f"body_{body}/wrench"))]
        nonzero = [data for data in recorded if any(cdr_decoder.read_wrench(data).values)]
        assert nonzero == [
            getattr(response, f"wrench_{body}") for response in responses if response is not None
        ]
