"""Method observe: forces and friction from a measured motion."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scenes import bundled, merged, pair, sleeve

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

FRICTION: dict[str, Any] = {
    "friction": {"coefficient": 0.2, "radius": 0.03, "overlap": 0.1, "preload": 3.0}
}
FORCES = slice(layout.FORCE, layout.FORCE + 6)
MEAN = ("force_friction", "moment_friction", "normal_force", "traction", "radial_force")


def scenes() -> list[Scene]:
    """An eccentric loaded sleeve on a shaft; two free bodies; two with one known inertia."""
    loaded = {"plant": {"body_b": {"load": [0.3, 0.0, 1.0, 0.02, 0.0, 0.0]}}}
    both = pair(**FRICTION)
    return [
        sleeve(v=1.0, spin=8.0, com=(0.03, 0.01, 0.02), **merged(FRICTION, loaded)),
        both,
        Scene.from_parameters(both.parameters() | {"body_a.kind": "unknown"}),
    ]


@pytest.mark.parametrize("number", range(3))
def test_it_measures_the_wrench_of_the_connector(number: int) -> None:
    """The wrench of the last interval, to second order: it acts at its middle."""
    seen_by = scenes()[number]
    errors = []
    for h in (2e-3, 1e-3, 5e-4):
        made_by = dataclasses.replace(scenes()[min(number, 1)], period=h)
        run = simulate(made_by, samples=round(0.2 / h))
        samples = np.zeros((len(run.time), layout.NSAMPLE))
        samples[:, layout.MOTION], samples[:, layout.LOADS] = run.states, run.plant.loads
        seen = Connector(dataclasses.replace(seen_by, period=h, method="observe")).run(samples)
        apart = np.abs(seen[1:, FORCES] - run.outs[:-1, FORCES]).max()
        errors.append(float(apart / np.abs(run.outs[:, FORCES]).max()))
        for name in MEAN:
            at = layout.STATE_INDEX[name]
            greatest = np.abs(run.outs[:, at]).max()
            apart = np.abs(seen[1:, at] - run.outs[:-1, at]).max()
            assert apart < 1e-2 * (h / 2e-3) ** 2 * greatest
        assert not seen[:, : layout.STATE0].any(), "it commands nothing"
        assert (seen[1:, layout.REGIME] == SLIP).all()
    assert errors[-1] < 1e-4
    assert np.log2(errors[0] / errors[2]) / 2.0 > 1.8, errors


def test_rest_is_reported_as_stick() -> None:
    """A sleeve in stick on an incline: its weight along the shaft equals friction."""
    scene = sleeve(**merged(FRICTION, {"gravity": [-0.5, 0.0, -9.81]}))
    run = simulate(scene, samples=50)
    samples = np.zeros((50, layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    seen = Connector(dataclasses.replace(scene, method="observe")).run(samples)
    assert (seen[1:, layout.REGIME] == STICK).all()
    assert seen[-1, layout.FORCE_FRICTION] == pytest.approx(2.0 * 0.5, rel=1e-9)
    assert int(seen[-1, layout.FLAGS]) & layout.STOPPED


def test_springs_dampers_and_lost_samples() -> None:
    """Spring and damper forces are subtracted; an interval may span several periods."""
    parts = {"elasticity": {"k1": 40.0}, "damping": {"c1": 0.5, "cr1": 1e-3}}
    scene = sleeve(v=1.0, spin=8.0, **merged(FRICTION, parts))
    run = simulate(scene, samples=100)
    watch = Connector(dataclasses.replace(scene, method="observe"))
    sample = np.zeros(layout.NSAMPLE)
    for k in range(0, 100, 4):
        sample[layout.MOTION] = run.states[k]
        out = watch.step(sample, 4.0 * scene.period if k else 0.0)
    span = run.outs[92:96]
    for name in ("force_friction", "force_elastic", "force_viscous", "moment_viscous"):
        at = layout.STATE_INDEX[name]
        assert out[at] == pytest.approx(span[:, at].mean(), rel=2e-3)


def test_it_needs_an_inertia() -> None:
    settings = scenes()[0].parameters() | {"method": "observe", "body_b.kind": "unknown"}
    with pytest.raises(SceneError, match="method = 'observe': needs mass and inertia of a body"):
        Scene.from_parameters(settings)


def test_a_load_that_arrives_late_is_no_reaction() -> None:
    """It is taken up for the sample that it belongs to, before the next one is processed."""
    scene = bundled("drawer_slide")
    moved = simulate(scene, samples=40)
    in_time, late = (Connector(dataclasses.replace(scene, method="observe")) for _ in range(2))
    sample, without = np.zeros(layout.NSAMPLE), np.zeros(layout.NSAMPLE)
    for k, state in enumerate(moved.states):
        sample[layout.MOTION] = without[layout.MOTION] = state
        load = np.array([10.0 + k, 2.0, 0.0, 0.0, 0.1, -1.0])
        sample[layout.B_LOAD : layout.B_LOAD + 6] = load
        np.testing.assert_array_equal(late.step(without), in_time.step(sample))
        late.correct_load(1, load.tolist())
