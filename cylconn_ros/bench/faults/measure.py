"""All faults: real processes first, then every scene of the library through a faulty way."""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.faults import sweep
from cylconn_ros.bench.faults.sweep import Cell, Outcome
from cylconn_ros.process import json_lines
from cylconn_ros.reference.library import LIBRARY

PROCESSES, LIBRARY_RUNS = "real processes", "every scene of the library"
MET = "met"
NOT_FINITE = "not finite"
QUICK_SCENES = ["demo", "free_flight", "incline_stick"]
_QUICK_FAULTS = ("2 late", "10 % lost", "2 late, 30 % jitter", "teleported")


def measure(
    settings: Settings, environment: Mapping[str, str], progress: sweep.Progress
) -> Findings:
    """Put every fault upon nodes in ``environment`` (ROS: a domain of its own), and upon scenes.

    Raises RuntimeError where a process ends too early.
    """
    found = Findings()
    found.add(_of_rows(list(real(settings.quick, environment))))
    names = QUICK_SCENES if settings.quick else sorted(LIBRARY)
    faults = [f for f in sweep.rows() if not settings.quick or f.name in _QUICK_FAULTS]
    found.add(_of_cells(dict(sweep.run(names, faults, settings.load, progress))))
    return found


def real(quick: bool, environment: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """A row of bench/faults/fault.py for every fault, as it comes."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = [folder, *(["quick"] if quick else [])]
        yield from json_lines.said("cylconn_ros.bench.faults.run", arguments, environment)


def _of_rows(rows: Sequence[Mapping[str, Any]]) -> Findings:
    found = Findings()
    not_met = [row["fault"] for row in rows if row["wrong"]]
    bad = sum(row["numbers"][NOT_FINITE] for row in rows)
    of = f"of {len(rows)}"
    found.targets = [
        Target("faults of real processes, not as expected", len(not_met), 0.0, "",
               ": ".join([of, *not_met])),
        Target("wrenches published that are not finite", bad, 0.0, ""),
    ]  # fmt: skip
    for row in rows:
        settings = {"expected": row["expected"], "wrong": "; ".join(row["wrong"])}
        found.measurements.append(
            Measurement(
                PROCESSES, row["fault"], MET, float(not row["wrong"]), "1", settings=settings,
                note="; ".join(row["seen"]),
            )
        )  # fmt: skip
        found.measurements += [
            Measurement(PROCESSES, row["fault"], name, value, "")
            for name, value in row["numbers"].items()
        ]
    return found


def _of_cells(cells: Mapping[Cell, Outcome]) -> Findings:
    found = Findings()
    for told in (sweep.TOLD, sweep.MEASURED):
        group = {cell: o for cell, o in cells.items() if cell[2] == told}
        for name, off in (
            ("constraint or energy not bounded", [c for c, o in group.items() if not o.bounded]),
            ("passivity beyond its bound", [c for c, o in group.items() if not o.passive]),
        ):
            which = ", ".join(_counted(off))
            note = f"of {len(group)} runs" + (f": {which}" if which else "")
            found.targets.append(Target(f"latency {told}: {name}", len(off), 0.0, "", note))
    for fault, told in dict.fromkeys((fault, told) for fault, _, told, _ in cells):
        group = {cell: o for cell, o in cells.items() if (cell[0], cell[2]) == (fault, told)}
        found.measurements += _summed(fault, told, group)
    for (fault, scene, told, seed), o in cells.items():
        for quantity in ("offset", "angle", "energy", "end", "passivity"):
            found.measurements.append(
                Measurement(
                    f"{LIBRARY_RUNS}, one by one", f"{scene}: {fault}", quantity,
                    getattr(o, quantity), {"offset": "m", "angle": "rad"}.get(quantity, "1"),
                    settings={"latency": told, "seed": seed},
                )
            )  # fmt: skip
    return found


def _counted(off: Sequence[Cell]) -> list[str]:
    """Fault and scene of runs, and of how many seeds where there are several."""
    count = Counter((fault, scene) for fault, scene, _, _ in off)
    return [
        f"{fault} ({scene}" + (f", {n} seeds)" if n > 1 else ")")
        for (fault, scene), n in count.items()
    ]


def _summed(fault: str, told: str, group: Mapping[Cell, Outcome]) -> Iterator[Measurement]:
    """How many scenes are fine, and the worst of each kind."""
    outcomes = list(group.values())
    numbers = {
        "runs": (len(outcomes), ""),
        "finite": (sum(o.finite for o in outcomes), ""),
        "bounded": (sum(o.bounded for o in outcomes), ""),
        "passive": (sum(o.passive for o in outcomes), ""),
        "offset": (max(o.offset for o in outcomes), "m"),
        "angle": (max(o.angle for o in outcomes), "rad"),
        "energy": (max(o.energy for o in outcomes), "1"),
        "end": (max(o.end for o in outcomes), "1"),
    }
    for quantity, (value, unit) in numbers.items():
        yield Measurement(
            LIBRARY_RUNS, fault, quantity, float(value), unit, settings={"latency": told},
            note="" if math.isfinite(value) else "not finite",
        )  # fmt: skip
