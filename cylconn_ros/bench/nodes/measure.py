"""What a sample costs as a node: ours, recording or not, beside a usual one and the least.

All contestants run at once, as processes that talk ROS 2, and one driver (bench/nodes/driver.py) asks
them in turns, so that a slow moment of the machine meets all of them. Ratios are formed within a
round. Delays are from the last message of a sample being sent to the last of three answers being
taken, with all that the driver itself costs; CPU time is that of the contestant's whole process.
"""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread
from cylconn_ros.scene.parameter_file import dump
from cylconn_ros.scene.scene import Scene

OURS, RECORDING, PLAIN, BARE = "connector", "connector, recording", "plain node", "bare forwarder"
_NAMES = {OURS: "ours", RECORDING: "recording", PLAIN: "plain", BARE: "bare"}  # spaces of topics
_DELAY, _TAIL, _CPU, _RATE, _LOST = "delay", "99 % within", "CPU time a step", "steps/s", "lost"
_RATES = {"at 500 samples/s": 500.0, "closed loop": 0.0, "at 2000 samples/s": 2000.0}
_SLOW, _CLOSED, _FAST = _RATES
SCENE = {
    "body_a": {"kind": "free", "mass": 3.0, "inertia": [0.02, 0.0, 0.0, 0.03, 0.0, 0.03]},
    "body_b": {"kind": "free", "mass": 2.0, "inertia": [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]},
    "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
    "friction": {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 5.0},
}

Rounds = list[dict[str, Any]]


def measure(settings: Settings, environment: Mapping[str, str]) -> Findings:
    """Start everything in ``environment`` (ROS: a domain of its own), ask in turns, sum up.

    Raises RuntimeError where a process ends too early.
    """
    rounds, samples = (2, 200) if settings.quick else (40, 300)
    found: dict[tuple[str, str], Rounds] = {(p, c): [] for p in _RATES for c in _NAMES}
    with tempfile.TemporaryDirectory() as name, _processes(Path(name), environment) as ask:
        for contestant in _NAMES:  # they meet, and compile where it is the first time
            ask(contestant, 200.0, 50)
        for k in range(rounds):
            for problem, rate in _RATES.items():
                for j in range(len(_NAMES)):
                    contestant = list(_NAMES)[(j + k) % len(_NAMES)]
                    found[problem, contestant].append(ask(contestant, rate, samples))
    return Findings(targets=_targets(found), measurements=list(_measurements(found)))


def _commands(folder: Path) -> dict[str, list[str]]:
    """The module of each contestant and its arguments."""
    scene = folder / "scene.yaml"
    scene.write_text(dump(Scene.from_parameters(SCENE)), encoding="utf-8")
    ros = {name: ["-r", f"__ns:=/{space}"] for name, space in _NAMES.items()}
    connector = ["cylconn_ros.ros.connector.node", "--ros-args", "--params-file", str(scene)]
    record = ["-p", "record.enabled:=true", "-p", f"record.directory:={folder / 'runs'}"]
    bench = "cylconn_ros.bench.nodes"
    return {
        OURS: [*connector, *ros[OURS]],
        RECORDING: [*connector, *ros[RECORDING], *record],
        PLAIN: [f"{bench}.plain_node", str(scene), "--ros-args", *ros[PLAIN]],
        BARE: [f"{bench}.forwarder", "--ros-args", *ros[BARE]],
    }


Ask = Callable[[str, float, int], dict[str, Any]]


@contextlib.contextmanager
def _processes(folder: Path, environment: Mapping[str, str]) -> Iterator[Ask]:
    """All contestants and the driver; what asks one for samples at a rate."""
    with contextlib.ExitStack() as stack:
        running = {
            name: stack.enter_context(process(_NAMES[name], command, folder, environment))
            for name, command in _commands(folder).items()
        }
        driver = ["cylconn_ros.bench.nodes.driver"]
        asking = stack.enter_context(process("driver", driver, folder, environment, talks=True))

        def ask(contestant: str, rate: float, samples: int) -> dict[str, Any]:
            assert asking.stdin is not None
            assert asking.stdout is not None
            task = {"name": _NAMES[contestant], "pid": running[contestant].pid, "rate": rate}
            asking.stdin.write(json.dumps({**task, "samples": samples}) + "\n")
            asking.stdin.flush()
            line = asking.stdout.readline()
            ended = [name for name, one in running.items() if one.poll() is not None]
            if ended or not line:
                name = ended[0] if ended else "driver"
                said = (
                    _log(folder, _NAMES.get(name, name))
                    .read_text(errors="replace")
                    .strip()
                    .splitlines()
                )
                last = said[-1] if said else "nothing was said"
                raise RuntimeError(f"{name} ended too early: {last}")
            return dict(json.loads(line))

        yield ask


def _log(folder: Path, name: str) -> Path:
    """Where a process' words go."""
    return folder / f"{name}.log"


@contextlib.contextmanager
def process(
    name: str,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    talks: bool = False,
) -> Iterator[subprocess.Popen[str]]:
    """A process, out of the terminal's reach, that does not outlive the block.

    ``command``: a module and its arguments. What it says goes to a log in ``folder``; where it
    ``talks``, its output is ours to read.
    """
    clean = {k: v for k, v in environment.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    with _log(folder, name).open("w") as log:
        started = subprocess.Popen(
            [sys.executable, "-m", *command],
            env=clean,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if talks else log,
            stderr=log,
            text=True,
            start_new_session=True,
        )
    try:
        yield started
    finally:
        for number in (signal.SIGINT, signal.SIGKILL):
            if started.poll() is None:
                started.send_signal(number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                started.communicate(timeout=10.0)
                break


def _value(block: Mapping[str, Any], quantity: str) -> float:
    if quantity in (_DELAY, _TAIL):
        delays = block["delays"]
        return float(delays[0 if quantity == _DELAY else 2]) if delays else float("nan")
    if quantity == _LOST:
        return float(block["sent"] - block["answered"])
    return float(block["cpu" if quantity == _CPU else "rate"])


def _values(rounds: Rounds, quantity: str) -> np.ndarray:
    return np.array([_value(block, quantity) for block in rounds])


def _targets(found: Mapping[tuple[str, str], Rounds]) -> list[Target]:
    """What was aimed at: medians of the ratios of each round."""

    def ratio(quantity: str, problem: str, of: str, to: str) -> float:
        return float(np.median(_values(found[problem, of], quantity)
                               / _values(found[problem, to], quantity)))  # fmt: skip

    targets = []
    for to, of, delay, cpu in (
        (PLAIN, OURS, 0.4, 0.3),
        (BARE, OURS, 1.3, 1.3),
        (OURS, RECORDING, 1.1, 1.1),
    ):
        for quantity, limit in ((_DELAY, delay), (_CPU, cpu)):
            value = ratio(quantity, _SLOW, of, to)
            targets.append(Target(f"{_SLOW}: {quantity}, {of} to {to}", value, limit, "1"))
    value = ratio(_RATE, _CLOSED, PLAIN, OURS)
    targets.append(Target(f"{_CLOSED}: {_RATE}, {PLAIN} to {OURS}", value, 0.25, "1"))
    for contestant in (OURS, RECORDING):
        blocks = found[_FAST, contestant]
        lost = _values(blocks, _LOST).sum()
        sent = sum(block["sent"] for block in blocks)
        note = f"of {sent} samples"
        targets.append(Target(f"{_FAST}: {_LOST}, {contestant}", float(lost), 0.0, "", note))
    return targets


def _measurements(found: Mapping[tuple[str, str], Rounds]) -> Iterator[Measurement]:
    for (problem, contestant), rounds in found.items():
        for quantity, unit, scale in (
            (_DELAY, "µs", 1e6),
            (_TAIL, "µs", 1e6),
            (_CPU, "µs", 1e6),
            (_RATE, "1/s", 1.0),
        ):
            spread = Spread.of(_values(rounds, quantity))
            yield Measurement.of(problem, contestant, quantity, spread, unit, scale=scale)
        lost = _values(rounds, _LOST).sum()
        yield Measurement(problem, contestant, _LOST, float(lost), "", count=len(rounds))
