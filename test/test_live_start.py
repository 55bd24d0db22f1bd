"""Starting a node: what cannot be used is refused in one plain line, and help is given."""

import pytest
from ros_processes import installed, module, parameters, program

REFUSED = [
    (["-p", "period:=-1"], "period = -1: must be a number >= 0 s"),
    (["-p", "friction.coefficient:=0.1"], "friction.radius = .nan: must be given with friction"),
    (["-p", "fricton.radius:=1"], "did you mean friction.radius?"),
    (["-p", "gravity:=[0, 0, x]"], "gravity = [0, 0, 'x']: must be 3 numbers"),
    (["-p", "gravity:=[0, 0"], "gravity = [0, 0: line 1"),
    (["--params-file", "missing.yaml"], "missing.yaml: cannot be read"),
    (["-p"], "-p: a value must follow"),
    (["-r", "__node:=not a name"], "not a name"),
    (["--", "--verbose"], "--verbose: not understood"),
]


@pytest.mark.parametrize(
    ("name", "arguments", "text"),
    [("connector", *case) for case in REFUSED] + [("plant", *case) for case in REFUSED[:2]],
)
def test_wrong_use_is_refused_in_one_plain_line(name, arguments, text, installed_prefix, tmp_path):
    command = [*installed(installed_prefix, name), *parameters(), *arguments]
    with program(command, tmp_path) as running:
        assert running.wait() == 2
        assert running.lines[-1].startswith(f"{name}: ")
        assert text in running.lines[-1]
        assert "Traceback" not in running.output


def test_nothing_given_says_what_is_needed(tmp_path):
    with program(module("connector_node"), tmp_path) as running:
        assert running.wait() == 2
        assert running.output == (
            "connector: node_a.orientation: is required and not given; "
            "must be 4 numbers x, y, z, w, finite"
        )


@pytest.mark.parametrize("name", ["connector", "plant"])
def test_help(name, installed_prefix, tmp_path):
    with program([*installed(installed_prefix, name), "--help"], tmp_path) as running:
        assert running.wait() == 0
        assert running.output.startswith(f"usage: {name} ")
