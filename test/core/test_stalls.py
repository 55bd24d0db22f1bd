"""Stalls of a free-running loop: the wrench that is held is no latency, nor are overtaken ones."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenes import bundled

from cylconn_ros.bench.faults import free_running
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.simulation.plant import Plant


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
def test_a_stall_is_no_latency(integration: str) -> None:
    """Stops of 50 ms at 500 Hz: rotating bodies are held, and the latency stays what it was."""
    scene = dataclasses.replace(
        bundled("demo"), method="impulse", period=0.002, tolerance=0.0,
        plant_integration=integration,
    )  # fmt: skip
    lag = free_running.Lag(0.0, "stall")
    motion, exact = free_running.run(scene, lag), free_running.run(scene, None)
    assert free_running.failures(scene, exact, motion, lag) == []
    assert motion.latency < 0.2


@pytest.mark.parametrize("gap", [1.7, 30.0])
def test_stamps_of_a_clock_do_not_stretch_a_motion_of_whole_steps(gap: float) -> None:
    """A wrench acts one sample late; one sample is stamped too late, the motion goes on evenly."""
    scene = dataclasses.replace(
        bundled("drawer_slide"), method="impulse", period=0.002, tolerance=0.0, latency=-1
    )
    outs = []
    for stretch in (1.0, gap):
        plant, connector = Plant(scene), Connector(scene)
        plant.state[20] = 0.5
        sample, rows = np.zeros(layout.NSAMPLE), []
        acting: np.ndarray = np.zeros(12)
        for k in range(120):
            sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
            out = connector.step(sample, scene.period * (stretch if k == 60 else 1.0))
            rows.append(out.copy())
            plant.step(acting[:6], acting[6:])
            acting = out[: layout.STATE0].copy()
        flags = np.array(rows)[:, layout.FLAGS].astype(int)
        assert not (flags & layout.TWIST_CONTRADICTS).any()
        outs.append(np.array(rows)[:, : layout.STATE0])
    np.testing.assert_allclose(outs[1], outs[0], atol=1e-9)
