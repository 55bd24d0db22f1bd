"""Chains of bodies whose friction grows with its own reactions, almost to a jam, and redundancy."""

from typing import Any

import numpy as np

from cylconn_ros.connector.group import Group
from cylconn_ros.core import layout
from cylconn_ros.laws import together
from cylconn_ros.laws.runs import RunSamples
from cylconn_ros.laws.summary import LawSummary
from cylconn_ros.scene.scene import several

PERIOD = 1e-3


def _direction(rng):
    q = rng.normal(size=4)
    return (q / np.linalg.norm(q)).tolist()


def _chain(rng):
    """Two to four bodies, the first on the ground, each on an arm with a coupling of up to 0.99."""
    n = int(rng.integers(2, 5))
    found: dict[str, Any] = {"period": PERIOD, "connectors": [f"at{k}" for k in range(n)]}
    bodies: list[dict[str, Any]] = [{"frame": "ground", "kind": "fixed"}]
    for k in range(n):
        mass, r = 10.0 ** rng.uniform(-1.0, 1.5), 10.0 ** rng.uniform(-1.5, -0.3, 3)
        moments = mass * (r[[1, 0, 0]] ** 2 + r[[2, 2, 1]] ** 2) / 2.0
        inertia = [moments[0], 0.0, 0.0, moments[1], 0.0, moments[2]]
        bodies.append({"frame": f"b{k}", "kind": "free", "mass": mass, "inertia": inertia})
    for k in range(n):
        mu, c = rng.uniform(0.05, 0.6), rng.choice([0.99, rng.uniform(0.1, 0.99)])
        node_a = {"position": (0.2 * rng.normal(size=3)).tolist(), "orientation": _direction(rng)}
        found[f"at{k}"] = {
            "body_a": bodies[k],
            "body_b": bodies[k + 1],
            "node_a": node_a,
            "node_b": {"position": (0.2 * rng.normal(size=3)).tolist()},
            "friction": {
                "coefficient": mu,
                "radius": 10.0 ** rng.uniform(-2.3, -1.0),
                "overlap": 0.4 * mu / c,
            },
        }
    return list(several(found).values())


def _loaded(rng, scenes, places):
    """Samples (N, NSAMPLE) of bodies at rest at ``places``, under random loads."""
    loads = {f: 10.0 ** rng.uniform(-1.0, 1.0) * rng.normal(size=6) for f in places}
    found = np.zeros((len(scenes), layout.NSAMPLE))
    for c, scene in enumerate(scenes):
        for body, pose, load in (
            (scene.body_a, layout.A_POSE, layout.A_LOAD),
            (scene.body_b, layout.B_POSE, layout.B_LOAD),
        ):
            found[c, pose : pose + 7] = places.get(body.frame, [0.0] * 6 + [1.0])
            if body.frame in loads:
                found[c, load : load + 6] = loads[body.frame] * [20.0, 20.0, 20.0, 1.0, 1.0, 1.0]
    return found


def test_chains_near_a_jam_are_solved_and_satisfy_the_laws():
    """The laws are checked without the solver's code, each connector with the others known."""
    rng = np.random.default_rng(7)
    summary, samples = LawSummary(tolerance=together.TOLERANCE), 0
    for _ in range(150):
        scenes = _chain(rng)
        frames = [scene.body_b.frame for scene in scenes]
        places = {f: [*(0.3 * rng.normal(size=3)), *_direction(rng)] for f in frames}
        group = Group(scenes)
        runs: list[list[tuple[Any, Any]]] = [[] for _ in scenes]
        for _ in range(3):
            sample = _loaded(rng, scenes, places)
            outs = group.step(sample)
            assert outs[:, layout.RESIDUAL].max() < 1e-9
            samples += len(scenes)
            for c, run in enumerate(runs):
                run.append((sample[c], outs[c].copy()))
        periods, begins = np.full(3, PERIOD), np.arange(3) == 0
        checked = {
            f"at{c}": RunSamples(
                "impulse", scenes[c], np.array([s for s, _ in run]),
                np.array([o for _, o in run]), periods, periods, begins,
            )
            for c, run in enumerate(runs)
        }  # fmt: skip
        together.check(checked, summary)
    assert {law: one.worst for law, one in summary.laws.items() if not one.holds} == {}
    assert summary.laws["friction_limit"].samples == samples
