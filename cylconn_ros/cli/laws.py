"""Check the laws of the connector's step from outside, on random states or on a recorded run.

Two bodies, parameters and states are drawn over extreme scales, each extreme jointly with the
others: mass and inertia ratios 1e-6 to 1e6, periods 0.1 to 100 ms, mu up to 10, mass centres metres
off the axis, spins up to 1000 rad/s. The answers are checked against the laws by their letters
(docs/laws.md), written without the solver's code. Exit code 1 where a law does not hold to 1e-12.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli.errors import CommandError
from cylconn_ros.cli.progress import Progress

if TYPE_CHECKING:
    from cylconn_ros.laws.order import Fit
    from cylconn_ros.laws.roots import Verdict
    from cylconn_ros.laws.tally import Tally

_ENOUGH = 100_000  # samples from which on shares of regimes are judged


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "--samples", type=_count, default=100_000, metavar="N", help="random samples (100000)"
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
        "--no-order", action="store_true", help="leave out the orders of convergence"
    )
    parser.add_argument(
        "--scene", type=int, metavar="K", help="only the random scene K, as a report names it"
    )
    parser.add_argument(
        "--run", dest="recording", type=Path, metavar="RUN", help="a recorded run's samples instead"
    )


def run(options: argparse.Namespace) -> int:
    """Check and report; 0 if every law holds."""
    begin = time.monotonic()
    if options.recording is not None:
        return _recorded(options)
    from cylconn_ros.laws.claims import CLAIMS
    from cylconn_ros.laws.tally import Tally

    if options.method not in CLAIMS:
        known = ", ".join(CLAIMS)
        raise CommandError(f"--method {options.method}: laws are stated for {known}")
    tally, fits = Tally(), []
    with Progress("laws") as bar:
        bar.note("preparing (the first run compiles the physics)")
        verdict = _samples(options, tally, bar)
    if options.scene is None and not options.no_order and options.method == "impulse":
        from cylconn_ros.laws import order

        with Progress("order of convergence") as bar:
            fits = order.fits(bar)
    drawn = f"{tally.samples} samples, seed {options.seed}, {time.monotonic() - begin:.0f} s"
    print(f"method {options.method}: {drawn}\n")
    print("\n".join([*_laws(tally), *_regimes(tally), *_roots(verdict), *_orders(fits)]))
    off = [letter for letter, law in tally.laws.items() if not law.holds]
    off += ["roots"] if verdict is not None and verdict.wrong + verdict.flag else []
    off += ["O"] if not all(fit.holds for fit in fits) else []
    few = tally.scarce() if tally.samples >= _ENOUGH else []
    if few:
        print(f"\nless than 1 % of the samples in regime {', '.join(few)}: nothing is proven there")
    print(_next(options, tally, verdict, off))
    return 1 if off or few else 0


def _samples(options: argparse.Namespace, tally: Tally, bar: Progress) -> Verdict | None:
    """Check the random samples, and the roots of as many of them as asked for."""
    from cylconn_ros.laws import checks, roots, sampling

    verdict = roots.Verdict() if options.roots and options.method == "impulse" else None
    if options.scene is None:
        numbers = range(sampling.blocks_for(options.samples))
    else:
        numbers = range(options.scene // sampling.BLOCK, options.scene // sampling.BLOCK + 1)
    total = len(numbers) * sampling.LENGTH
    for done, drawn in enumerate(_drawn(options, numbers)):
        residuals = checks.check(drawn.block, options.method)
        rows = slice(None) if options.scene is None else drawn.number == options.scene
        where = (drawn.number[rows], drawn.chain[rows], drawn.place[rows])
        chosen = {letter: values[rows] for letter, values in residuals.items()}
        tally.add(chosen, drawn.block.out[rows], where)
        if verdict is not None and verdict.samples < options.roots:
            verdict.add(roots.judge(drawn.block), drawn.number, drawn.chain, drawn.place)
        bar(done + 1, total)
    return verdict


def _drawn(options: argparse.Namespace, numbers: range) -> Iterator:
    from cylconn_ros.laws import sampling

    for number in numbers:
        yield from sampling.blocks(options.seed, number, options.method)


def _laws(tally: Tally) -> list[str]:
    from cylconn_ros.laws.claims import TITLES

    lines = [f"{'law':<15}{'samples':>10}{'worst':>11}{'beyond 1e-12':>14}  scene/start/place"]
    for letter, title in TITLES.items():
        law = tally.laws.get(letter)
        if law is None or not law.samples:
            continue
        place = law.where if law.value > 0.0 else ""
        name = f"{letter} {title}"
        lines.append(f"{name:<15}{law.samples:>10}{law.value:>11.1e}{law.over:>14}  {place}")
    return lines


def _regimes(tally: Tally) -> list[str]:
    lines = ["", f"{'regime':<15}{'samples':>10}{'share':>11}"]
    for name, count in tally.regimes.items():
        lines.append(f"{name:<15}{count:>10}{tally.share(name):>11.2%}")
    return lines


def _roots(verdict: Verdict | None) -> list[str]:
    if verdict is None:
        return []
    lines = [
        "",
        f"all roots by brute force: {verdict.judged} of {verdict.samples} samples, "
        f"{verdict.several} with several, {verdict.unsure} that hang on rounding",
        f"answers other than the rule names: {verdict.wrong}; "
        f"flag SEVERAL_ROOTS not as the message says: {verdict.flag}",
    ]
    return lines + [f"  at {where}" for where in verdict.where]


def _orders(fits: list[Fit]) -> list[str]:
    if not fits:
        return []
    from cylconn_ros.laws.order import PERIODS, STATED

    heads = "".join(f"{1e3 * period:>9.4g}" for period in PERIODS)
    lines = ["", f"{'O order, error at h/ms':<46}{heads}   order  stated"]
    for fit in fits:
        errors = "".join(f"{error:>9.1e}" for error in fit.errors)
        sign = "" if fit.holds else "  LESS"
        name = f"{fit.scene}: {fit.what}"
        lines.append(f"{name:<46}{errors}{fit.order:>8.2f}{STATED[fit.what]:>8.0f}{sign}")
    return lines


def _next(
    options: argparse.Namespace, tally: Tally, verdict: Verdict | None, off: list[str]
) -> str:
    if not off:
        return "\nall hold (next: --samples 1000000, another --seed, --run RUN for a recording)"
    places = [tally.laws[letter].where for letter in off if letter in tally.laws]
    places += verdict.where if verdict is not None else []
    text = f"\nBROKEN: {', '.join(off)}"
    if options.recording is None and options.scene is None and places:
        scene = places[0].split("/")[0]
        text += f" (next: cylconn laws --seed {options.seed} --scene {scene} --no-order)"
    return text


def _recorded(options: argparse.Namespace) -> int:
    """Check the samples of a recorded run."""
    from cylconn_ros.laws import checks
    from cylconn_ros.laws.claims import CLAIMS
    from cylconn_ros.laws.recorded import samples_of
    from cylconn_ros.laws.tally import Tally
    from cylconn_ros.recording.reader import read_run

    tally = Tally()
    recorded = samples_of(read_run(options.recording))
    if recorded.method not in CLAIMS:
        raise CommandError(f"{options.recording}: no laws are stated for method {recorded.method}")
    with Progress("laws") as bar:
        for done, (block, index) in enumerate(recorded.blocks()):
            residuals = checks.check(block, recorded.method)
            tally.add(residuals, block.out, (index,))
            bar(done + 1, recorded.parts)
    print(f"method {recorded.method}: {tally.samples} samples of {options.recording}\n")
    print("\n".join([*_laws(tally), *_regimes(tally)]).replace("scene/start/place", "sample"))
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
