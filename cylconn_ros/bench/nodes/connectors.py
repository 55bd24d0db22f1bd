"""Many connectors in one process: what a sample costs with 1, 10 and 100 of them, and what holds.

A process serves N connectors, each with topics of its own, and another (bench/nodes/many_clients.py) sends
their samples in time. Once with the rate of each connector the same, so that N times as many
samples come; once with as many samples in all, from N connectors, so that what a sample costs more
is due to their number alone. Then how much two cores hold, who asks included.

CPU time is that of the whole serving process, middleware and diagnostics with it. A sample is lost
where a wrench that answers it has not come 2 s after the last was sent.
"""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread
from cylconn_ros.bench.nodes.measure import SCENE, process
from cylconn_ros.scene.parameter_file import dump_several
from cylconn_ros.scene.scene import several

_DELAY, _TAIL, _CPU, _ASKING = "delay", "99 % within", "CPU time a sample", "CPU time who asks"
_LOST = "lost"
_NUMBERS = (1, 10, 100)
_RATE, _ALL = 100.0, 1000.0  # samples a second: of each connector, of all together
_TIMEOUT = 1.0  # s; some are asked every 0.1 s, which is what it is by default
_SAME, _SHARED = f"{_RATE:g} samples/s each", f"{_ALL:g} samples/s in all"
_FIXED, _FREE = ("body_b",), ("body_a", "body_b")  # who moves

Block = dict[str, Any]


class Load(NamedTuple):
    """What is to hold: N connectors at a rate each, with these bodies moving."""

    number: int
    rate: float
    moving: tuple[str, ...]

    @property
    def words(self) -> str:
        """One line."""
        bodies = "A fixed" if self.moving == _FIXED else "both bodies free"
        return f"{self.number} at {self.rate:g} Hz, {bodies}"


_LOADS = [Load(n, r, m) for n, r in ((100, 100.0), (10, 1000.0)) for m in (_FIXED, _FREE)]


def measure(settings: Settings, environment: Mapping[str, str]) -> Findings:
    """Start everything in ``environment`` (ROS: a domain of its own), ask in turns, sum up.

    Raises RuntimeError where a process ends too early.
    """
    rounds, seconds = (2, 0.5) if settings.quick else (5, 3.0)
    found = Findings()
    with _asking(environment, _FIXED, _NUMBERS) as ask:
        for problem, whole in ((_SAME, 0.0), (_SHARED, _ALL)):
            blocks: dict[int, list[Block]] = {n: [] for n in _NUMBERS}
            for k in range(rounds + 1):
                for n in _NUMBERS:
                    rate = whole / n if whole else _RATE
                    samples = max(2, round(seconds * rate))
                    block = ask(n, rate, samples)
                    blocks[n] += [block] if k else []  # the first round is for meeting
            found.measurements += _measurements(problem, blocks)
            found.targets += _growth(problem, blocks)
    held: dict[str, list[Block]] = {}
    for moving in (_FIXED, _FREE):
        with _asking(environment, moving, sorted({load.number for load in _LOADS})) as ask:
            for load in (load for load in _LOADS if load.moving == moving):
                ask(load.number, 20.0, 10)
                held[load.words] = [
                    ask(load.number, load.rate, round(2.0 * seconds * load.rate))
                    for _ in range(rounds)
                ]
    found.measurements += _measurements("what holds on two cores, with who asks", held)
    found.targets += [_nothing_lost(words, blocks) for words, blocks in held.items()]
    return found


Ask = Callable[[int, float, int], Block]


@contextlib.contextmanager
def _asking(
    environment: Mapping[str, str], moving: tuple[str, ...], numbers: Sequence[int]
) -> Iterator[Ask]:
    """A process for each number of connectors and who asks; asks one of them."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        serving = {}
        for n in numbers:
            scene = folder / f"{n}.yaml"
            scene.write_text(_scenes(n, moving), encoding="utf-8")
            command = ["cylconn_ros.ros.connector.node", "--ros-args", "-r", f"__node:=of_{n}"]
            command += ["--params-file", str(scene)]
            serving[n] = stack.enter_context(process(f"of_{n}", command, folder, environment))
        crowd = ["cylconn_ros.bench.nodes.many_clients"]
        asking = stack.enter_context(process("crowd", crowd, folder, environment, talks=True))

        def ask(n: int, rate: float, samples: int) -> Block:
            assert asking.stdin is not None
            assert asking.stdout is not None
            task = {"names": _names(n), "moving": moving, "pid": serving[n].pid}
            asking.stdin.write(json.dumps({**task, "rate": rate, "samples": samples}) + "\n")
            asking.stdin.flush()
            line = asking.stdout.readline()
            ended = [name for name, one in serving.items() if one.poll() is not None]
            if ended or not line:
                raise RuntimeError(f"{f'the node of {ended[0]}' if ended else 'crowd'} ended early")
            return dict(json.loads(line))

        yield ask


def _names(n: int) -> list[str]:
    return [f"of{n}n{k}" for k in range(n)]


def _scenes(n: int, moving: tuple[str, ...]) -> str:
    """A parameter file of N connectors, alike."""
    scene: dict[str, Any] = {"connectors": _names(n), "timeout": _TIMEOUT, **SCENE}
    if moving == _FIXED:
        scene["body_a"] = {"kind": "fixed"}
    return dump_several(several(scene))


def _values(blocks: list[Block], quantity: str) -> np.ndarray:
    def value(block: Block) -> float:
        if quantity in (_DELAY, _TAIL):
            return float(block["delays"][quantity == _TAIL]) if block["delays"] else float("nan")
        if quantity == _LOST:
            return float(block["sent"] - block["answered"])
        return float(block["cpu" if quantity == _CPU else "own_cpu"])

    return np.array([value(block) for block in blocks])


def _growth(problem: str, blocks: Mapping[int, list[Block]]) -> Iterator[Target]:
    """What a sample costs of N connectors to what it costs of one, within a round."""
    for n in _NUMBERS[1:]:
        ratio = float(np.median(_values(blocks[n], _CPU) / _values(blocks[1], _CPU)))
        yield Target(f"{problem}: {_CPU}, {n} connectors to 1", ratio, 1.0, "1")


def _nothing_lost(words: str, blocks: list[Block]) -> Target:
    sent = sum(block["sent"] for block in blocks)
    cores = float(np.median([block["cpu"] * block["rate"] for block in blocks]))
    asking = float(np.median([block["own_cpu"] * block["rate"] for block in blocks]))
    note = f"of {sent} samples; {cores:.2f} cores serve, {asking:.2f} ask"
    return Target(f"{words}: {_LOST}", float(_values(blocks, _LOST).sum()), 0.0, "", note)


def _measurements(problem: str, blocks: Mapping[Any, list[Block]]) -> Iterator[Measurement]:
    for who, found in blocks.items():
        contestant = f"{who} connector{'s' if who != 1 else ''}" if isinstance(who, int) else who
        for quantity in (_DELAY, _TAIL, _CPU, _ASKING):
            spread = Spread.of(_values(found, quantity))
            yield Measurement.of(problem, contestant, quantity, spread, "µs", scale=1e6)
        lost = float(_values(found, _LOST).sum())
        yield Measurement(problem, contestant, _LOST, lost, "", count=len(found))
