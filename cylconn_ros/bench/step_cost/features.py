"""Model no more than a scene needs: what the lean model saves, and what leaving out would cost.

Each scene of the diagrams is run by ``impulse`` in three ways: *lean*, as the scene says and
``auto`` takes it; with a feature more, there but without effect (friction of 1e-200, stops out of
reach, a second body of 1e12 kg); and with one of its own features left out. Costs are of an answer
in a compiled batch, taking turns; errors are against the scene's answer at 1 ms.
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
from cylconn_ros.bench.common.timing import Contestant, Spread, ratio, take_turns, timed
from cylconn_ros.bench.peers.ours import Loop
from cylconn_ros.bench.precision import cases
from cylconn_ros.bench.precision.cases import PLACE, Case
from cylconn_ros.bench.step_cost.kernel import Batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

PERIOD = 1e-3  # s
NOTHING, FAR, HEAVY = 1e-200, 1e6, 1e12
LEAN, FULL, WITH, WITHOUT = "lean", "full", "with ", "without "
OVER = "over lean"
QUICK = ("coast", "near_jam")

Parameters = dict[str, Any]


def additions(scene: Scene) -> dict[str, Parameters]:
    """Features that the scene does not have, as parameters that give them no effect."""
    found: dict[str, Parameters] = {}
    if not scene.friction.on:
        found["friction"] = {"friction.coefficient": NOTHING, "friction.radius": 0.02}
    if scene.friction.overlap == 0.0:
        arm = {"friction.overlap": 1.0 / NOTHING}
        found["bending"] = {**found.get("friction", {}), **arm}
    if math.isnan(scene.stops.l_max):
        names = ("l_min", "l_max", "theta_min", "theta_max")
        found["stops"] = {
            f"stops.{name}": math.copysign(FAR, -1.0 if "min" in name else 1.0) for name in names
        }
    if scene.elasticity.k1 == 0.0:
        names = ("elasticity.k1", "elasticity.kr1", "damping.c1", "damping.cr1")
        found["springs"] = dict.fromkeys(names, NOTHING)
    if scene.body_a.kind == "fixed":
        lift = [*(-HEAVY * g for g in scene.gravity), 0.0, 0.0, 0.0]
        found["second body"] = {
            "body_a.kind": "free", "body_a.mass": HEAVY, "body_a.com": [0.0, 0.0, 0.0],
            "body_a.inertia": [HEAVY, 0.0, 0.0, HEAVY, 0.0, HEAVY], "plant.body_a.load": lift,
        }  # fmt: skip
    return found


def omissions(scene: Scene) -> dict[str, Parameters]:
    """Features that the scene has, as parameters without them."""
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
    """B's twist as a body has it that is at rest beside A."""
    a, b = np.array(scene.initial_twist(0)), np.array(scene.initial_twist(1))
    arm = np.array(scene.initial_pose(1)[:3]) - np.array(scene.initial_pose(0)[:3])
    velocity = b[:3] - a[:3] - np.cross(a[3:], arm)
    return [*map(float, velocity), *map(float, b[3:] - a[3:])]


def variants(scene: Scene) -> dict[str, Scene]:
    """The lean scene, with each feature more, with all of them, and with each of its own less."""
    scene = with_period(scene, PERIOD)
    own = {**scene.parameters(), "method": "impulse"}
    more = additions(scene)
    changes: dict[str, Parameters] = {LEAN: {}}
    changes |= {WITH + name: change for name, change in more.items()}
    changes[FULL] = {key: value for change in more.values() for key, value in change.items()}
    changes |= {WITHOUT + name: change for name, change in omissions(scene).items()}
    return {name: Scene.from_parameters({**own, **change}) for name, change in changes.items()}


def measure(settings: Settings) -> Findings:
    """All scenes."""
    found = Findings()
    for case in cases.chosen(QUICK if settings.quick else ()):
        scene = cases.scene_of(settings.load, case)
        found.add(_scene(case, scene, settings))
    return found


def _scene(case: Case, scene: Scene, settings: Settings) -> Findings:
    truth = case.answer(scene, case.duration)
    found, contestants = Findings(), []
    steps = round(case.duration / PERIOD)
    for name, variant in variants(scene).items():
        state = Loop(variant, steps)()()
        sizes = cases.errors(case, scene, truth, state)
        found.measurements.append(Measurement(case.name, name, PLACE, sizes[PLACE][0], "m"))
        contestants.append(Contestant(name, timed(Batch(Connector(variant), _samples(variant)))))
    times = take_turns(contestants, settings.rounds, settings.block)
    for name, values in times.items():
        found.measurements += [
            Measurement.of(case.name, name, STEP, Spread.of(values), "µs", scale=1e6),
            Measurement.of(case.name, name, OVER, ratio(values, times[LEAN]), "1"),
        ]
    return found


def _samples(scene: Scene) -> Any:
    """What the connector is shown in the first fifth of a second."""
    run = simulate(scene, 200)
    samples = np.zeros((len(run.time), layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    samples[:, layout.LOADS] = run.plant.loads
    return samples


FEATURES = ("friction", "bending", "springs", "stops", "second body")


def text(found: Findings) -> str:
    """Two tables: features more, and features less."""
    problems = list(dict.fromkeys(m.problem for m in found.measurements))
    values = {(m.problem, m.contestant, m.quantity): m for m in found.measurements}
    more, less = [], []
    for problem in problems:
        more.append((problem, *_more(values, problem)))
        less += _less(values, problem)
    head = (
        "", "lean", "error", *(f"+ {name}" for name in FEATURES), "full", "error of the full",
    )  # fmt: skip
    return "\n\n".join(
        [
            "**An answer of the lean model, and how many times as long it takes with a feature "
            "that has no effect**\n\n" + report.table(head, more),
            "**What leaving a feature out saves and spoils**\n\n"
            + report.table(("scene", "left out", "time of lean's", "error", "error, lean"), less),
        ]
    )


Values = Mapping[tuple[str, str, str], Measurement]


def _number(values: Values, problem: str, name: str, quantity: str) -> str:
    m = values.get((problem, name, quantity))
    return "" if m is None else report.number(m.value, m.unit)


def _more(values: Values, problem: str) -> list[str]:
    row = [_number(values, problem, LEAN, STEP), _number(values, problem, LEAN, PLACE)]
    row += [_number(values, problem, WITH + name, OVER) for name in FEATURES]
    return [*row, _number(values, problem, FULL, OVER), _number(values, problem, FULL, PLACE)]


def _less(values: Values, problem: str) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name in FEATURES:
        if (problem, WITHOUT + name, OVER) in values:
            rows.append(
                (
                    problem, name, _number(values, problem, WITHOUT + name, OVER),
                    _number(values, problem, WITHOUT + name, PLACE),
                    _number(values, problem, LEAN, PLACE),
                )
            )  # fmt: skip
    return rows
