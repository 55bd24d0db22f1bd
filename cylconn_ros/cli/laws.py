"""Check the laws of the connector's step from outside: random states, the library, recorded runs.

Two bodies, parameters and states are drawn over extreme scales, each extreme jointly with the
others: mass and inertia ratios 1e-6 to 1e6, periods 0.1 to 100 ms, mu up to 10, mass centres metres
off the axis, spins up to 1000 rad/s, stops, locks, imposed motions. Then the method runs the scene
library. The answers are checked against the laws that the method claims, by their letters
(docs/laws.md), written without the solver's code. Exit code 1 where a law does not hold to 1e-12.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli import laws_report as report
from cylconn_ros.cli.checks import add_connector
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError
from cylconn_ros.laws import runs_recorded_or_simulated

if TYPE_CHECKING:
    from cylconn_ros.laws.order import Fit
    from cylconn_ros.laws.selection import Verdict
    from cylconn_ros.laws.summary import Tally

_ENOUGH = 100_000  # samples from which on shares of regimes are judged
_STEERED_TO = "impulse"  # whose regimes the draw is steered to
_SLOW = "minimal"  # a random step of it takes milliseconds: its samples are those of the library


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "--samples", type=_count, metavar="N", help="random samples (100000; minimal: 0)"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the draw (1)")
    parser.add_argument(
        "--method", default="impulse", metavar="M", help="method that answers (impulse)"
    )
    parser.add_argument(
        "--roots",
        type=_count,
        default=20_000,
        metavar="N",
        help="samples whose friction is solved again by brute force (20000, 0: none)",
    )
    parser.add_argument(
        "--library",
        type=_count,
        default=500,
        metavar="N",
        help="samples of each scene of the library at most (500, 0: none)",
    )
    parser.add_argument(
        "--no-order", action="store_true", help="leave out the orders of convergence"
    )
    parser.add_argument(
        "--scene", type=int, metavar="K", help="only the random scene K, as a report names it"
    )
    parser.add_argument(
        "--run", dest="recording", type=Path, metavar="RUN", help="a recorded run's samples instead"
    )
    add_connector(parser)


@dataclasses.dataclass
class _Found:
    """All that was checked."""

    random: Tally
    library: Tally
    verdict: Verdict | None = None
    runs: int = 0
    refused: dict[str, str] = dataclasses.field(default_factory=dict)
    instants: Tally | None = None
    momentum: float = 0.0
    fits: list[Fit] = dataclasses.field(default_factory=list)

    def broken(self) -> list[str]:
        """The letters of what did not hold."""
        from cylconn_ros.laws.claims import TITLES
        from cylconn_ros.laws.pointwise import MOMENTUM

        tallies = [self.random, self.library, *([self.instants] if self.instants else [])]
        off = [
            letter
            for letter in TITLES
            if any(letter in t.laws and not t.laws[letter].holds for t in tallies)
        ]
        off += ["roots"] if self.verdict is not None and self.verdict.faults else []
        off += ["momentum"] if self.momentum > MOMENTUM else []
        return off + (["O"] if not all(fit.holds for fit in self.fits) else [])


def run(options: argparse.Namespace) -> int:
    """Check and report; 0 if every law holds."""
    begin = time.monotonic()
    if options.recording is not None:
        return _recorded(options)
    from cylconn_ros.laws.claims import CLAIMS
    from cylconn_ros.laws.summary import Tally

    if options.method not in CLAIMS:
        known = ", ".join(CLAIMS)
        raise CommandError(f"--method {options.method}: laws are stated for {known}")
    if options.samples is None:
        options.samples = 0 if options.method == _SLOW and options.scene is None else 100_000
    found = _Found(Tally(), Tally())
    with Progress("laws") as bar:
        bar.note("preparing (the first run compiles the physics)")
        _samples(options, found, bar)
    if options.scene is None and options.library:
        with Progress("library") as bar:
            _library(options, found, bar)
    if options.scene is None and not options.no_order and options.method == "impulse":
        from cylconn_ros.laws import order

        with Progress("order of convergence") as bar:
            found.fits = order.fits(bar)
    drawn = f"{found.random.samples} samples, seed {options.seed}"
    print(f"method {options.method}: {drawn}, {time.monotonic() - begin:.0f} s\n")
    lines = [*report.laws(found.random), *report.regimes(found.random)]
    lines = lines if found.random.samples else []
    lines += [
        *report.roots(found.verdict),
        *report.library(found.library, found.runs, found.refused),
    ]
    lines += [*report.pointwise(found.instants, found.momentum), *report.orders(found.fits)]
    print("\n".join(lines))
    steered = options.method == _STEERED_TO and found.random.samples >= _ENOUGH
    few = found.random.scarce() if steered else []
    if few:
        print(f"\nless than 1 % of the samples in regime {', '.join(few)}: nothing is proven there")
    off = found.broken()
    print(_next(options, found.random, found.verdict, off))
    return 1 if off or few else 0


def _samples(options: argparse.Namespace, found: _Found, bar: Progress) -> None:
    """Check the random samples, and the roots of as many of them as asked for."""
    from cylconn_ros.laws import residuals, sampling, selection

    if options.roots and options.method == "impulse":
        found.verdict = selection.Verdict()
    if options.scene is not None:
        numbers = range(options.scene // sampling.BLOCK, options.scene // sampling.BLOCK + 1)
    else:
        numbers = range(sampling.blocks_for(options.samples) if options.samples else 0)
    total = len(numbers) * sampling.LENGTH
    for done, drawn in enumerate(_drawn(options, numbers)):
        checked = residuals.check(drawn.block, options.method)
        rows = slice(None) if options.scene is None else drawn.number == options.scene
        where = (drawn.number[rows], drawn.chain[rows], drawn.place[rows])
        chosen = {letter: values[rows] for letter, values in checked.items()}
        found.random.add(chosen, drawn.block.out[rows], where)
        if found.verdict is not None and found.verdict.samples < options.roots:
            found.verdict.add(selection.judge(drawn.block), drawn.number, drawn.chain, drawn.place)
        bar(done + 1, total)


def _drawn(options: argparse.Namespace, numbers: range) -> Iterator:
    from cylconn_ros.laws import sampling

    for number in numbers:
        yield from sampling.blocks(options.seed, number, options.method)


def _library(options: argparse.Namespace, found: _Found, bar: Progress) -> None:
    """The method's own runs; of minimal also the motion that its wrenches are means of."""
    from cylconn_ros.laws import library, residuals
    from cylconn_ros.laws.summary import Tally
    from cylconn_ros.reference.library import LIBRARY
    from cylconn_ros.scene.resources import shipped_scenes
    from cylconn_ros.scene.scene import load

    files = shipped_scenes()
    asked = {name: load(files[name]) for name in LIBRARY}
    scenes, found.refused = library.served(asked, options.method)
    found.runs = len(scenes)
    for done, (name, scene) in enumerate(scenes.items()):
        for block, index in library.run(scene, options.library).blocks():
            tally = Tally()
            tally.add(residuals.check(block, options.method), block.out, (index,))
            found.library.merge(tally.named(name))
        if options.method == "minimal":
            _instants(found, name, scene)
        bar(done + 1, len(scenes))


def _instants(found: _Found, name: str, scene: object) -> None:
    import numpy as np

    from cylconn_ros.laws import pointwise
    from cylconn_ros.laws.summary import Tally
    from cylconn_ros.scene.scene import Scene

    assert isinstance(scene, Scene)
    residuals, momentum = pointwise.check(scene)
    n = len(residuals["D"])
    tally = Tally()
    tally.count(residuals, n, (np.arange(n),))
    found.instants = found.instants or Tally()
    found.instants.merge(tally.named(name))
    found.momentum = max(found.momentum, momentum)


def _next(
    options: argparse.Namespace, tally: Tally, verdict: Verdict | None, off: list[str]
) -> str:
    if not off:
        return "\nall hold (next: --samples 1000000, another --seed, --run RUN for a recording)"
    places = [law.where for letter, law in tally.laws.items() if letter in off and law.over]
    places += verdict.where if verdict is not None else []
    text = f"\nBROKEN: {', '.join(off)}"
    if options.recording is None and options.scene is None and places:
        scene = places[0].split("/")[0]
        text += f" (next: cylconn laws --seed {options.seed} --scene {scene} --no-order)"
    return text


def _recorded(options: argparse.Namespace) -> int:
    """Check the samples of a recorded run."""
    with Progress("laws") as bar:
        recorded, tally = runs_recorded_or_simulated.checked(
            options.recording, bar, options.connector
        )
    print(f"method {recorded.method}: {tally.samples} samples of {options.recording}\n")
    print("\n".join([*report.laws(tally, "sample"), *report.regimes(tally)]))
    if recorded.left_out:
        print(f"\n{recorded.left_out} states left out: {recorded.why}")
    off = [letter for letter, law in tally.laws.items() if not law.holds]
    print(_next(options, tally, None, off))
    return 0 if tally.holds and tally.samples else 1


def _count(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text}: must not be negative")
    return value
