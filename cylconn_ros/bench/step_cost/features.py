"""Cost and error of each model feature.

Connectors model only the features that a scene has. Each scene of the precision benchmark runs with
``impulse`` in three kinds of variants: *lean*, the scene as it is; with an additional feature that
has no effect (friction of 1e-200, stops out of reach, a second body of 1e12 kg); and without one of
its own features. Costs are per step in a compiled batch, timed in turns; errors are against the
reference solution at a period of 1 ms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cylconn_ros.bench.common import report
from cylconn_ros.bench.common.methods import with_period
from cylconn_ros.bench.common.results import STEP, Findings, Measurement
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Array, Block, Spread, ratio, time_interleaved, timed
from cylconn_ros.bench.peers.ours import ClosedLoop
from cylconn_ros.bench.precision import cases
from cylconn_ros.bench.precision.cases import ERROR, Case
from cylconn_ros.bench.step_cost.kernel import Batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

PERIOD = 1e-3  # s
TINY, OUT_OF_REACH, HEAVY = 1e-200, 1e6, 1e12
LEAN, FULL, WITH, WITHOUT = "lean", "full", "with ", "without "
OVER_LEAN = "over lean"
QUICK = ("coast", "near_jam")
FEATURES = ("friction", "bending", "springs", "stops", "second body")

Parameters = dict[str, Any]
Values = Mapping[tuple[str, str, str], Measurement]


def additions(scene: Scene) -> dict[str, Parameters]:
    """Features that the scene does not have, with parameters that give them no effect."""
    found: dict[str, Parameters] = {}
    if not scene.friction.on:
        found["friction"] = {"friction.coefficient": TINY, "friction.radius": 0.02}
    if scene.friction.overlap == 0.0:
        found["bending"] = {**found.get("friction", {}), "friction.overlap": 1.0 / TINY}
    if math.isnan(scene.stops.l_max):
        names = ("l_min", "l_max", "theta_min", "theta_max")
        found["stops"] = {
            f"stops.{name}": math.copysign(OUT_OF_REACH, -1.0 if "min" in name else 1.0)
            for name in names
        }
    if scene.elasticity.k1 == 0.0:
        names = ("elasticity.k1", "elasticity.kr1", "damping.c1", "damping.cr1")
        found["springs"] = dict.fromkeys(names, TINY)
    if scene.body_a.kind == "fixed":
        lift = [*(-HEAVY * g for g in scene.gravity), 0.0, 0.0, 0.0]
        found["second body"] = {
            "body_a.kind": "free", "body_a.mass": HEAVY, "body_a.com": [0.0, 0.0, 0.0],
            "body_a.inertia": [HEAVY, 0.0, 0.0, HEAVY, 0.0, HEAVY], "plant.body_a.load": lift,
        }  # fmt: skip
    return found


def omissions(scene: Scene) -> dict[str, Parameters]:
    """Features that the scene has, with the parameters that remove them."""
    found: dict[str, Parameters] = {}
    if scene.friction.on:
        found["friction"] = {"friction.coefficient": 0.0}
        if scene.friction.overlap > 0.0:
            found["bending"] = {"friction.overlap": 0.0}
    if not math.isnan(scene.stops.l_max):
        found["stops"] = {"stops.l_min": math.nan, "stops.l_max": math.nan}
    if scene.elasticity.k1 > 0.0:
        found["springs"] = {"elasticity.k1": 0.0}
    if scene.body_a.kind == "free":
        found["second body"] = {
            "body_a.kind": "fixed", "plant.body_a.twist": [0.0] * 6,
            "plant.body_b.twist": relative_twist(scene),
        }  # fmt: skip
    return found


def relative_twist(scene: Scene) -> list[float]:
    """Initial twist of B relative to A, in world axes."""
    a, b = np.array(scene.initial_twist(0)), np.array(scene.initial_twist(1))
    arm = np.array(scene.initial_pose(1)[:3]) - np.array(scene.initial_pose(0)[:3])
    velocity = b[:3] - a[:3] - np.cross(a[3:], arm)
    return [*map(float, velocity), *map(float, b[3:] - a[3:])]


def variants(scene: Scene) -> dict[str, Scene]:
    """The lean scene, with each additional feature, with all of them, and without each own one."""
    scene = with_period(scene, PERIOD)
    own = {**scene.parameters(), "method": "impulse"}
    added = additions(scene)
    changes: dict[str, Parameters] = {LEAN: {}}
    changes |= {WITH + name: change for name, change in added.items()}
    changes[FULL] = {key: value for change in added.values() for key, value in change.items()}
    changes |= {WITHOUT + name: change for name, change in omissions(scene).items()}
    return {name: Scene.from_parameters({**own, **change}) for name, change in changes.items()}


def measure(settings: Settings) -> Findings:
    """All scenes; two of them in the quick form."""
    found = Findings()
    for case in cases.chosen(QUICK if settings.quick else ()):
        scene = cases.scene_of(settings.load, case)
        found.add(_measure_scene(case, scene, settings))
    return found


def _measure_scene(case: Case, scene: Scene, settings: Settings) -> Findings:
    reference = case.reference(scene, case.duration)
    found = Findings()
    blocks: dict[str, Block] = {}
    steps = round(case.duration / PERIOD)
    for name, variant in variants(scene).items():
        state = ClosedLoop(variant, steps)()()
        error, _ = cases.errors(case, scene, reference, state)[ERROR]
        found.measurements.append(Measurement(case.name, name, ERROR, error, "m"))
        blocks[name] = timed(Batch(Connector(variant), _samples(variant)))
    times = time_interleaved(blocks, settings.rounds, settings.block)
    for name, values in times.items():
        found.measurements += [
            Measurement.of(case.name, name, STEP, Spread.of(values), "µs", scale=1e6),
            Measurement.of(case.name, name, OVER_LEAN, ratio(values, times[LEAN]), "1"),
        ]
    return found


def _samples(scene: Scene) -> Array:
    """(200, NSAMPLE) samples of the first 0.2 s."""
    run = simulate(scene, samples=200)
    samples = np.zeros((len(run.time), layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    samples[:, layout.LOADS] = run.plant.loads
    return samples


def text(found: Findings) -> str:
    """Two tables: additional features without effect, and omitted features."""
    names = list(dict.fromkeys(m.case for m in found.measurements))
    values = {(m.case, m.subject, m.quantity): m for m in found.measurements}
    head = (
        "", "lean", "error", *(f"+ {name}" for name in FEATURES), "full", "error of the full model",
    )  # fmt: skip
    return "\n\n".join(
        [
            "**Time of a step of the lean model, and times as long with an additional feature "
            "that has no effect**\n\n"
            + report.table(head, [(name, *_with_additions(values, name)) for name in names]),
            "**Effect of omitting a feature: time over the lean model's, and error**\n\n"
            + report.table(
                ("scene", "omitted", "time over lean", "error", "error, lean"),
                [row for name in names for row in _with_omissions(values, name)],
            ),
        ]
    )


def _number(values: Values, case: str, name: str, quantity: str) -> str:
    m = values.get((case, name, quantity))
    return "" if m is None else report.number(m.value, m.unit)


def _with_additions(values: Values, case: str) -> list[str]:
    row = [_number(values, case, LEAN, STEP), _number(values, case, LEAN, ERROR)]
    row += [_number(values, case, WITH + name, OVER_LEAN) for name in FEATURES]
    return [*row, _number(values, case, FULL, OVER_LEAN), _number(values, case, FULL, ERROR)]


def _with_omissions(values: Values, case: str) -> list[tuple[str, ...]]:
    return [
        (
            case, name, _number(values, case, WITHOUT + name, OVER_LEAN),
            _number(values, case, WITHOUT + name, ERROR), _number(values, case, LEAN, ERROR),
        )
        for name in FEATURES
        if (case, WITHOUT + name, OVER_LEAN) in values
    ]  # fmt: skip
