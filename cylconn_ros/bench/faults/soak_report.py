"""The node for millions of samples: what it loses, what it holds, and the laws of what it recorded.

The exchange itself is a program of its own (bench/faults/soak.py).
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.process import json_lines

SAMPLES, QUICK = 2_000_000, 20_000
_SHOWN = (0.1, 0.25, 0.5, 0.75, 1.0)  # shares of the samples at which memory is shown
_SETTLED = 0.1  # of the samples, before which memory may still grow
_GROWTH = 0.01  # of the memory, that it may grow by afterwards

Progress = Callable[[int, int], object]


class Law(NamedTuple):
    """What the check of a recording says of one law."""

    name: str
    samples: int  # that it speaks of
    worst: float
    beyond: int  # samples beyond the tolerance


class Checked(NamedTuple):
    """What the check of a recording says."""

    samples: int
    laws: list[Law]
    regimes: Mapping[str, int]


Check = Callable[[Path], Checked]


def measure(
    samples: int, environment: Mapping[str, str], check: Check, progress: Progress
) -> Findings:
    """Exchange ``samples`` with a node that records them, then check its recording.

    Raises RuntimeError where the exchange ends too early.
    """
    with tempfile.TemporaryDirectory() as name:
        found: dict[str, Any] = {}
        module = "cylconn_ros.bench.faults.soak"
        for found in json_lines.said(module, [name, str(samples)], environment):
            if "done" in found:
                progress(found["done"], samples)
        run = Path(found["run"])
        size = sum(file.stat().st_size for file in run.iterdir())
        checked = check(run)
    return Findings(
        targets=list(_targets(found, checked)),
        measurements=[*_measurements(found, size), *_memory(found), *_laws(checked)],
    )


def _grown(memory: list[tuple[int, float]], samples: int) -> float:
    """By which share of itself memory has grown since it should have settled."""
    settled = [mb for done, mb in memory if done >= _SETTLED * samples]
    return max(settled) / settled[0] - 1.0


def _targets(found: Mapping[str, Any], checked: Checked) -> Iterator[Target]:
    samples, counted = found["samples"], found["counted"]
    of = f"of {samples} samples"
    lost = samples - counted["samples answered"]
    broken = sum(law.beyond for law in checked.laws)
    faults = ("undecodable", "failed", "non-finite", "incomplete samples", "late messages")
    yield Target("samples without an answer", max(found["unanswered"], lost), 0.0, "", of)
    yield Target("wrenches that are not finite", found["not_finite"], 0.0, "",
                 f"of {found['wrenches']}")  # fmt: skip
    yield Target("faults in diagnostics", sum(counted[name] for name in faults), 0.0, "")
    yield Target("messages lost by the recording", counted["messages lost"], 0.0, "",
                 f"of {counted['messages recorded']}")  # fmt: skip
    yield Target("samples not in the recording", samples - checked.samples, 0.0, "")
    yield Target("samples that break a law", broken, 0.0, "", f"of {checked.samples}")
    yield Target("memory, growth after the first tenth", _grown(found["memory"], samples), _GROWTH,
                 "1")  # fmt: skip
    yield Target("exit code after Ctrl-C", found["code"], 0.0, "")


def _measurements(found: Mapping[str, Any], size: int) -> Iterator[Measurement]:
    for quantity, value, unit in (
        ("samples", found["samples"], ""),
        ("samples/s", found["samples"] / found["seconds"], "1/s"),
        ("simulators started anew", found["counted"]["restarts"], ""),
        ("messages recorded", found["counted"]["messages recorded"], ""),
        ("recording", size / 1e6, "MB"),
    ):
        yield Measurement("exchange in lock step", "node, recording", quantity, float(value), unit)


def _memory(found: Mapping[str, Any]) -> Iterator[Measurement]:
    done = np.array([row[0] for row in found["memory"]])
    for share in _SHOWN:
        k = int(np.argmin(np.abs(done - share * found["samples"])))
        yield Measurement(
            "memory that the node holds", "node, recording", f"after {done[k]}",
            found["memory"][k][1], "MB",
        )  # fmt: skip


def _laws(checked: Checked) -> Iterator[Measurement]:
    problem = "laws of the recording"
    for law in checked.laws:
        yield Measurement(problem, law.name, "samples", float(law.samples), "")
        yield Measurement(problem, law.name, "worst", law.worst, "")
        yield Measurement(problem, law.name, "beyond 1e-12", float(law.beyond), "")
    for regime, count in checked.regimes.items():
        if count:
            yield Measurement("regimes", regime, "samples", float(count), "")
