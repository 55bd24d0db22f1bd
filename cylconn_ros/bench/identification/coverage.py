"""Coverage of the 95 % intervals of identification, by friction, noise and parameter."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.identification import axis, joints
from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.effort import estimate_axis
from cylconn_ros.identification.friction import estimate_friction

DRAWS, QUICK = 200, 1
KEPT = Path("identification.jsonl")
AXIS = "axis of known parameters"


def measure(
    settings: Settings, progress: Callable[[int, int], None], kept: Path | None = None
) -> Findings:
    """Draw, estimate and count; ``settings.samples`` is the number of draws.

    Finished draws are appended to ``kept`` (default KEPT, none in the short form), and are not
    repeated by the next run.
    """
    draws = settings.samples or (QUICK if settings.quick else DRAWS)
    models = list(joints.MODELS)[:2] if settings.quick else list(joints.MODELS)
    noises = joints.NOISES[:1] if settings.quick else joints.NOISES
    file = kept or (None if settings.quick else KEPT)
    done = _read(file)
    jobs = [(m, z, k) for m in models for z in noises for k in range(draws)]
    jobs += [(AXIS, "encoder", k) for k in range(draws)]
    exact: dict[str, np.ndarray] = {}
    for number, (model, noise, seed) in enumerate(jobs):
        key = f"{model}|{noise}|{seed}"
        if key not in done:
            if model == AXIS:
                done[key] = _axis(seed)
            else:
                if model not in exact:
                    exact = {model: joints.motion(joints.law_of(model))}
                done[key] = _joint(model, exact[model], noise, seed)
            if file is not None:
                with file.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps({key: done[key]}) + "\n")
        progress(number + 1, len(jobs))
    return _counted(jobs, done)


Draw = dict[str, list[float]]
"""Inside (1 or 0) and relative error by parameter; empty if the estimate was withheld."""


def _joint(model: str, rows: np.ndarray, noise: str, seed: int) -> Draw:
    law = joints.law_of(model)
    truth = {
        "coefficient": law.coefficient, "preload": law.preload, "overlap": 2.0 / law.bending,
        "radius": law.radius, "c1": law.c1, "cr1": law.cr1, "direction": law.direction,
        "offset": law.offset, "stribeck": law.stribeck,
    }  # fmt: skip
    try:
        found = estimate_friction(joints.scene(), joints.measured(rows, noise, seed))
    except IdentifyError:
        return {}
    draw = {}
    for name, value in truth.items():
        e = found.estimates[name]
        if e.found:
            error = (e.value - value) / value if value else e.value
            draw[name] = [float(e.low <= value <= e.high), float(error)]
    return draw


def _axis(seed: int) -> Draw:
    found = estimate_axis([axis.simulate(seed=seed)])
    draw = {}
    for name, value in axis.TRUTH.items():
        estimate, low, high = found[name]
        draw[name] = [float(low <= value <= high), (estimate - value) / value]
    return draw


def _read(file: Path | None) -> dict[str, Draw]:
    if file is None or not file.exists():
        return {}
    found: dict[str, Draw] = {}
    for line in file.read_text(encoding="utf-8").splitlines():
        try:
            found.update(json.loads(line))
        except ValueError:  # the last line of a run that was interrupted
            continue
    return found


def _counted(jobs: list[tuple[str, str, int]], done: dict[str, Draw]) -> Findings:
    cases: dict[tuple[str, str], list[Draw]] = {}
    for model, noise, seed in jobs:
        cases.setdefault((model, noise), []).append(done[f"{model}|{noise}|{seed}"])
    measurements = []
    for (model, noise), draws in cases.items():
        withheld = sum(not draw for draw in draws)
        measurements.append(
            Measurement(model, noise, "withheld", withheld / len(draws), "1", count=len(draws))
        )
        for name in dict.fromkeys(key for draw in draws for key in draw):
            inside = [draw[name][0] for draw in draws if name in draw]
            errors = [abs(draw[name][1]) for draw in draws if name in draw]
            measurements.append(
                Measurement(
                    model,
                    noise,
                    name,
                    float(np.mean(inside)),
                    "1",
                    count=len(inside),
                    note=f"median error {np.median(errors):.2g}",
                )
            )
    return Findings(measurements=measurements)


def text(findings: Findings) -> str:
    """Return a Markdown table: share of the intervals that contain the truth, and of how many."""
    lines = ["| friction | noise | inside the interval (draws) | withheld |", "|---|---|---|---|"]
    cases: dict[tuple[str, str], list[Measurement]] = {}
    for one in findings.measurements:
        cases.setdefault((one.case, one.subject), []).append(one)
    for (model, noise), found in cases.items():
        cells = [
            f"{one.quantity} {100.0 * one.value:.0f} % ({one.count})"
            for one in found
            if one.quantity != "withheld"
        ]
        withheld = next(one for one in found if one.quantity == "withheld")
        share = f"{round(withheld.value * withheld.count)} of {withheld.count}"
        lines.append(f"| {model} | {noise} | {', '.join(cells)} | {share} |")
    return "\n".join(lines)
