"""Encoded diagnostics: ROS decodes them to the same content, cached strings included."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st
from pipelines import Loop, make
from rclpy.serialization import deserialize_message, serialize_message
from ros_processes import reported

from cylconn_ros.core import layout
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.ros import qos
from cylconn_ros.ros.connector.diagnostics import ERROR, OK, WARN, ConnectionStatus, Monitor
from cylconn_ros.ros.connector.diagnostics_encoder import StatusEncoder, encode_diagnostics
from cylconn_ros.ros.connector.recorder import Recorder

texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
values = st.integers() | st.floats() | texts
STAMP = 7_000_000_009


@given(
    names=st.lists(texts, max_size=4),
    keys=st.lists(texts, min_size=1, max_size=5, unique=True),
    data=st.data(),
)
def test_ros_decodes_what_was_encoded(names, keys, data):
    encoders = [StatusEncoder(name, "hardware") for name in names]
    for _ in range(3):  # from the second on, unchanged strings come from the cache
        array = DiagnosticArray()
        array.header.stamp = Time(sec=7, nanosec=9)
        parts = []
        for name, encoder in zip(names, encoders, strict=True):
            level, message = data.draw(st.sampled_from((OK, WARN, ERROR))), data.draw(texts)
            pairs = {key: data.draw(values) for key in keys}
            parts.append(encoder.encode(level, message, pairs))
            status = DiagnosticStatus(level=bytes([level]), name=name, message=message)
            status.hardware_id = "hardware"
            status.values = [KeyValue(key=key, value=str(value)) for key, value in pairs.items()]
            array.status.append(status)
        encoded = encode_diagnostics(STAMP, parts)
        assert len(encoded) == len(serialize_message(array))  # padding may differ in content
        assert deserialize_message(encoded, DiagnosticArray) == array


def test_equal_values_with_different_texts_are_encoded_again():
    encoder = StatusEncoder("a", "b")
    for value in (0, 0.0, -0.0, False, "0", 1, True):
        (status,) = deserialize_message(
            encode_diagnostics(0, [encoder.encode(OK, "", {"c": value})]), DiagnosticArray
        ).status
        assert status.values[0].value == str(value)


def test_invalid_unicode_is_replaced():
    part = StatusEncoder("a", "b").encode(OK, "\ud800", {"c": "\udfff"})
    (status,) = deserialize_message(encode_diagnostics(0, [part]), DiagnosticArray).status
    assert (status.message, status.values[0].value) == ("?", "?")


def test_names_and_keys_of_the_parts():
    loop = Loop(make())
    monitor = Monitor("connector/front")
    for _ in range(2):
        loop.step()
        statuses = reported(monitor, loop.pipeline, Recorder(), ConnectionStatus(state="active"))
        assert [status.name for status in statuses] == [
            f"connector/front: {part}" for part in ("samples", "solution", "topics", "recording")
        ]
        assert {status.hardware_id for status in statuses} == {"connector/front"}
        assert [ord(status.level) for status in statuses] == [OK] * 4
    samples, solution, topics, recording = (
        {pair.key: pair.value for pair in status.values} for status in statuses
    )
    assert samples["samples processed"] == "2"
    assert solution["regime"] in ("stick", "slip", "frictionless")
    assert topics["body_b/pose messages"] == "2"
    assert recording["recording"] == "no"


def sample_message(pipeline, monitor):
    return reported(monitor, pipeline, None, ConnectionStatus(state="active"))[0].message


@pytest.mark.parametrize(
    ("topic", "encoder", "text"),
    [
        (
            "body_b/twist",
            StampedWriter("map"),
            "body_b/twist: unknown frame_id 'map' (expected 'world' or 'body_b'); "
            "treated as world axes",
        ),
        (
            "body_a/pose",
            StampedWriter("body_a", 7),
            "body_a/pose: unknown frame_id 'body_a' (expected 'world'); treated as world axes",
        ),
    ],
)
def test_unknown_frame_id_is_named(topic, encoder, text):
    loop, monitor = Loop(make()), Monitor("c")
    values = np.array([0.0] * 6 + [1.0])
    size = 7 if topic.endswith("pose") else 6
    loop.pipeline.inputs[topic].receive(encoder.write(1, values[-size:]))
    assert text in sample_message(loop.pipeline, monitor)
    assert text not in sample_message(loop.pipeline, monitor)  # nothing new


def test_twist_that_does_not_match_the_poses_is_diagnosed():
    loop, monitor = Loop(make()), Monitor("c")
    loop.step()
    loop.plant.state[layout.B_TWIST] += 5.0
    loop.step()
    solution = reported(monitor, loop.pipeline, None, ConnectionStatus(state="active"))[1]
    assert "body_a, body_b: twist does not match pose differences" in solution.message
    assert ord(solution.level) == WARN


def test_incompatible_qos_names_policy_and_remedy():
    text = qos.incompatible("/body_b/pose", "reliability", is_input=True)
    assert text.startswith("/body_b/pose: a peer's QoS is incompatible (reliability); publish")
    text = qos.incompatible("/body_b/wrench", "durability", is_input=False)
    assert "(durability); request no more than RELIABLE, VOLATILE" in text
