"""Node benchmark: cost of a sample in the connector node, with and without recording.

Baselines are the same node written with rclpy's message objects and callbacks, and a node that
only forwards bytes. All nodes run at once as processes, and one load generator
(bench/nodes/load_generator.py) sends samples to them in turns. Ratios are formed within a round.
A delay is the time from sending the last message of a sample to taking the last of its three
outputs, including the cost of the load generator. CPU time is that of the node's whole process.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread, run_interleaved
from cylconn_ros.errors import ProcessError
from cylconn_ros.process.child import Child, module_command, node_command
from cylconn_ros.scene.parameter_file import dump
from cylconn_ros.scene.scene import Scene

CONNECTOR, RECORDING = "connector", "connector, recording"
RCLPY, FORWARDER = "plain node", "bare forwarder"
_NAMESPACES = {
    CONNECTOR: "connector",
    RECORDING: "recording",
    RCLPY: "rclpy",
    FORWARDER: "forwarder",
}
_DELAY, _TAIL, _CPU, _RATE, _LOST = "delay", "99 % within", "CPU time a step", "steps/s", "lost"
_RATES = {"at 500 samples/s": 500.0, "closed loop": 0.0, "at 2000 samples/s": 2000.0}
_SLOW, _CLOSED, _FAST = _RATES
SCENE = {
    "body_a": {"kind": "free", "mass": 3.0, "inertia": [0.02, 0.0, 0.0, 0.03, 0.0, 0.03]},
    "body_b": {"kind": "free", "mass": 2.0, "inertia": [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]},
    "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
    "friction": {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 5.0},
}

Turn = dict[str, Any]
"""Measurement of the load generator."""
Request = Callable[[str, float, int], Turn]
"""Sends a number of samples to a node at a rate (1/s; 0: closed loop)."""


def measure(settings: Settings, environment: Mapping[str, str]) -> Findings:
    """Start all nodes in ``environment`` (a ROS domain of its own) and measure them in turns.

    Raises ProcessError if a process ends early.
    """
    rounds, samples = (2, 200) if settings.quick else (40, 300)
    with tempfile.TemporaryDirectory() as name, _processes(Path(name), environment) as request:
        for node in _NAMESPACES:  # discovery, and compilation if the cache is empty
            request(node, 200.0, 50)
        turns = {
            (case, node): partial(request, node, rate, samples)
            for case, rate in _RATES.items()
            for node in _NAMESPACES
        }
        found = run_interleaved(turns, rounds)
    return Findings(targets=_targets(found), measurements=list(_measurements(found)))


def _commands(folder: Path) -> dict[str, list[str]]:
    """The command of each node."""
    scene = folder / "scene.yaml"
    scene.write_text(dump(Scene.from_parameters(SCENE)), encoding="utf-8")
    ros = {name: ("-r", f"__ns:=/{space}") for name, space in _NAMESPACES.items()}
    record = ("-p", "record.enabled:=true", "-p", f"record.directory:={folder / 'runs'}")
    here = "cylconn_ros.bench.nodes"
    return {
        CONNECTOR: node_command("connector", scene, *ros[CONNECTOR]),
        RECORDING: node_command("connector", scene, *ros[RECORDING], *record),
        RCLPY: module_command(f"{here}.rclpy_node", str(scene), "--ros-args", *ros[RCLPY]),
        FORWARDER: module_command(f"{here}.forwarder", "--ros-args", *ros[FORWARDER]),
    }


@contextlib.contextmanager
def _processes(folder: Path, environment: Mapping[str, str]) -> Iterator[Request]:
    """All nodes and the load generator."""
    with contextlib.ExitStack() as stack:
        nodes = {
            name: stack.enter_context(Child(name, command, environment, folder=folder))
            for name, command in _commands(folder).items()
        }
        command = module_command("cylconn_ros.bench.nodes.load_generator")
        load = stack.enter_context(Child("load generator", command, environment, json_lines=True))

        def request(node: str, rate: float, samples: int) -> Turn:
            task = {"name": _NAMESPACES[node], "pid": nodes[node].pid, "rate": rate}
            return request_while_running(load, {**task, "samples": samples}, nodes.values())

        yield request


def request_while_running(
    load: Child, task: Mapping[str, Any], nodes: Iterable[Child]
) -> dict[str, Any]:
    """Send a task to a load generator and return its measurement.

    Raises ProcessError if one of the nodes, or the load generator, ends early.
    """
    load.write(task)
    while True:
        found, failure = None, None
        try:
            found = load.read(timeout=1.0)
        except TimeoutError:
            pass
        except ProcessError as error:
            failure = error
        ended = next((node for node in nodes if not node.running), None)
        if ended is not None:
            raise ProcessError(f"{ended.name} ended early; {ended.last_words()}") from failure
        if failure is not None:
            raise failure
        if found is not None:
            return dict(found)


def _value(turn: Turn, quantity: str) -> float:
    if quantity in (_DELAY, _TAIL):
        delays = turn["delays"]
        return float(delays[0 if quantity == _DELAY else 2]) if delays else float("nan")
    if quantity == _LOST:
        return float(turn["sent"] - turn["received"])
    return float(turn["cpu" if quantity == _CPU else "rate"])


def _values(turns: Sequence[Turn], quantity: str) -> np.ndarray:
    return np.array([_value(turn, quantity) for turn in turns])


def _targets(found: Mapping[tuple[str, str], Sequence[Turn]]) -> list[Target]:
    """The targets: medians of the ratios of each round, and lost samples."""

    def ratio(quantity: str, case: str, of: str, to: str) -> float:
        return float(np.median(_values(found[case, of], quantity)
                               / _values(found[case, to], quantity)))  # fmt: skip

    targets = []
    for to, of, delay, cpu in (
        (RCLPY, CONNECTOR, 0.4, 0.3),
        (FORWARDER, CONNECTOR, 1.3, 1.3),
        (CONNECTOR, RECORDING, 1.1, 1.1),
    ):
        for quantity, limit in ((_DELAY, delay), (_CPU, cpu)):
            value = ratio(quantity, _SLOW, of, to)
            targets.append(Target(f"{_SLOW}: {quantity}, {of} to {to}", value, limit, "1"))
    value = ratio(_RATE, _CLOSED, RCLPY, CONNECTOR)
    targets.append(Target(f"{_CLOSED}: {_RATE}, {RCLPY} to {CONNECTOR}", value, 0.25, "1"))
    for node in (CONNECTOR, RECORDING):
        turns = found[_FAST, node]
        lost = _values(turns, _LOST).sum()
        note = f"of {sum(turn['sent'] for turn in turns)} samples"
        targets.append(Target(f"{_FAST}: {_LOST}, {node}", float(lost), 0.0, "", note))
    return targets


def _measurements(found: Mapping[tuple[str, str], Sequence[Turn]]) -> Iterator[Measurement]:
    for (case, node), turns in found.items():
        for quantity, unit, scale in (
            (_DELAY, "µs", 1e6),
            (_TAIL, "µs", 1e6),
            (_CPU, "µs", 1e6),
            (_RATE, "1/s", 1.0),
        ):
            spread = Spread.of(_values(turns, quantity))
            yield Measurement.of(case, node, quantity, spread, unit, scale=scale)
        lost = _values(turns, _LOST).sum()
        yield Measurement(case, node, _LOST, float(lost), "", count=len(turns))
