"""Encoded diagnostics: ROS decodes them to the same content, cached strings included."""

from typing import Any

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
from cylconn_ros.messages import statistics
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.ros import qos
from cylconn_ros.ros.connector.diagnostics import ConnectionStatus, Monitor
from cylconn_ros.ros.connector.diagnostics_encoder import StatusEncoder, encode_diagnostics
from cylconn_ros.ros.connector.problems import ERROR, OK, WARN, latency_problem
from cylconn_ros.ros.connector.recorder import Recorder

texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
values = st.integers() | st.floats() | texts
STAMP = 7_000_000_009
MS = 1_000_000


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
            "body_b/twist: unknown frame_id 'map', expected 'world' or 'body_b'; treated as world "
            "axes",
        ),
        (
            "body_a/pose",
            StampedWriter("body_a", 7),
            "body_a/pose: unknown frame_id 'body_a', expected 'world'; treated as world axes",
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


def report(pipeline, monitor):
    """Parts of a report by name, and the lines for the log."""
    statuses = reported(monitor, pipeline, None, ConnectionStatus(state="active"))
    return {s.name.partition(": ")[2]: s for s in statuses}, monitor.take_log()


def send(pipeline, stamp, velocity, position=0.0, orientation=(0, 0, 0, 1)):
    """Receive a sample of body B, moving along x (or along the given vectors)."""
    position, velocity = (
        [value, 0.0, 0.0] if np.isscalar(value) else [*value] for value in (position, velocity)
    )
    receive = pipeline.inputs
    pose, twist = [*position, *orientation], [*velocity, 0.0, 0.0, 0.0]
    receive["body_b/pose"].receive(StampedWriter("world", 7).write(stamp, np.array(pose, float)))
    receive["body_b/twist"].receive(StampedWriter("world").write(stamp, np.array(twist, float)))


def fixed_shaft(**changes):
    """A pipeline: body A fixed, body B free on it."""
    return Loop(make(body_a={"frame": "body_a"}, period=0.01, **changes)).pipeline


@pytest.mark.parametrize("latency", [0, 1, -1])
@pytest.mark.parametrize(
    ("velocity", "text"),
    [
        (
            2.0,
            "body_b/twist does not match the pose differences (ratio 2.0, expected 1.0): check its "
            "units and its reference point",
        ),
        (
            (0.0, 1.0, 0.0),
            "body_b/twist does not match the pose differences (ratio 1.0, expected 1.0, directions "
            "90 deg apart): check its axes (frame_id, twist_axes)",
        ),
    ],
)
def test_twist_that_does_not_match_the_poses_is_reported_with_its_ratio(velocity, text, latency):
    pipeline, monitor = fixed_shaft(latency=latency), Monitor("c")
    lines = []
    for k in range(1, 8):  # moves by 1 m/s
        send(pipeline, k * 10 * MS, velocity, 0.01 * k)
        parts, new = report(pipeline, monitor)
        lines += [line for _, line in new if "does not match" in line]
    assert text in parts["solution"].message
    assert ord(parts["solution"].level) == WARN
    assert lines == [f"c: solution: {text}"]  # once
    monitor.forget()
    send(pipeline, 80 * MS, velocity, 0.08)
    assert (WARN, f"c: solution: {text}") in report(pipeline, monitor)[1]


def test_the_integration_of_the_simulator_is_named_with_the_remedy():
    pipeline, monitor = fixed_shaft(), Monitor("c")
    position = 0.0
    for k in range(1, 40):
        position += 0.01 * (0.1 * k)  # h v+
        send(pipeline, k * 10 * MS, 0.1 * k, position)
    parts, lines = report(pipeline, monitor)
    text = "this simulator integrates semi-implicitly: set plant_integration: semi_implicit"
    assert parts["solution"].message == f"{text} (now exact)"
    assert (WARN, f"c: solution: {text} (now exact)") in lines


UNUSABLE: list[tuple[dict[str, Any], int, str]] = [
    ({"velocity": np.nan}, ERROR, "body_b/twist is not finite (expected finite numbers)"),
    ({"position": np.inf}, ERROR, "body_b/pose is not finite (expected finite numbers)"),
    (
        {"position": -2e17},
        ERROR,
        "body_b/pose has the value -2e+17 (expected less than 1e+15): commanding zero "
        "wrench; the simulation has diverged",
    ),
    (
        {"orientation": (0, 0, 0, 1.02)},
        WARN,
        "body_b/pose: orientation has norm 1.02 (expected 1), normalised; publish unit quaternions",
    ),
    (
        {"orientation": (0, 0, 0, 0)},
        ERROR,
        "body_b/pose: orientation cannot be normalised (length 0, expected 1)",
    ),
]


def test_unusable_numbers_are_named():
    pipeline, monitor = fixed_shaft(), Monitor("c")
    send(pipeline, 10 * MS, 0.0)
    for k, (motion, level, text) in enumerate(UNUSABLE, 2):
        send(pipeline, k * 10 * MS, **{"velocity": 0.0, **motion})
        parts, lines = report(pipeline, monitor)
        assert text in parts["samples"].message
        assert ord(parts["samples"].level) == level
        assert [line for _, line in lines if text in line], lines
        send(pipeline, k * 10 * MS + 5 * MS, 0.0)
        assert text not in report(pipeline, monitor)[0]["samples"].message  # withdrawn
    assert pipeline.health.off_norm == (0, 1)
    assert (pipeline.health.not_finite, pipeline.health.too_large) == (2, 1)
    send(pipeline, 100 * MS, 0.0, orientation=(0, 0, 0, 1.004))
    assert pipeline.health.off_norm == (0, 1)  # less than 0.5 %


def test_an_overflow_of_finite_inputs_is_not_called_not_finite():
    pipeline, monitor = fixed_shaft(), Monitor("c")
    out = np.zeros(layout.NOUT)
    out[layout.STATUS] = layout.NOT_FINITE
    send(pipeline, 10 * MS, 0.0)
    statistics.count_one(pipeline.health.numbers, pipeline.matcher.sample, out, 0.01, 0.01)
    parts, _ = report(pipeline, monitor)
    assert parts["samples"].message.startswith("the forces of finite inputs are too large")
    assert pipeline.health.not_finite == 0


def test_a_message_that_cannot_be_decoded_is_named():
    pipeline, monitor = fixed_shaft(), Monitor("c")
    pipeline.inputs["body_b/load"].receive(b"")
    parts, lines = report(pipeline, monitor)
    text = "body_b/load: encapsulation missing is not plain CDR: the message cannot be decoded"
    assert parts["samples"].message == f"{text}, ignored"
    assert (ERROR, f"c: samples: {text}, ignored") in lines
    assert pipeline.health.undecodable == 1


class MeasuredLatency:
    """A connector whose latency is measured, beside a declared one if that is not -1."""

    def __init__(self, latency, spread, declared=-1):
        self.measured_latency, self.latency_spread = latency, spread
        self.scene = make(latency=declared, period=0.002)
        self.period = self.scene.period


@pytest.mark.parametrize(
    ("latency", "spread", "before", "expected"),
    [
        (1.02, 0.1, 1.0, (WARN, "1.0 samples (2.0 ms) after their sample: set latency: 1")),
        (0.4, 0.1, 0.4, (OK, "0.4 samples (0.8 ms) after their sample, with a spread of 0.1")),
        (2.0, 0.9, 2.0, (OK, "2.0 samples (4.0 ms) after their sample, with a spread of 0.9")),
        (20.0, 0.0, 20.0, (OK, "20.0 samples (40.0 ms) or more after their sample, the greatest")),
        (1.0, 0.1, 0.0, None),
        (0.0, 0.0, 0.0, None),
    ],
)
def test_the_measured_latency_is_reported_with_the_remedy(latency, spread, before, expected):
    connector: Any = MeasuredLatency(latency, spread)
    found = list(latency_problem(connector, before))
    if expected is None:
        assert found == []
    else:
        assert [problem.level for problem in found] == [expected[0]]
        assert found[0].text.startswith(f"wrenches act {expected[1]}")


USED = "after their sample; the measured latency is used"


@pytest.mark.parametrize(
    ("declared", "latency", "before", "remedy"),
    [
        (1, 0.0, 0.0, f"act 0.0 samples (0.0 ms) {USED}: set latency: 0"),
        (1, 2.5, 2.5, f"act 2.5 samples (5.0 ms) {USED}: set latency: -1, which"),
        (0, 3.0, 3.0, "act 3.0 samples (6.0 ms) after their sample: set latency: 3"),
        (1, 1.3, 1.3, "act 1.3 samples (2.6 ms) after their sample: set latency: -1, which"),
        (1, 1.05, 1.0, None),
        (1, 2.5, None, None),
        (1, None, None, None),
    ],
)
def test_a_declared_latency_that_is_refuted_is_reported_with_both(
    declared, latency, before, remedy
):
    connector: Any = MeasuredLatency(latency, 0.0, declared)
    found = list(latency_problem(connector, before))
    assert len(found) == (remedy is not None)
    if remedy is not None:
        assert found[0].level == WARN
        text = f"latency: {declared} is declared, but wrenches {remedy}"
        assert found[0].text.startswith(text)


def test_a_latency_that_is_not_measured_is_unknown():
    parts, _ = report(fixed_shaft(latency=-1), Monitor("c"))
    values = {pair.key: pair.value for pair in parts["solution"].values}
    assert values["measured latency [samples]"] == "unknown"
    assert values["spread of the latency [samples]"] == "unknown"


@pytest.mark.parametrize("latency", [0, -1])
def test_uneven_stamps_of_an_even_motion_are_named(latency):
    """The wall clock gives stamps 8 or 12 ms apart; the body moves by the period of 10 ms."""
    pipeline, monitor = fixed_shaft(latency=latency), Monitor("c")
    stamp = 0
    for k in range(1, 30):
        stamp += (6 if k % 2 else 14) * MS
        send(pipeline, stamp, 1.0, 0.01 * k)
    parts, _ = report(pipeline, monitor)
    assert "stamps are 40 % off the period" in parts["solution"].message
    assert "does not match" not in parts["solution"].message


def test_incompatible_qos_names_policy_and_remedy():
    text = qos.incompatible("/body_b/pose", "reliability", is_input=True)
    assert text == (
        "/body_b/pose: a publisher is best_effort (expected reliable), its messages are not "
        "received; publish reliable, or set qos.reliability: best_effort"
    )
    text = qos.incompatible("/body_b/wrench", "durability", is_input=False)
    assert "(durability), it receives nothing; request no more than reliable, volatile" in text


def test_a_period_that_the_motion_refutes_is_reported_with_the_one_in_use():
    """Samples 20 ms apart of a body that moves by its twist times 20 ms; the period is 10 ms."""
    pipeline, monitor = fixed_shaft(), Monitor("c")
    for k in range(2):  # no motion is compared yet
        send(pipeline, k * 20 * MS, 1.0, 0.02 * k)
    first, _ = report(pipeline, monitor)
    assert "set period to the spacing of the stamps" in first["samples"].message
    for k in range(2, 8):
        send(pipeline, k * 20 * MS, 1.0, 0.02 * k)
    parts, lines = report(pipeline, monitor)
    expected = (
        "stamps are 0.02 s apart, period is 0.01 s, which the motion contradicts: wrenches are "
        "computed for 0.02 s; set period: 0.02, or 0.0 to take it from the stamps"
    )
    assert expected in parts["samples"].message
    assert (WARN, f"c: samples: {expected}") in lines
