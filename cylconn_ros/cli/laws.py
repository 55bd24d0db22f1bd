"""Check the laws of a connector step independently, on random states, scenes or a recorded run.

Bodies, parameters and states are random over extreme scales, each extreme jointly with the others:
mass and inertia ratios 1e-6 to 1e6, periods 0.1 to 100 ms, mu up to 10, mass centres metres off the
axis, angular velocities up to 1000 rad/s, stops, locks, imposed motions. Then the method runs the
bundled scenes. The outputs are checked against the laws that the method guarantees; the check
shares no code with the solver. The exit code is 1 if a law does not hold to 1e-12 (1e-9 for
connectors that share bodies).

For example:
  cylconn laws --samples 20000
  cylconn laws --run RUN
  cylconn laws --run BAG --params scene.yaml    (a bag of ros2 bag record)

Next: reproduce one random scene of a report with --seed S --scene K.
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
from cylconn_ros.laws.guarantees import GUARANTEES, LAWS, title
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.scene import load

if TYPE_CHECKING:
    from cylconn_ros.laws.order import Fit
    from cylconn_ros.laws.sampling import SampledBlock
    from cylconn_ros.laws.selection import SelectionSummary
    from cylconn_ros.laws.summary import LawSummary
    from cylconn_ros.scene.scene import Scene

_SAMPLES = 100_000  # random samples by default; from this number on, shares of regimes are checked
_COMPLETE = "impulse"  # the method with all laws; random scenes reach all of its regimes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "--samples", type=_count, metavar="N", help="random samples (100000; minimal: none)"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of random scenes (1)")
    parser.add_argument("--method", default=_COMPLETE, metavar="M", help="to check (impulse)")
    parser.add_argument(
        "--roots",
        type=_count,
        default=20_000,
        metavar="N",
        help="samples whose friction is also solved by brute force (20000, 0: none)",
    )
    parser.add_argument(
        "--library",
        type=_count,
        default=500,
        metavar="N",
        help="largest number of samples of each bundled scene (500, 0: no scenes)",
    )
    parser.add_argument("--no-order", action="store_true", help="skip the orders of convergence")
    parser.add_argument(
        "--scene", type=int, metavar="K", help="check the random scene K only, as a report names it"
    )
    parser.add_argument(
        "--run", dest="recording", type=Path, nargs="+", metavar="RUN",
        help="check a recorded run instead: a directory, a file or its files",
    )  # fmt: skip
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="its parameters, instead of the recorded ones"
    )
    parser.add_argument(
        "--motions", type=_count, metavar="N", help="check N random motions of a second each"
    )
    add_connector(parser)


@dataclasses.dataclass
class _Results:
    """Results of all checks."""

    random: LawSummary
    library: LawSummary
    selection: SelectionSummary | None = None
    scenes: int = 0
    rejected: dict[str, str] = dataclasses.field(default_factory=dict)
    instants: LawSummary | None = None
    momentum: float = 0.0
    fits: list[Fit] = dataclasses.field(default_factory=list)

    def violations(self) -> list[str]:
        """Names of the laws and checks that do not hold, as printed."""
        from cylconn_ros.laws.pointwise import MOMENTUM

        summaries = [self.random, self.library, *([self.instants] if self.instants else [])]
        names = [
            title(law)
            for law in LAWS
            if any(law in one.laws and not one.laws[law].holds for one in summaries)
        ]
        names += ["roots"] if self.selection is not None and self.selection.failures else []
        names += ["momentum"] if self.momentum > MOMENTUM else []
        return names + ([] if all(fit.holds for fit in self.fits) else ["order"])


def run(options: argparse.Namespace) -> int:
    """Check and report; 0 if every law holds."""
    begin = time.monotonic()
    if options.recording is not None:
        return _recorded(options)
    if options.motions is not None:
        return _motions(options)
    from cylconn_ros.laws.summary import LawSummary

    _check_method(options)
    results = _Results(LawSummary(), LawSummary())
    with Progress("laws") as bar:
        bar.note("preparing (the first run compiles the physics)")
        _random(options, results, bar)
    if options.scene is None and options.library:
        with Progress("scenes") as bar:
            _library(options, results, bar)
    if options.scene is None and not options.no_order and options.method == _COMPLETE:
        from cylconn_ros.laws import order

        with Progress("order of convergence") as bar:
            results.fits = order.fits(bar)
    sampled = f"{results.random.samples} samples, seed {options.seed}"
    print(f"method {options.method}: {sampled}, {time.monotonic() - begin:.0f} s\n")
    lines = [*report.laws(results.random), *report.regimes(results.random)]
    lines = lines if results.random.samples else []
    lines += report.selection(results.selection)
    lines += report.library(results.library, results.scenes, results.rejected)
    lines += [*report.pointwise(results.instants, results.momentum), *report.orders(results.fits)]
    print("\n".join(lines))
    complete = options.method == _COMPLETE and results.random.samples >= _SAMPLES
    rare = results.random.rare_regimes() if complete else []
    if rare:
        print(f"\ninconclusive: less than 1 % of the samples in regime {', '.join(rare)}")
    violated = results.violations()
    print(_conclusion(options, results.random, results.selection, violated))
    return 1 if violated or rare else 0


def _check_method(options: argparse.Namespace) -> None:
    """Set the default number of samples; raises CommandError for an unsuitable method."""
    if options.method not in GUARANTEES:
        known = ", ".join(GUARANTEES)
        raise CommandError(f"--method {options.method}: laws are stated for {known}")
    live = TRAITS[options.method].live
    if options.samples is None:
        options.samples = _SAMPLES if live else 0
    if not live and (options.samples or options.scene is not None):
        raise CommandError(
            f"--method {options.method}: computes whole motions and no random samples; "
            "leave out --samples and --scene"
        )


def _random(options: argparse.Namespace, results: _Results, bar: Progress) -> None:
    """Check the random samples, and the roots of as many of them as requested."""
    from cylconn_ros.laws import residuals, sampling, selection

    if options.roots and options.method == _COMPLETE:
        results.selection = selection.SelectionSummary()
    if options.scene is not None:
        numbers = range(options.scene // sampling.BLOCK, options.scene // sampling.BLOCK + 1)
    else:
        numbers = range(sampling.blocks_for(options.samples) if options.samples else 0)
    total = len(numbers) * sampling.LENGTH
    for done, part in enumerate(_sampled(options, numbers)):
        checked = residuals.check(part.block, options.method)
        rows = slice(None) if options.scene is None else part.number == options.scene
        columns = (part.number[rows], part.chain[rows], part.index[rows])
        chosen = {law: values[rows] for law, values in checked.items()}
        results.random.add(chosen, part.block.out[rows], columns)
        if results.selection is not None and results.selection.samples < options.roots:
            found = selection.check(part.block)
            results.selection.add(found, part.number, part.chain, part.index)
        bar(done + 1, total)


def _sampled(options: argparse.Namespace, numbers: range) -> Iterator[SampledBlock]:
    from cylconn_ros.laws import sampling

    for number in numbers:
        yield from sampling.blocks(options.seed, number, options.method)


def _library(options: argparse.Namespace, results: _Results, bar: Progress) -> None:
    """Check the method's runs of the bundled scenes: samples, or instants of whole motions."""
    from cylconn_ros.laws import library, residuals
    from cylconn_ros.laws.summary import LawSummary
    from cylconn_ros.reference.library import LIBRARY
    from cylconn_ros.scene.resources import shipped_scenes
    from cylconn_ros.scene.scene import load

    files = shipped_scenes()
    scenes, results.rejected = library.accepted_scenes(
        {name: load(files[name]) for name in LIBRARY}, options.method
    )
    results.scenes = len(scenes)
    for done, (name, scene) in enumerate(scenes.items()):
        if not TRAITS[options.method].live:
            _instants(results, name, scene)
        else:
            for block, index in library.run(scene, options.library).blocks():
                summary = LawSummary()
                summary.add(
                    residuals.check(block, options.method, in_order=True), block.out, (index,)
                )
                results.library.merge(summary.with_prefix(name))
        bar(done + 1, len(scenes))


def _instants(results: _Results, name: str, scene: Scene) -> None:
    """Check the instants of one motion that minimal computes."""
    import numpy as np

    from cylconn_ros.laws import pointwise
    from cylconn_ros.laws.summary import LawSummary

    residuals, momentum = pointwise.check(scene)
    summary = LawSummary()
    summary.add_residuals(residuals, pointwise.INSTANTS, (np.arange(pointwise.INSTANTS),))
    results.instants = results.instants or LawSummary()
    results.instants.merge(summary.with_prefix(name))
    results.momentum = max(results.momentum, momentum)


def _conclusion(
    options: argparse.Namespace,
    summary: LawSummary,
    selection: SelectionSummary | None,
    violated: list[str],
) -> str:
    """The last line: whether the laws hold, and the next command."""
    if not violated:
        return "\nall laws hold\nnext: --samples 1000000, another --seed, or --run RUN"
    locations = [law.location for law in summary.laws.values() if law.violations]
    locations += selection.locations if selection is not None else []
    text = f"\nVIOLATED: {', '.join(violated)}"
    if options.recording is None and options.scene is None and locations:
        scene = locations[0].split("/")[0]
        text += f"\nnext: cylconn laws --seed {options.seed} --scene {scene} --no-order"
    elif options.recording is not None:
        text += f"\nnext: cylconn info {' '.join(map(str, options.recording))}"
    return text


def _motions(options: argparse.Namespace) -> int:
    """Check random motions with every method that applies."""
    from cylconn_ros.laws.random_motions import check_all

    begin = time.monotonic()
    with Progress("motions") as bar:
        results = check_all(options.seed, options.motions, bar)
    print(f"{options.motions} random motions, {time.monotonic() - begin:.0f} s\n")
    print(
        f"{'method':<22}{'motions':>8}{'energy':>10}{'references':>12}{'error':>10}{'jams':>6}{'violated':>10}"
    )
    for name, one in results.items():
        some = "; ".join(one.failures[:3])
        print(
            f"{name:<22}{one.motions:>8}{one.energy:>+10.1e}{one.references:>12}"
            f"{one.reference:>10.1e}{one.jams:>6}{len(one.failures):>10}  {some}"
        )
    return 1 if any(one.failures for one in results.values()) else 0


def _recorded(options: argparse.Namespace) -> int:
    """Check the samples of a recorded run."""
    from cylconn_ros.laws import together
    from cylconn_ros.laws.runs import check_recording
    from cylconn_ros.recording import connector_part
    from cylconn_ros.recording.bag import Bag

    several = connector_part.names(Bag(options.recording).metadata)
    name = " ".join(map(str, options.recording))
    scene = load(options.params) if options.params is not None else None
    if several and not options.connector:
        if scene is not None:
            raise CommandError("--params belongs to one connector: choose it with --connector NAME")
        with Progress("laws") as bar:
            runs, summary = together.check_recording(options.recording, several, bar)
        print(f"{', '.join(several)}: {summary.samples} samples of {name}\n")
        print("\n".join([*report.laws(summary, "connector/sample"), *report.regimes(summary)]))
        violated = [title(name) for name, law in summary.laws.items() if not law.holds]
        if not all(len(one.h) for one in runs.values()):
            print("\nno sample can be checked")
            return 1
        print(_conclusion(options, summary, None, violated))
        return 1 if violated else 0
    with Progress("laws") as bar:
        recorded, summary = check_recording(options.recording, bar, options.connector, scene)
    print(f"method {recorded.method}: {summary.samples} samples of {name}\n")
    print("\n".join([*report.laws(summary, "sample"), *report.regimes(summary)]))
    if recorded.skipped:
        print(f"\nskipped: {recorded.skipped} states ({recorded.skip_reason})")
    if not summary.samples:
        print("\nno sample can be checked")
        return 1
    violated = [title(name) for name, law in summary.laws.items() if not law.holds]
    print(_conclusion(options, summary, None, violated))
    return 1 if violated else 0


def _count(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text}: must not be negative")
    return value
