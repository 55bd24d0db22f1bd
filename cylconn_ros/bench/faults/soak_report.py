"""Soak benchmark: losses and memory of a recording node, and the laws of its recording.

The exchange of the samples is a program of its own (bench/faults/soak.py).
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.laws.guarantees import title
from cylconn_ros.laws.runs import check_recording
from cylconn_ros.laws.summary import LawSummary
from cylconn_ros.process.child import Child, module_command

SAMPLES, QUICK = 2_000_000, 20_000
_SHOWN = (0.1, 0.25, 0.5, 0.75, 1.0)  # shares of the samples at which memory is printed
_STEADY = 0.1  # share of the samples after which memory must be steady
_GROWTH = 0.01  # allowed relative growth of memory afterwards

Progress = Callable[[int, int], object]


def measure(
    samples: int,
    environment: Mapping[str, str],
    exchange_progress: Progress,
    check_progress: Progress,
) -> Findings:
    """Exchange ``samples`` with a recording node, then check the laws of its recording.

    Raises ProcessError if the exchange ends early.
    """
    with tempfile.TemporaryDirectory() as name:
        found: dict[str, Any] = {}
        command = module_command("cylconn_ros.bench.faults.soak", name, str(samples))
        with Child("the exchange", command, environment, json_lines=True) as child:
            for found in child.messages():
                if "done" in found:
                    exchange_progress(found["done"], samples)
        run = Path(found["run"])
        size = sum(file.stat().st_size for file in run.iterdir())
        _, checked = check_recording(run, check_progress)
    return Findings(
        targets=list(_targets(found, checked)),
        measurements=[*_measurements(found, size), *_memory(found), *_laws(checked)],
    )


def _growth(memory: list[tuple[int, float]], samples: int) -> float:
    """Relative growth of memory since it should be steady."""
    steady = [mb for done, mb in memory if done >= _STEADY * samples]
    return max(steady) / steady[0] - 1.0


def _targets(found: Mapping[str, Any], checked: LawSummary) -> Iterator[Target]:
    samples, counted = found["samples"], found["counted"]
    of = f"of {samples} samples"
    lost = samples - counted["samples processed"]
    broken = sum(law.violations for law in checked.laws.values())
    faults = ("undecodable", "failed", "non-finite", "incomplete samples", "late messages")
    yield Target("samples without an output", max(found["unanswered"], lost), 0.0, "", of)
    yield Target("wrenches that are not finite", found["not_finite"], 0.0, "",
                 f"of {found['wrenches']}")  # fmt: skip
    yield Target("faults in diagnostics", sum(counted[name] for name in faults), 0.0, "")
    yield Target("messages lost by the recording", counted["messages lost"], 0.0, "",
                 f"of {counted['messages recorded']}")  # fmt: skip
    yield Target("samples not in the recording", samples - checked.samples, 0.0, "")
    yield Target("samples that violate a law", broken, 0.0, "", f"of {checked.samples}")
    yield Target("memory, growth after the first tenth", _growth(found["memory"], samples), _GROWTH,
                 "1")  # fmt: skip
    yield Target("exit code after Ctrl-C", found["code"], 0.0, "")


def _measurements(found: Mapping[str, Any], size: int) -> Iterator[Measurement]:
    for quantity, value, unit in (
        ("samples", found["samples"], ""),
        ("samples/s", found["samples"] / found["seconds"], "1/s"),
        ("restarts of the simulator", found["counted"]["restarts"], ""),
        ("messages recorded", found["counted"]["messages recorded"], ""),
        ("recording", size / 1e6, "MB"),
    ):
        yield Measurement("exchange in lock step", "node, recording", quantity, float(value), unit)


def _memory(found: Mapping[str, Any]) -> Iterator[Measurement]:
    done = np.array([row[0] for row in found["memory"]])
    for share in _SHOWN:
        k = int(np.argmin(np.abs(done - share * found["samples"])))
        yield Measurement(
            "resident memory of the node", "node, recording", f"after {done[k]}",
            found["memory"][k][1], "MB",
        )  # fmt: skip


def _laws(checked: LawSummary) -> Iterator[Measurement]:
    problem = "laws of the recording"
    for name, law in checked.laws.items():
        if law.samples:
            yield Measurement(problem, title(name), "samples", float(law.samples), "")
            yield Measurement(problem, title(name), "worst", law.worst, "")
            yield Measurement(problem, title(name), "beyond 1e-12", float(law.violations), "")
    for regime, count in checked.regimes.items():
        if count:
            yield Measurement("regimes", regime, "samples", float(count), "")
