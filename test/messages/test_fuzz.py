"""Random messages and parameter files with hypothesis: the short form of scripts/fuzz.py."""

import random

import pytest
from fuzzing import PipelineUnderTest, check_decoders, check_parameter_file
from hypothesis import given, settings
from hypothesis import strategies as st
from paths import CONFIG

from cylconn_ros.scene.documentation import example

FILES = sorted(CONFIG.glob("*.yaml"))


@settings(max_examples=400)
@given(st.binary(max_size=300))
def test_any_bytes_are_decoded_or_raise_cdr_error(data):
    check_decoders(data)


@pytest.fixture(scope="module")
def pipeline():
    return PipelineUnderTest()


@settings(max_examples=200)
@given(data=st.binary(max_size=400))
def test_no_message_makes_the_pipeline_fail_and_every_wrench_is_finite(pipeline, data):
    pipeline.process(data)


_VALUES = """.nan .inf -.inf 1e308 -1 0 [] {} ~ true null 'x' [1,2] {a:1} &a *a ! !!python/object:
- : # 0x10 1_000 00 1e-400 '' /** ros__parameters \0 é"""
VALUES = st.sampled_from(_VALUES.split())


@settings(max_examples=150)
@given(data=st.data())
def test_a_damaged_parameter_file_is_read_or_raises_scene_error(tmp_path_factory, data):
    lines = data.draw(st.sampled_from(FILES)).read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(lines) - 1))
        name, colon, _ = lines[at].partition(":")
        change = data.draw(st.sampled_from(["value", "drop", "twice", "indent", "cut"]))
        if change == "value":
            lines[at] = f"{name}{colon} {data.draw(VALUES)}"
        elif change == "drop" and len(lines) > 1:
            del lines[at]
        elif change == "twice":
            lines.insert(at, lines[at])
        elif change == "indent":
            lines[at] = "  " + lines[at]
        else:
            lines[at] = lines[at][: data.draw(st.integers(0, len(lines[at])))]
    check_parameter_file("\n".join(lines), tmp_path_factory.mktemp("files"))


@settings(max_examples=100)
@given(text=st.text(max_size=200))
def test_any_text_is_read_or_raises_scene_error(tmp_path_factory, text):
    check_parameter_file(text, tmp_path_factory.mktemp("files"))


def test_the_example_with_any_one_value_changed(tmp_path):
    generator = random.Random(3)
    lines = example().splitlines()
    lines_with_value = [k for k, line in enumerate(lines) if ": " in line]
    for value in (".nan", ".inf", "-1.0", "[]", "x", "1e308", "[.nan, .nan, .nan]", "true"):
        for k in generator.sample(lines_with_value, 25):
            changed = list(lines)
            changed[k] = changed[k].split(": ")[0] + f": {value}"
            check_parameter_file("\n".join(changed), tmp_path)
