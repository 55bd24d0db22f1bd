"""Compile the physics into the cache, so that nodes and commands start without compiling.

Compiled is what connector and plant need for the given scenes; without scenes for every method, and
what identify needs. What the cache already has is loaded only. The cache belongs to this version of
the package, to the installed numba and to the processor: run this command again after an update.

For example: cylconn compile        every method
             cylconn compile demo   the method of one scene

Next: connector and plant start without compiling.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from cylconn_ros.cli import scenes as scene_files
from cylconn_ros.cli.progress import Progress
from cylconn_ros.methods.traits import LIVE, TRAITS
from cylconn_ros.scene.resources import shipped
from cylconn_ros.scene.scene import Scene, load

_GAINS = {"penalty.stiffness": 1e5, "penalty.damping": 1e2, "penalty.rotational_stiffness": 1e3}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "scene", nargs="*", help="parameter file or bundled scene (default: every method)"
    )


def run(options: argparse.Namespace) -> int:
    """Compile with progress; 0."""
    from cylconn_ros.core import jit

    if not jit.COMPILED:
        print("nothing is compiled: numba is not installed, or CYLCONN_NO_COMPILER is set")
        return 0
    given = [load(scene_files.find(name)) for name in options.scene]
    wanted = {f"scene_{k}": one for k, one in enumerate(given)} if given else every_method()
    begin = time.monotonic()
    count = compile_with_progress(wanted, coupled=not given)
    cache = jit.CACHE_DIRECTORY or "none: no directory can be written"
    print(f"{count} functions compiled in {time.monotonic() - begin:.1f} s; cache: {cache}")
    return 0


def every_method() -> dict[str, Scene]:
    """A scene for every method of a node."""
    base = load(shipped("demo"))
    return {
        name: base.replace({"method": name, **(_GAINS if TRAITS[name].uses_gains else {})})
        for name in LIVE
    }


def compile_with_progress(scenes: Mapping[str, Scene], coupled: bool = False) -> int:
    """Compile what connector and plant need for scenes, each on its own; show the progress.

    ``coupled``: also what connectors that share a body need, and identify. Returns the number of
    functions that were compiled; without any, nothing is shown.
    """
    from cylconn_ros.core import jit, plant
    from cylconn_ros.identification.likelihood import search_kernel
    from cylconn_ros.methods.coupled.step import step_group
    from cylconn_ros.ros import compiling

    by_method = {compiling.choose_method(scene): scene for scene in scenes.values()}
    shared = [step_group, search_kernel.search] if coupled else []
    roots = [*compiling.kernels(by_method), plant.step, plant.energy, *shared]
    with _shown(jit.reached_from(roots)) as report, jit.watched(report.count):
        for name, scene in by_method.items():
            compiling.compile_kernels({"": scene})
            if coupled and TRAITS[name].couples:
                compiling.compile_kernels({"a": scene, "b": scene})
        _compile_plant(next(iter(scenes.values())))
        if coupled:
            _compile_identification()
    return report.done


def _compile_plant(scene: Scene) -> None:
    import numpy as np

    from cylconn_ros.simulation.plant import Plant

    if scene.constraint == "simulator":  # the plant has no joint; the simulator is another one
        return
    plant = Plant(scene)
    plant.energy()
    plant.step(np.zeros(6), np.zeros(6))


def _compile_identification() -> None:
    import numpy as np

    from cylconn_ros.identification.likelihood import search_kernel, windows_kernel

    law = np.ones(windows_kernel.DECAY + 1)
    search_kernel.search(
        np.ones((1, windows_kernel.COLUMNS)), np.zeros(4), np.ones(4), np.ones(5),
        np.zeros(1, np.int64), law, 0, np.empty((4, 1)), np.empty((1, 4)), np.empty(2),
        np.empty((2, 1)), np.empty((7, len(law))),
    )  # fmt: skip


class _Report:
    """Shows the progress from the first function on that is compiled."""

    def __init__(self, total: int) -> None:
        self.done, self._total = 0, total
        self._bar: Progress | None = None

    def count(self, done: int, _name: str) -> Any:
        """``done`` functions have been compiled."""
        self.done = done
        if self._bar is None:
            self._bar = Progress("compiling")
            self._bar.note("the physics is compiled once, for this version and this processor")
        self._bar(min(done, self._total - 1), self._total)

    def close(self) -> None:
        """All is done."""
        if self._bar is not None:
            self._bar(1, 1)
            self._bar.close()


@contextmanager
def _shown(total: int) -> Iterator[_Report]:
    report = _Report(total)
    yield report
    report.close()
