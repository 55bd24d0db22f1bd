"""Fault injection benchmark: real processes, then every library scene over a faulty channel."""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.faults import free_running, sweep
from cylconn_ros.bench.faults.free_running import Motion
from cylconn_ros.bench.faults.sweep import Cell, Outcome
from cylconn_ros.process.child import Child, module_command
from cylconn_ros.reference.library import LIBRARY

PROCESSES, LIBRARY_RUNS = "real processes", "every scene of the library"
FREE_RUNNING = "every scene of the library, free running"
TUMBLING = "tumbling pairs, free running"
ONE_BY_ONE = "free running, one by one"
MET = "met"
NOT_FINITE = "not finite"
QUICK_SCENES = ["demo", "free_flight", "incline_stick"]
_QUICK_FAULTS = ("2 late", "10 % lost", "2 late, 30 % jitter", "teleported")


def measure(
    settings: Settings, environment: Mapping[str, str], progress: sweep.Progress
) -> Findings:
    """Inject every fault into nodes in ``environment`` (a ROS domain of its own), and into scenes.

    Raises ProcessError if a process ends early.
    """
    found = Findings()
    found.add(_of_fault_cases(list(run_fault_cases(settings.quick, environment))))
    names = QUICK_SCENES if settings.quick else sorted(LIBRARY)
    faults = [f for f in sweep.cases() if not settings.quick or f.name in _QUICK_FAULTS]
    found.add(_of_cells(dict(sweep.run(names, faults, settings.load, progress))))
    found.add(free_running_matrix(settings))
    return found


def free_running_matrix(settings: Settings, progress: sweep.Progress | None = None) -> Findings:
    """The free-running plant: which runs did not survive, by rate, lag, kind and integration."""
    names = QUICK_SCENES if settings.quick else [*sorted(LIBRARY), *free_running.TUMBLING]
    rates, lags, kinds, integrations = (
        ((500.0,), (0.3, 2.5), ("constant", "jitter"), ("exact",))
        if settings.quick
        else (
            free_running.RATES, free_running.LAGS, free_running.KINDS, free_running.INTEGRATIONS,
        )
    )  # fmt: skip
    total = len(names) * len(rates) * len(lags) * len(kinds) * len(integrations)
    found = Findings()
    groups: dict[tuple[str, float, str, float, str], list[tuple[Motion, bool]]] = {}
    failed: dict[str, Counter[str]] = {FREE_RUNNING: Counter(), TUMBLING: Counter()}
    cells = free_running.sweep(names, rates, lags, kinds, integrations, settings.load)
    for (name, rate, integration, lag), motion, failures in cells:
        if progress is not None:
            progress(len(found.measurements), total)
        case = TUMBLING if name in free_running.TUMBLING else FREE_RUNNING
        group = groups.setdefault((case, rate, integration, lag.periods, lag.kind), [])
        group.append((motion, not failures))
        failed[case].update(failures)
        found.measurements.append(
            Measurement(
                ONE_BY_ONE, f"{name}: {lag.periods:g} {lag.kind}", "survived",
                float(not failures), "1", note=" and ".join(failures),
                settings={"rate": rate, "integration": integration, "offset": motion.offset,
                          "angle": motion.angle, "force": motion.force, "gained": motion.gained,
                          "latency": motion.latency},
            )
        )  # fmt: skip
    for case, reasons in failed.items():
        of_case = [fine for key, group in groups.items() if key[0] == case for _, fine in group]
        if of_case:
            note = ", ".join(f"{reason} {n}" for reason, n in reasons.most_common())
            note = f"of {len(of_case)} runs" + (f"; by criterion: {note}" if note else "")
            missed = of_case.count(False)
            found.targets.append(Target(f"{case}: not survived", missed, 0.0, "", note))
    for key, group in groups.items():
        found.measurements += _free_running_cell(*key, group)
    return found


def _free_running_cell(
    case: str, rate: float, integration: str, periods: float, kind: str,
    group: Sequence[tuple[Motion, bool]],
) -> Iterator[Measurement]:  # fmt: skip
    """Runs that survived, and the offset and angle reached, of a rate, an integration and a lag."""
    offsets = [motion.offset for motion, _ in group]
    values = {
        "runs": (len(group), ""),
        "survived": (sum(fine for _, fine in group), ""),
        "offset": (float(np.median(offsets)), "m"),
        "nine tenths": (float(np.quantile(offsets, 0.9, method="inverted_cdf")), "m"),
        "greatest offset": (max(offsets), "m"),
        "angle": (max(motion.angle for motion, _ in group), "rad"),
    }
    for quantity, (value, unit) in values.items():
        yield Measurement(
            case, f"{periods:g} {kind}", quantity, float(value), unit,
            settings={"rate": rate, "integration": integration},
            note="" if math.isfinite(value) else "not finite",
        )  # fmt: skip


def run_fault_cases(quick: bool, environment: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Run the faults of real processes; yield each FaultCase (bench/faults/fault.py) as data."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = [folder, *(["quick"] if quick else [])]
        command = module_command("cylconn_ros.bench.faults.run", *arguments)
        with Child("the fault injection", command, environment, json_lines=True) as child:
            yield from child.messages()


def _of_fault_cases(cases: Sequence[Mapping[str, Any]]) -> Findings:
    found = Findings()
    failed = [case["fault"] for case in cases if case["failures"]]
    not_finite = sum(case["numbers"][NOT_FINITE] for case in cases)
    of = f"of {len(cases)}"
    found.targets = [
        Target("faults of real processes, not as expected", len(failed), 0.0, "",
               ": ".join([of, *failed])),
        Target("wrenches published that are not finite", not_finite, 0.0, ""),
    ]  # fmt: skip
    for case in cases:
        settings = {"expected": case["expected"], "failures": "; ".join(case["failures"])}
        found.measurements.append(
            Measurement(
                PROCESSES, case["fault"], MET, float(not case["failures"]), "1", settings=settings,
                note="; ".join(case["observed"]),
            )
        )  # fmt: skip
        found.measurements += [
            Measurement(PROCESSES, case["fault"], name, value, "")
            for name, value in case["numbers"].items()
        ]
    return found


def _of_cells(cells: Mapping[Cell, Outcome]) -> Findings:
    found = Findings()
    for latency in (sweep.SET, sweep.MEASURED):
        group = {cell: o for cell, o in cells.items() if cell[2] == latency}
        for name, failed in (
            ("constraint or energy not bounded", [c for c, o in group.items() if not o.bounded]),
            ("passivity beyond its bound", [c for c, o in group.items() if not o.passive]),
        ):
            which = ", ".join(_counted(failed))
            note = f"of {len(group)} runs" + (f": {which}" if which else "")
            found.targets.append(Target(f"latency {latency}: {name}", len(failed), 0.0, "", note))
    for fault, latency in dict.fromkeys((fault, latency) for fault, _, latency, _ in cells):
        group = {cell: o for cell, o in cells.items() if (cell[0], cell[2]) == (fault, latency)}
        found.measurements += _summary(fault, latency, group)
    for (fault, scene, latency, seed), o in cells.items():
        for quantity in ("offset", "angle", "energy", "end", "passivity"):
            found.measurements.append(
                Measurement(
                    f"{LIBRARY_RUNS}, one by one", f"{scene}: {fault}", quantity,
                    getattr(o, quantity), {"offset": "m", "angle": "rad"}.get(quantity, "1"),
                    settings={"latency": latency, "seed": seed},
                )
            )  # fmt: skip
    return found


def _counted(failed: Sequence[Cell]) -> list[str]:
    """Fault and scene of failed runs, with the number of seeds if there are several."""
    count = Counter((fault, scene) for fault, scene, _, _ in failed)
    return [
        f"{fault} ({scene}" + (f", {n} seeds)" if n > 1 else ")")
        for (fault, scene), n in count.items()
    ]


def _summary(fault: str, latency: str, group: Mapping[Cell, Outcome]) -> Iterator[Measurement]:
    """Numbers of runs that meet each criterion, and the worst of each quantity."""
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
            LIBRARY_RUNS, fault, quantity, float(value), unit, settings={"latency": latency},
            note="" if math.isfinite(value) else "not finite",
        )  # fmt: skip
