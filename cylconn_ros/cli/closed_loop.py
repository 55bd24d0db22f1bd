"""``cylconn replay --closed-loop``: what would have happened, beside what did."""

from __future__ import annotations

import argparse

import numpy as np

from cylconn_ros.cli import changes, simulate
from cylconn_ros.cli.progress import Progress
from cylconn_ros.cli.replay_report import lacking
from cylconn_ros.connector.summary import RunSummary, summarise
from cylconn_ros.errors import CommandError
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.run import Run
from cylconn_ros.replay import closed_loop
from cylconn_ros.scene.scene import Scene


def run(bag: Bag, scene: Scene, before: Scene, options: argparse.Namespace) -> int:
    """Simulate ``scene`` from the first recorded state; 0 unless it comes to nothing.

    ``before``: the scene of the recording, with which the recorded motion is evaluated.
    """
    if options.compare:
        raise CommandError("--closed-loop: the motion is another one; --compare is for replay")
    if options.output is not None and options.output.exists():
        raise CommandError(f"{options.output} exists; a run is never overwritten")
    remap = dict(text.split(":=", 1) for text in options.remap if ":=" in text)
    run_ = Run(bag.source)
    run_ = run_.select(options.connector) if options.connector else run_
    with Progress(f"replay {bag.path.name} in closed loop") as bar:
        bar.note("reading (the first run compiles the physics)")
        motion = closed_loop.recorded_motion(run_, before, remap)
        outs = closed_loop.along(before, motion)
        result = closed_loop.simulate_from(scene, motion, progress=bar)
    stamps = motion.samples.stamps
    recorded = _summary(np.asarray((stamps - stamps[0]) * 1e-9, np.float64), outs)
    found = summarise(result.time, simulate.fields(result))
    print(f"model       {result.connector.model}")
    print(
        f"closed loop from the first recorded state, {len(result.time)} samples, "
        f"{len(motion.commands)} commands; recorded: {len(stamps)} samples"
    )
    print("\n".join(changes.table(("recorded", "closed loop"), recorded, found)))
    for name, summary in (("recorded", recorded), ("closed loop", found)):
        if summary.problem:
            print(f"NOT USABLE  {name}: {summary.problem}")
    if text := lacking(bag):
        print(text)
    if options.output is not None:
        simulate.keep(result, scene, options.output)
        print(f"kept        {options.output}\nnext: cylconn info {options.output}")
    else:
        print("next: keep the run with -o NAME")
    return 0 if not found.problem and not recorded.problem and not text else 1


def _summary(time: np.ndarray, outs: np.ndarray) -> RunSummary:
    """Summary of outputs (n, NOUT) at times (n,)."""
    return summarise(time, simulate.columns(outs))
