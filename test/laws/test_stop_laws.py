"""Runs at stops hold the laws, and the checker sees impacts and rest that are wrong.

The physics runs uncompiled in a process of its own, so that parts of it can be replaced.
"""

import json
import os
import subprocess
import sys
from typing import Any

import pytest
from paths import ROOT

# Mistakes as changes to the uncompiled physics, and the runs that have to violate the law of stops.
MISTAKES = {
    "nothing": ("", []),
    "impacts as if nothing accelerated the body": (
        """
def unloaded(gap, w, end, h, explicit):
    return w * (min(max(-gap / (h * w), 0.5), 1.5) - 0.5)
contacts.first_rate = unloaded
""",
        ["bounces", "bounces with friction", "semi-implicit", "spin"],
    ),
    "no acceleration after the impact": (
        """
def still(*given):
    return leaving(*given)._replace(end=given[-1])
contacts.leaving = still
""",
        ["bounces", "bounces with friction", "semi-implicit", "spin"],
    ),
    "friction as before the rebound": (
        """
def before(par, mem, o, r, sp, h, explicit, b1, b2, rates):
    now = o.twist.v[0], o.twist.w[0]
    s = leaving(par, mem, o, r, sp, h, explicit, b1, b2, now)
    return s._replace(end=(rates[0] + s.end[0] - now[0], rates[1] + s.end[1] - now[1]))
contacts.leaving = before
""",
        ["bounces with friction", "spin"],
    ),
    "rest at a stop is slip of rounding": (
        "contacts.is_at_rest = lambda *given: False",
        ["pressed"],
    ),
}
DRIVER = """
import json, sys
import numpy as np
import cylconn_ros as cr
from cylconn_ros.laws import residuals
from cylconn_ros.laws.runs import simulated
from cylconn_ros.methods.free_axes import complementarity, contacts

def scene(mass=2.0, upright=True, **given):
    half = 0.5**0.5
    node = (0.0, -half, 0.0, half) if upright else (0.0, 0.0, 0.0, 1.0)
    body = cr.Body(kind="free", mass=mass, inertia=(0.01, 0.0, 0.0, 0.02, 0.0, 0.02))
    return cr.Scene(
        body_a=cr.Body(kind="fixed"), body_b=body, node_a=cr.Node(orientation=node), **given
    )

rubbing = cr.Friction(coefficient=0.3, radius=0.02, preload=5.0)
low = cr.Stops(l_min=-0.013, restitution=0.6)
moving = cr.PlantSettings(body_b=cr.PlantBody(twist=(0.3, 0.0, 0.0, 1.0, 0.0, 0.0)))
fast = cr.PlantSettings(body_b=cr.PlantBody(twist=(1.0, 0.0, 0.0, 5.0, 0.0, 0.0)))
scenes = {
    "bounces": scene(period=2e-3, stops=low),
    "bounces with friction": scene(period=2e-3, stops=low, friction=rubbing),
    "semi-implicit": scene(period=2e-3, stops=low, plant_integration="semi_implicit"),
    "spin": scene(
        upright=False, period=5e-3, friction=rubbing, plant=moving,
        stops=cr.Stops(theta_max=0.1, restitution=0.5),
        command=cr.Command(spin=cr.Imposed(force=0.2)),
    ),
    "pressed": scene(
        upright=False, period=5e-3, stops=cr.Stops(l_max=0.05), plant=fast,
        friction=cr.Friction(coefficient=0.6, radius=0.02, overlap=0.1),
        command=cr.Command(slide=cr.Imposed(force=50.0)),
    ),
}
modules, leaving = [complementarity, contacts], contacts.leaving
original, found = [dict(vars(module)) for module in modules], {}
for name, change in json.loads(sys.argv[1]).items():
    exec(change, globals())
    for title, given in scenes.items():
        run = cr.simulate(given, samples=100)
        block, _ = next(simulated(given, "impulse", run.states, run.outs).blocks())
        values = residuals.check(block)
        wrong = [law for law, v in values.items() if np.nanmax(v, initial=0.0) > 1e-12]
        found.setdefault(name, {})[title] = wrong, float(np.mean(np.isnan(values["stops"])))
    for module, names in zip(modules, original):
        vars(module).update(names)
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def found() -> dict[str, dict[str, list[Any]]]:
    """Violated laws and share of samples whose stops are not checked, by mistake and run."""
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            DRIVER,
            json.dumps({name: how for name, (how, _) in MISTAKES.items()}),
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "CYLCONN_NO_COMPILER": "1"},
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, dict[str, list[Any]]] = json.loads(done.stdout)
    return result


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_at_stops_is_detected(found: dict[str, dict[str, list[Any]]], name: str) -> None:
    wrong = {title for title, (laws, _) in found[name].items() if "stops" in laws}
    assert wrong >= set(MISTAKES[name][1])


def test_runs_at_stops_hold_all_laws(
    found: dict[str, dict[str, list[Any]]],
) -> None:
    assert {
        title: result for title, result in found["nothing"].items() if result != [[], 0.0]
    } == {}
