"""Diagnostics as bytes: what ROS reads from them, whatever is said and was said before."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st
from pipelines import Loop, make
from rclpy.serialization import deserialize_message, serialize_message

from cylconn_ros.messages.pipeline import Answering
from cylconn_ros.ros.connector.diagnostics import ERROR, OK, WARN, Links, Monitor
from cylconn_ros.ros.connector.diagnostics_encoder import PartWriter, written
from cylconn_ros.ros.connector.recorder import Recorder

texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
values = st.integers() | st.floats() | texts
STAMP = 7_000_000_009


def reported(
    monitor: Monitor, answering: Answering | None, recorder: Recorder | None, links: Links
) -> list[DiagnosticStatus]:
    """What a monitor reports, as those see it who read the topic."""
    data = written(0, monitor.report(answering, recorder, links))
    return list(deserialize_message(data, DiagnosticArray).status)


@given(
    names=st.lists(texts, max_size=4),
    keys=st.lists(texts, min_size=1, max_size=5, unique=True),
    data=st.data(),
)
def test_what_is_written_is_what_ros_reads(names, keys, data):
    writers = [PartWriter(name, "hardware") for name in names]
    for _ in range(3):  # from the second on, what has not changed is as it was kept
        array = DiagnosticArray()
        array.header.stamp = Time(sec=7, nanosec=9)
        parts = []
        for name, writer in zip(names, writers, strict=True):
            level, message = data.draw(st.sampled_from((OK, WARN, ERROR))), data.draw(texts)
            pairs = {key: data.draw(values) for key in keys}
            parts.append(writer.write(level, message, pairs))
            status = DiagnosticStatus(level=bytes([level]), name=name, message=message)
            status.hardware_id = "hardware"
            status.values = [KeyValue(key=key, value=str(value)) for key, value in pairs.items()]
            array.status.append(status)
        ours, theirs = written(STAMP, parts), serialize_message(array)
        assert len(ours) == len(theirs)  # filling bytes, which theirs leave as they are, included
        assert deserialize_message(ours, DiagnosticArray) == array


def test_equal_values_that_are_other_texts_are_written_anew():
    writer = PartWriter("a", "b")
    for value in (0, 0.0, -0.0, False, "0", 1, True):
        (status,) = deserialize_message(
            written(0, [writer.write(OK, "", {"c": value})]), DiagnosticArray
        ).status
        assert status.values[0].value == str(value)


def test_what_is_no_text_is_written_all_the_same():
    part = PartWriter("a", "b").write(OK, "\ud800", {"c": "\udfff"})
    (status,) = deserialize_message(written(0, [part]), DiagnosticArray).status
    assert (status.message, status.values[0].value) == ("?", "?")


def test_parts_their_names_and_keys():
    loop = Loop(make())
    monitor = Monitor("connector/front")
    for _ in range(2):
        loop.step()
        statuses = reported(monitor, loop.answering, Recorder(), Links(state="active"))
        assert [status.name for status in statuses] == [
            f"connector/front: {part}" for part in ("samples", "solution", "topics", "recording")
        ]
        assert {status.hardware_id for status in statuses} == {"connector/front"}
        assert [ord(status.level) for status in statuses] == [OK] * 4
    samples, solution, topics, recording = (
        {pair.key: pair.value for pair in status.values} for status in statuses
    )
    assert samples["samples answered"] == "2"
    assert solution["regime"] in ("stick", "slip", "frictionless")
    assert topics["body_b/pose messages"] == "2"
    assert recording["recording"] == "no"
