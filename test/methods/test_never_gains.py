"""Law N: held wrenches put no energy into bodies that turn far against long arms."""

from pathlib import Path

import numpy as np
import pytest

from cylconn_ros.core import layout
from cylconn_ros.laws import residuals
from cylconn_ros.laws.runs import simulated
from cylconn_ros.methods import never_gains
from cylconn_ros.scene.scene import load
from cylconn_ros.simulation.closed_loop import closed_loop

SCENES = sorted((Path(__file__).parent / "tumbling").glob("*.yaml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_tumbling_pair_with_long_arms_never_gains_energy(path: Path) -> None:
    scene = load(path)
    run = closed_loop(scene, 300)
    energy = run.energy
    assert np.isfinite(energy).all()
    rise = np.max(energy - np.minimum.accumulate(energy))
    assert rise < 2.0 * never_gains.ALLOWED_RISE * energy[0]
    flags = run.outs[:, layout.FLAGS].astype(int)
    assert (flags & (layout.GAINS_LOWERED | layout.MISALIGNED | layout.UNDERSAMPLED)).any()
    block, _ = next(simulated(scene, "impulse", run.states, run.outs).blocks())
    found = residuals.check(block, in_order=True)["never_gains"]
    assert np.nanmax(found) == 0.0
    assert (~np.isnan(found)).sum() > 100


def test_the_checker_sees_a_wrench_that_gains() -> None:
    scene = load(SCENES[0])
    run = closed_loop(scene, 40)
    outs = run.outs.copy()
    outs[:, layout.FORCE_A : layout.STATE0] *= 3.0
    block, _ = next(simulated(scene, "impulse", run.states, outs).blocks())
    assert np.nanmax(residuals.check(block)["never_gains"]) > 1e-3
