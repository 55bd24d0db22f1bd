"""Benchmark of many connectors in one process: cost of a sample with 1, 10 and 100 of them.

One process serves N connectors, each with its own topics, and a load generator
(bench/nodes/many_connectors_load.py) sends their samples on schedule. In the first case the rate of
each connector is the same, so N times as many samples arrive. In the second case the total rate is
the same, so a higher cost of a sample is due to the number of connectors alone. The last case is
the capacity of two cores, including the load generator.

CPU time is that of the whole serving process, including the middleware and diagnostics. A sample is
lost if its wrenches have not arrived 2 s after the last sample was sent.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread, run_interleaved
from cylconn_ros.bench.nodes.measure import SCENE, Turn, request_while_running
from cylconn_ros.process.child import Child, module_command, node_command
from cylconn_ros.scene.parameter_file import dump_several
from cylconn_ros.scene.scene import several

_DELAY, _TAIL, _CPU = "delay", "99 % within", "CPU time a sample"
_CLIENT_CPU = "CPU time of the load generator"
_LOST = "lost"
_NUMBERS = (1, 10, 100)
_RATE, _TOTAL_RATE = 100.0, 1000.0  # samples/s: of each connector, of all together
_TIMEOUT = 1.0  # s; the slowest schedule sends every 0.1 s, which is the parameter's default
_SAME, _SHARED = f"{_RATE:g} samples/s each", f"{_TOTAL_RATE:g} samples/s in total"
_CAPACITY = "capacity of two cores, load generator included"
_FIXED, _FREE = ("body_b",), ("body_a", "body_b")  # the moving bodies


class Capacity(NamedTuple):
    """A load that two cores have to sustain: N connectors at a rate (1/s), with moving bodies."""

    number: int
    rate: float
    moving: tuple[str, ...]

    @property
    def description(self) -> str:
        """One line."""
        bodies = "A fixed" if self.moving == _FIXED else "both bodies free"
        return f"{self.number} at {self.rate:g} Hz, {bodies}"


_CAPACITIES = [Capacity(n, r, m) for n, r in ((100, 100.0), (10, 1000.0)) for m in (_FIXED, _FREE)]


def measure(settings: Settings, environment: Mapping[str, str]) -> Findings:
    """Start all processes in ``environment`` (a ROS domain of its own) and measure them in turns.

    Raises ProcessError if a process ends early.
    """
    rounds, seconds = (2, 0.5) if settings.quick else (5, 3.0)
    found = Findings()
    with _processes(environment, _FIXED, _NUMBERS) as request:
        for case, total in ((_SAME, 0.0), (_SHARED, _TOTAL_RATE)):
            turns = {}
            for n in _NUMBERS:
                rate = total / n if total else _RATE
                turns[n] = partial(request, n, rate, max(2, round(seconds * rate)))
            run_interleaved(turns, 1)  # discovery and warm-up
            results = run_interleaved(turns, rounds)
            names = {f"{n} connector{'s' if n != 1 else ''}": results[n] for n in _NUMBERS}
            found.measurements += _measurements(case, names)
            found.targets += _growth(case, results)
    sustained: dict[str, list[Turn]] = {}
    for moving in (_FIXED, _FREE):
        loads = [load for load in _CAPACITIES if load.moving == moving]
        with _processes(environment, moving, sorted({load.number for load in loads})) as request:
            for load in loads:
                request(load.number, 20.0, 10)
            sustained |= run_interleaved(
                {
                    load.description: partial(
                        request, load.number, load.rate, round(2.0 * seconds * load.rate)
                    )
                    for load in loads
                },
                rounds,
            )
    found.measurements += _measurements(_CAPACITY, sustained)
    found.targets += [_nothing_lost(name, turns) for name, turns in sustained.items()]
    return found


Request = Callable[[int, float, int], Turn]
"""Sends samples to each of N connectors at a rate (1/s)."""


@contextlib.contextmanager
def _processes(
    environment: Mapping[str, str], moving: tuple[str, ...], numbers: Sequence[int]
) -> Iterator[Request]:
    """A serving process for each number of connectors, and the load generator."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        serving = {}
        for n in numbers:
            scene = folder / f"{n}.yaml"
            scene.write_text(_scenes(n, moving), encoding="utf-8")
            command = node_command("connector", scene, "-r", f"__node:=of_{n}")
            child = Child(f"the node of {n} connectors", command, environment, folder=folder)
            serving[n] = stack.enter_context(child)
        command = module_command("cylconn_ros.bench.nodes.many_connectors_load")
        load = stack.enter_context(Child("load generator", command, environment, json_lines=True))

        def request(n: int, rate: float, samples: int) -> Turn:
            task = {"names": _names(n), "moving": moving, "pid": serving[n].pid, "rate": rate}
            return request_while_running(load, {**task, "samples": samples}, serving.values())

        yield request


def _names(n: int) -> list[str]:
    return [f"of{n}n{k}" for k in range(n)]


def _scenes(n: int, moving: tuple[str, ...]) -> str:
    """Parameter file of N equal connectors."""
    scene: dict[str, Any] = {"connectors": _names(n), "timeout": _TIMEOUT, **SCENE}
    if moving == _FIXED:
        scene["body_a"] = {"kind": "fixed"}
    return dump_several(several(scene))


def _values(turns: Sequence[Turn], quantity: str) -> np.ndarray:
    def value(turn: Turn) -> float:
        if quantity in (_DELAY, _TAIL):
            return float(turn["delays"][quantity == _TAIL]) if turn["delays"] else float("nan")
        if quantity == _LOST:
            return float(turn["sent"] - turn["received"])
        return float(turn["cpu" if quantity == _CPU else "own_cpu"])

    return np.array([value(turn) for turn in turns])


def _growth(case: str, results: Mapping[int, Sequence[Turn]]) -> Iterator[Target]:
    """Cost of a sample with N connectors relative to one, within a round."""
    for n in _NUMBERS[1:]:
        ratio = float(np.median(_values(results[n], _CPU) / _values(results[1], _CPU)))
        yield Target(f"{case}: {_CPU}, {n} connectors to 1", ratio, 1.0, "1")


def _nothing_lost(name: str, turns: Sequence[Turn]) -> Target:
    sent = sum(turn["sent"] for turn in turns)
    cores = float(np.median([turn["cpu"] * turn["rate"] for turn in turns]))
    client = float(np.median([turn["own_cpu"] * turn["rate"] for turn in turns]))
    note = f"of {sent} samples; node {cores:.2f} cores, load generator {client:.2f}"
    return Target(f"{name}: {_LOST}", float(_values(turns, _LOST).sum()), 0.0, "", note)


def _measurements(case: str, results: Mapping[str, Sequence[Turn]]) -> Iterator[Measurement]:
    for name, turns in results.items():
        for quantity in (_DELAY, _TAIL, _CPU, _CLIENT_CPU):
            spread = Spread.of(_values(turns, quantity))
            yield Measurement.of(case, name, quantity, spread, "µs", scale=1e6)
        lost = float(_values(turns, _LOST).sum())
        yield Measurement(case, name, _LOST, lost, "", count=len(turns))
