"""Coverage of the 95 % intervals of identification, by friction, noise and parameter.

Beside it, on the same recordings, ordinary least squares and, on the guides, mujoco.sysid.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.identification import axis, guides, joints, sensors
from cylconn_ros.bench.identification.least_squares import least_squares
from cylconn_ros.bench.identification.mujoco_sysid import installed, mujoco_sysid
from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.effort import estimate_axis
from cylconn_ros.identification.forces.pose_twists import (
    BANDWIDTH,
    has_no_twists,
    twists_from_poses,
)
from cylconn_ros.identification.friction import estimate_friction
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

DRAWS, QUICK = 200, 1
WITHHELD = {"one sample late": 0.25, "filtered twist": 0.25}  # of the draws: none has an estimate
KEPT = Path("identification.jsonl")
AXIS = "axis of known parameters"
AXIS_NOISES = {"encoder": 0.0, "encoder, 5 N on the drive": 5.0}
OURS, OTHER, MUJOCO = "identify", "least squares", "mujoco.sysid"
MUJOCO_DRAWS = 10  # of the guides; one takes up to 5 s

Draw = dict[str, list[float]]
"""Inside (1 or 0) and relative error by "subject/parameter"; no parameter if it was withheld."""
Job = tuple[str, str, int]


def measure(
    settings: Settings, progress: Callable[[int, int], None], kept: Path | None = None
) -> Findings:
    """Draw, estimate and count; ``settings.samples`` is the number of draws.

    Finished draws are appended to ``kept`` (default KEPT, none in the short form), and are not
    repeated by the next run; remove the file after a change of the package.
    """
    draws = settings.samples or (QUICK if settings.quick else DRAWS)
    cases = [(model, noise) for model in joints.MODELS for noise in sensors.NOISES]
    if settings.quick:
        cases = [(model, "white") for model in list(joints.MODELS)[:2]]
    cases += [(name, "white") for name in guides.GUIDES]
    cases += [(AXIS, noise) for noise in AXIS_NOISES]
    file = kept or (None if settings.quick else KEPT)
    done = _read(file)
    # One draw of every case after the other: an interrupted run has as many draws of each.
    jobs = [
        (model, noise, k)
        for k in range(draws)
        for model, noise in cases
        if k < math.ceil(draws * WITHHELD.get(noise, 1.0))
    ]
    exact: dict[str, np.ndarray] = {}
    for number, job in enumerate(jobs):
        key = "|".join(map(str, job))
        if key not in done:
            done[key] = draw(job, exact)
            if file is not None:
                with file.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps({key: done[key]}) + "\n")
        progress(number + 1, len(jobs))
    return _counted(jobs, done)


def draw(job: Job, exact: dict[str, np.ndarray]) -> Draw:
    """Draw and estimate once; ``exact`` keeps motions without noise."""
    model, noise, seed = job
    if model == AXIS:
        return _axis(noise, seed)
    if model in guides.GUIDES:
        guide = guides.GUIDES[model]
        if model not in exact:
            exact[model] = guides.motion(guide)
        mean = 0.5 * (guide.forward + guide.backward)
        half = 0.5 * (guide.forward - guide.backward)
        truth = {"coefficient": mean, "c1": guide.viscous, "direction": half / mean}
        samples = sensors.measured(exact[model], noise, seed)
        found = _estimated(guides.scene(), samples, truth, guides.scene().friction.radius)
        if seed < MUJOCO_DRAWS and installed():
            begin = time.process_time()
            for name, (value, low, high) in mujoco_sysid(samples).items():
                found[f"{MUJOCO}/{name}"] = _judged(value, low, high, truth[name])
            found[f"{MUJOCO}/time"] = [1.0, time.process_time() - begin]
        return found
    law = joints.law_of(model)
    if model not in exact:
        exact[model] = joints.motion(model)
    truth = {
        "coefficient": law.coefficient, "preload": law.preload, "overlap": 2.0 / law.bending,
        "radius": law.radius, "c1": law.c1, "cr1": law.cr1, "direction": law.direction,
        "offset": law.offset, "stribeck": law.stribeck,
    }  # fmt: skip
    samples, scene = sensors.measured(exact[model], noise, seed), joints.scene(model)
    if not has_no_twists(samples):
        return _estimated(scene, samples, truth, law.radius)
    coarse = twists_from_poses(samples, 0.5 * BANDWIDTH).samples, None
    samples, scene = twists_from_poses(samples).samples, dataclasses.replace(scene, period=0.0)
    return _estimated(scene, samples, truth, law.radius, coarse)


def _estimated(
    scene: Scene,
    samples: SampleArrays,
    truth: Mapping[str, float],
    radius: float,
    coarse: tuple[SampleArrays, None] | None = None,
) -> Draw:
    found: Draw = {}
    begin = time.process_time()
    other = least_squares(scene, samples, radius)
    found[f"{OTHER}/time"] = [1.0, time.process_time() - begin]
    for name, (value, low, high) in other.items():
        if name in truth:
            found[f"{OTHER}/{name}"] = _judged(value, low, high, truth[name])
    begin = time.process_time()
    try:
        estimates = estimate_friction(scene, samples, coarse=coarse).estimates
    except IdentifyError:
        estimates = {}
    found[f"{OURS}/time"] = [1.0, time.process_time() - begin]
    for name, value in truth.items():
        e = estimates.get(name)
        if e is not None and e.found:
            found[f"{OURS}/{name}"] = _judged(e.value, e.low, e.high, value)
    return found


def _judged(value: float, low: float, high: float, truth: float) -> list[float]:
    return [float(low <= truth <= high), (value - truth) / truth if truth else value]


def _axis(noise: str, seed: int) -> Draw:
    begin = time.process_time()
    found = estimate_axis([axis.simulate(seed=seed, noise=AXIS_NOISES[noise])])
    draw: Draw = {f"{OURS}/time": [1.0, time.process_time() - begin]}
    for name, truth in axis.TRUTH.items():
        if not found.determined(name):
            continue
        draw[f"{OURS}/{name}"] = _judged(*found[name], truth)
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


def _counted(jobs: list[Job], done: dict[str, Draw]) -> Findings:
    cases: dict[tuple[str, str], list[Draw]] = {}
    for model, noise, seed in jobs:
        cases.setdefault((model, noise), []).append(done[f"{model}|{noise}|{seed}"])
    found = []
    for (model, noise), draws in cases.items():
        names = dict.fromkeys(key for one in draws for key in one)
        for subject in dict.fromkeys(key.partition("/")[0] for key in names):
            case, where = f"{model}, {noise}", f"{subject}/"
            kept = [sum(k.startswith(where) for k in one) > 1 for one in draws]
            if subject == OURS:
                withheld = 1.0 - float(np.mean(kept))
                found.append(
                    Measurement(case, subject, "withheld", withheld, "1", count=len(draws))
                )
            for key in (key for key in names if key.startswith(where)):
                inside, errors = np.array([one[key] for one in draws if key in one]).T
                name = key.removeprefix(where)
                if name == "time":
                    value = float(np.median(errors))
                    found.append(Measurement(case, subject, name, value, "s", count=len(errors)))
                    continue
                share, worst = float(inside.mean()), float(np.abs(errors).max())
                bias = float(np.median(errors))
                note = f"median error {bias:+.2g}, largest {worst:.2g}"
                found.append(
                    Measurement(case, subject, name, share, "1", count=len(errors), note=note)
                )
    return Findings(measurements=found)
