"""Problems with an answer from elsewhere: a scene, what is asked of its motion, and who says so."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench import frames
from cylconn_ros.bench.settings import SceneLoader
from cylconn_ros.bench.work import Errors
from cylconn_ros.connector.scene import Friction, Scene
from cylconn_ros.connector.simulation import Run
from cylconn_ros.core import layout
from cylconn_ros.reference import coast, constant_normal_force, free_pair, slide_and_spin


@dataclass(frozen=True)
class Problem:
    """One motion of ``duration`` s, and the errors of a run of it, whatever its period."""

    name: str
    scene: Scene
    duration: float
    errors: Callable[[Run], Errors]
    source: str


def handful(load: SceneLoader) -> Iterator[Problem]:
    """The problems whose orders are fitted; periods up to 4 ms divide their durations."""
    yield _coast(load("coast"))
    yield _constant_normal_force(load("slide_and_spin"))
    yield _clamp(load("demo"))
    yield _slider(load("incline"))
    yield _creep(load("incline"))
    yield _pair("two free bodies 1000:1, no friction", load("free_flight"))
    friction = Friction(coefficient=0.1, radius=0.02, overlap=0.08)
    scene = dataclasses.replace(load("free_flight"), friction=friction)
    yield _pair("two free bodies 1000:1, friction", scene)


def _coast(scene: Scene) -> Problem:
    friction, body = scene.friction, scene.body_b
    speed = scene.initial_twist(1)[0]
    time, distance = coast(
        friction.coefficient, math.hypot(*scene.gravity), friction.preload, body.mass, speed
    )
    return Problem(
        "coast", scene, 0.6,
        lambda run: {**_stop(run, time), **_distance(run, distance)},
        "closed form, constant deceleration",
    )  # fmt: skip


def _constant_normal_force(scene: Scene) -> Problem:
    start, friction = scene.initial_twist(1), scene.friction
    tau = start[0] / (friction.coefficient * math.hypot(*scene.gravity))
    time, distance = constant_normal_force(friction.radius * start[3] / start[0], start[0], tau)
    return Problem(
        "slide and spin", scene, 0.8,
        lambda run: {**_stop(run, time), **_distance(run, distance)},
        "closed form, slide and spin on one disc under a constant normal force",
    )  # fmt: skip


def _clamp(scene: Scene) -> Problem:
    duration = 4.0
    truth = slide_and_spin(scene, duration)
    return Problem(
        "demo", scene, duration,
        lambda run: {
            **_stop(run, truth.stop_time),
            **_distance(run, truth.distance),
            "spin": (abs(run.state("rotation")[-1] - 2.0 * math.pi * truth.turns), "rad"),
            **_violation(run),
        },
        "reduced equations of motion, DOP853",
    )  # fmt: skip


def _slider(scene: Scene) -> Problem:
    slope = frames.rotation(scene.node_a.orientation)[:, 0]
    down = float(slope @ np.array(scene.gravity))
    across = math.sqrt(math.hypot(*scene.gravity) ** 2 - down**2)
    distance = 0.5 * (down - scene.friction.coefficient * across)  # after 1 s
    return Problem(
        "slider on an incline", scene, 1.0, lambda run: _distance(run, distance),
        "closed form, a = g (sin b - mu cos b)",
    )  # fmt: skip


def _creep(scene: Scene) -> Problem:
    friction = dataclasses.replace(scene.friction, coefficient=1.0)
    return Problem(
        "stick on an incline", dataclasses.replace(scene, friction=friction), 1.0,
        lambda run: {"creep": (abs(float(run.state("displacement")[-1])), "m")},
        "below the friction angle it stays",
    )  # fmt: skip


def _pair(name: str, scene: Scene) -> Problem:
    duration = 0.48
    truth = free_pair(scene, duration)

    def errors(run: Run) -> Errors:
        place, _ = frames.com(scene.body_b, run.states[-1, 13:])
        return {
            "place of B": (float(np.abs(place - truth.com_b).max()), "m"),
            **_distance(run, truth.distance),
            "spin": (abs(float(run.state("rotation")[-1]) - truth.angle), "rad"),
            **_violation(run),
        }

    source = "Newton-Euler with multipliers, DOP853"
    return Problem(name, scene, duration, errors, source)


def _stop(run: Run, time: float) -> Errors:
    """Of the time of coming to rest; NaN where the method does not say one."""
    stops = np.flatnonzero(run.state("stop_time") >= 0.0)
    at_rest = run.outs[-1, layout.REGIME] == layout.STICK
    if not len(stops) or not at_rest:
        return {"stop time": (math.nan, "s")}
    last = stops[-1]
    return {"stop time": (abs(float(run.time[last] + run.state("stop_time")[last]) - time), "s")}


def _distance(run: Run, distance: float) -> Errors:
    return {"distance": (abs(float(run.state("displacement")[-1]) - distance), "m")}


def _violation(run: Run) -> Errors:
    return {"constraint": (float(np.abs(run.state("offset_violation")).max()), "m")}
