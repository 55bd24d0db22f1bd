"""Start of a node: one-line errors for invalid arguments, help, and compiling."""

import os
import subprocess
import sys

import pytest
from ros_processes import installed, module, parameters, program

from cylconn_ros.errors import SceneError
from cylconn_ros.ros import run_node
from cylconn_ros.ros.connector import endpoint
from cylconn_ros.ros.connector import node as connector_node
from cylconn_ros.ros.plant import node as plant_node

MAINS = {"connector": connector_node.main, "plant": plant_node.main}
REFUSED = [
    (["-p", "period:=-1"], "period = -1: must be a number >= 0 s"),
    (["-p", "friction.coefficient:=0.1"], "friction.radius = .nan: must be given with friction"),
    (["-p", "fricton.radius:=1"], "did you mean friction.radius?"),
    (["-p", "gravity:=[0, 0, x]"], "gravity = [0, 0, 'x']: must be 3 numbers"),
    (["-p", "gravity:=[0, 0"], "gravity = [0, 0: line 1"),
    (["--params-file", "missing.yaml"], "missing.yaml: cannot be read"),
    (["-p"], "-p: a value must follow"),
    (["-r", "__node:=not a name"], "not a name"),
    (["--", "--verbose"], "--verbose: unknown argument"),
]


@pytest.mark.parametrize(
    ("name", "arguments", "text"),
    [("connector", *case) for case in REFUSED] + [("plant", *case) for case in REFUSED[:2]],
)
def test_invalid_arguments_are_refused_in_one_line(name, arguments, text, capfd):
    assert MAINS[name]([*parameters(), *arguments]) == 2
    printed = capfd.readouterr()
    line = printed.err.splitlines()[-1]
    assert line.startswith(f"{name}: ")
    assert text in line
    assert "Traceback" not in printed.err
    assert printed.out == ""


@pytest.mark.parametrize("name", ["connector", "plant"])
def test_installed_program_refuses_invalid_parameters_and_prints_help(
    name, installed_prefix, tmp_path
):
    command = installed(installed_prefix, name)
    with program([*command, *parameters("period:=-1")], tmp_path) as running:
        assert running.wait() == 2
        assert running.output == f"{name}: period = -1: must be a number >= 0 s, finite"
    with program([*command, "--help"], tmp_path) as running:
        assert running.wait() == 0
        assert running.output.startswith(f"usage: {name} ")


def test_missing_parameter_is_named(tmp_path):
    with program(module("connector.node"), tmp_path) as running:
        assert running.wait() == 2
        assert running.output == (
            "connector: node_a.orientation: is required and not given; "
            "must be 4 numbers x, y, z, w, finite"
        )


@pytest.mark.parametrize(
    ("name", "node", "physics"),
    [("connector", endpoint, "MessagePipeline"), ("plant", plant_node, "Plant")],
)
def test_compiling_is_announced(name, node, physics, monkeypatch, capfd):
    def fail(*_):
        raise SceneError("started")

    monkeypatch.setattr(node, physics, fail)
    monkeypatch.setattr(run_node, "is_ready", lambda _: False)
    assert MAINS[name](parameters()) == 2
    printed = capfd.readouterr()
    lines = (printed.out + printed.err).splitlines()
    assert "compiling the physics, once" in lines[0]
    assert lines[-1] == f"{name}: started"
    monkeypatch.setattr(run_node, "is_ready", lambda _: True)
    assert MAINS[name](parameters()) == 2
    printed = capfd.readouterr()
    assert "compiling" not in printed.out + printed.err


KERNEL = """
from cylconn_ros.core.jit import is_ready, kernel

@kernel
def step(x: float) -> float:
    return x + 1.0

print(is_ready(step), step(1.0), is_ready(step))
"""


def test_kernel_from_the_cache_is_ready(tmp_path):
    (tmp_path / "physics.py").write_text(KERNEL)
    environment = {**os.environ, "CYLCONN_CACHE_DIR": str(tmp_path / "cache")}
    for expected in ("False 2.0 True", "True 2.0 True"):
        done = subprocess.run(
            [sys.executable, "-c", "import physics"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.strip() == expected
