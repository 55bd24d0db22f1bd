"""Anything may arrive, and anything may stand in a file: the short form of the fuzzing."""

import random

import pytest
from fuzzing import Served, parameter_file, reading
from hypothesis import given, settings
from hypothesis import strategies as st
from paths import CONFIG

from cylconn_ros.scene.documentation import example

FILES = sorted(CONFIG.glob("*.yaml"))


@settings(max_examples=400, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_are_a_message_or_refused(data):
    reading(data)


@pytest.fixture(scope="module")
def served():
    return Served()


@settings(max_examples=200, deadline=None)
@given(data=st.binary(max_size=400))
def test_whatever_arrives_nothing_fails_and_every_wrench_is_finite(served, data):
    served.serve(data)


_WORDS = """.nan .inf -.inf 1e308 -1 0 [] {} ~ true null 'x' [1,2] {a:1} &a *a ! !!python/object:
- : # 0x10 1_000 00 1e-400 '' /** ros__parameters \0 é"""
WORDS = st.sampled_from(_WORDS.split())


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_damaged_parameter_file_is_refused_in_words_or_read(tmp_path_factory, data):
    lines = data.draw(st.sampled_from(FILES)).read_text().splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(lines) - 1))
        name, colon, _ = lines[at].partition(":")
        change = data.draw(st.sampled_from(["value", "drop", "twice", "indent", "cut"]))
        if change == "value":
            lines[at] = f"{name}{colon} {data.draw(WORDS)}"
        elif change == "drop" and len(lines) > 1:
            del lines[at]
        elif change == "twice":
            lines.insert(at, lines[at])
        elif change == "indent":
            lines[at] = "  " + lines[at]
        else:
            lines[at] = lines[at][: data.draw(st.integers(0, len(lines[at])))]
    parameter_file("\n".join(lines), tmp_path_factory.mktemp("files"))


@settings(max_examples=100, deadline=None)
@given(text=st.text(max_size=200))
def test_any_text_is_no_parameter_file_or_one(tmp_path_factory, text):
    parameter_file(text, tmp_path_factory.mktemp("files"))


def test_the_example_with_any_one_value_changed(tmp_path):
    chance = random.Random(3)
    lines = example().splitlines()
    places = [k for k, line in enumerate(lines) if ": " in line]
    for value in (".nan", ".inf", "-1.0", "[]", "x", "1e308", "[.nan, .nan, .nan]", "true"):
        for k in chance.sample(places, 25):
            changed = list(lines)
            changed[k] = changed[k].split(": ")[0] + f": {value}"
            parameter_file("\n".join(changed), tmp_path)
