"""The laws of a run, in process or recorded, for whoever is in a room that does not know them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.errors import CommandError
from cylconn_ros.scene.packing import choose_method
from cylconn_ros.scene.scene import Scene

if TYPE_CHECKING:
    from cylconn_ros.laws.runs import Recorded
    from cylconn_ros.laws.summary import Tally

Array = NDArray[np.float64]


def broken(scene: Scene, states: Array, outs: Array) -> str:
    """The first law that answers ``outs`` (N, NOUT) to ``states`` (N, 26) break, and how much.

    Empty: every law that the scene's method claims holds, for every sample from the first on.
    """
    from cylconn_ros.laws import claims, residuals
    from cylconn_ros.laws.normalised import TOLERANCE
    from cylconn_ros.laws.runs import Recorded

    method = choose_method(scene)
    if method not in claims.CLAIMS:
        return ""
    n = len(states)
    samples = np.zeros((n, layout.NSAMPLE))
    samples[:, layout.MOTION] = states
    begins, periods = np.arange(n) == 0, np.full(n, scene.period)
    run = Recorded(method, scene, samples, outs, periods, periods, begins, 0, "")
    block, _ = next(run.blocks())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a run that is lost goes through here too
        found = residuals.check(block, method)
    for letter, values in found.items():
        worst = float(np.max(values, initial=0.0, where=~np.isnan(values)))
        if not worst <= TOLERANCE:
            return f"law {letter} ({claims.TITLES[letter]}) off by {worst:.1e}"
    return ""


def checked(
    run: Path, progress: Callable[[int, int], object], connector: str = ""
) -> tuple[Recorded, Tally]:
    """The samples of a recorded run, of the connector named, and what the laws say of them.

    Raises CommandError where none are stated for such a run, RecordingError where it cannot be
    read.
    """
    from cylconn_ros.laws import residuals
    from cylconn_ros.laws.claims import CLAIMS
    from cylconn_ros.laws.runs import samples_of
    from cylconn_ros.laws.summary import Tally
    from cylconn_ros.recording.connector_part import refuse_together
    from cylconn_ros.recording.run import read_run

    tally = Tally()
    found = read_run(run, connector)
    refuse_together(found.metadata, connector, "its laws are not those of one alone")
    recorded = samples_of(found)
    if recorded.method not in CLAIMS:
        raise CommandError(f"{run}: no laws are stated for method {recorded.method}")
    if recorded.scene.latency != 0:
        raise CommandError(
            f"{run}: latency = {recorded.scene.latency}: its answers are for "
            "predicted states, which are not in the recording; no laws are stated for them"
        )
    for done, (block, index) in enumerate(recorded.blocks()):
        checked = residuals.check(block, recorded.method)
        tally.add(checked, block.out, (index,))
        progress(done + 1, recorded.parts)
    return recorded, tally
