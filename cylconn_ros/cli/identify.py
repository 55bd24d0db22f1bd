"""Estimate friction from a recording of a joint: mu, FCint, L and R with 95 % intervals.

BAG is a recorded directory or an .mcap file with poses and twists of the bodies, and their loads if
there are any, of a real or a simulated joint. Twists that were not recorded are computed from the
poses (--bandwidth). Mass and inertia of a free body must be known, or are
estimated too (--estimate). The parameters are those of the recording or of --params FILE. Those
that the motion does not determine are listed and taken as known. docs/how_to/identify.md explains
the method. The exit code is 1 if the recording does not determine the coefficient, or its motion
leaves the joint. --report writes one page that says whether to believe the values, with plots and
what to record next.

For example: cylconn identify BAG --known radius=0.02 --report friction.html

Next: read the page; put the estimates into friction.* of a scene, and compare with
cylconn replay BAG --set.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli.checks import add_connector, add_recording
from cylconn_ros.cli.identify_axis import axis_report
from cylconn_ros.cli.identify_page import (
    friction_facts,
    friction_findings,
    nothing_found,
)
from cylconn_ros.cli.identify_results import (
    advise,
    draw_picture,
    table,
    write_json,
    write_table,
)
from cylconn_ros.cli.page_file import check_page, write_page
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError, IdentifyError, IndeterminateError
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.report.findings import Findings
from cylconn_ros.report.page import Fact
from cylconn_ros.scene.inputs import BODIES, INPUTS
from cylconn_ros.scene.scene import load

if TYPE_CHECKING:
    from cylconn_ros.identification.friction import Identification

_PICTURES = (".png", ".svg", ".pdf")
_KINDS = tuple(kind.topic for kind in INPUTS)
_KNOWN = ("preload", "overlap", "radius")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_recording(parser, "recording", "BAG")
    add_connector(parser)
    parser.add_argument(
        "--params",
        type=Path,
        metavar="FILE",
        help="parameter file, in place of the recorded parameters",
    )
    parser.add_argument(
        "--known",
        type=known_parameter,
        action="append",
        default=[],
        metavar="NAME[=VALUE]",
        help="do not estimate preload, overlap or radius; SI units, default: the parameter's value",
    )
    parser.add_argument(
        "--estimate", action="append", default=[], choices=("mass", "inertia"), dest="unknown",
        help="also the mass of the free body, or its inertia about the slot; needs a recorded load "
        "or effort along the slot",
    )  # fmt: skip
    parser.add_argument(
        "--remap",
        "--topic",
        dest="topic",
        type=_topic,
        action="append",
        default=[],
        metavar="INPUT:=TOPIC",
        help=f"recorded topic of an input: {', '.join(f'body_b/{kind}' for kind in _KINDS)}, …",
    )
    parser.add_argument(
        "--drive", default="", metavar="TOPIC",
        help="effort of a motor, as JointState or WrenchStamped: not friction",
    )  # fmt: skip
    parser.add_argument(
        "--with", dest="others", type=Path, action="append", default=[], metavar="BAG",
        help="further recording of the same joint, fitted together with BAG",
    )  # fmt: skip
    parser.add_argument(
        "--bandwidth", type=_bandwidth, metavar="HZ",
        help="take the twists from the poses, by a smoother of this bandwidth; default: the "
        "recorded twists, or 50 Hz if there are none",
    )  # fmt: skip
    parser.add_argument(
        "--axis", default="", metavar="TOPIC[:JOINT]",
        help="mass and friction of one axis from positions and efforts of a JointState, without "
        "inertia and parameters; friction is one number, mu FN0",
    )  # fmt: skip
    parser.add_argument(
        "--report", type=Path, metavar="FILE",
        help="write a page (.html, works offline): whether to believe the values and why, "
        "intervals, plots of residuals, what to record next",
    )  # fmt: skip
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the estimate: .png, .svg or .pdf"
    )
    parser.add_argument(
        "--table", type=Path, metavar="FILE", help="feed-forward table of friction: .yaml or .csv"
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="write the results as JSON (- : print)"
    )


def run(options: argparse.Namespace) -> int:
    """Estimate and report.

    Exit codes: 1 if the values are withheld or the recording does not determine the coefficient.
    """
    _check(options)
    if options.axis:
        recordings = [options.recording, *options.others]
        return axis_report(options.axis, recordings, options.json, options.report)
    from cylconn_ros.identification.recording import identify

    recorded = read_run(options.recording, options.connector)
    scene = load(options.params) if options.params is not None else None
    with Progress("identify") as bar:
        bar.note("preparing (the first run compiles the physics)")
        try:
            found = identify(
                recorded, scene, known=dict(options.known), remap=dict(options.topic),
                drive=options.drive, others=options.others, unknown=options.unknown,
                bandwidth=options.bandwidth,
            )  # fmt: skip
        except IndeterminateError as error:
            print(f"cylconn identify: {recorded.path}: {error}", file=sys.stderr)
            if options.report is not None:
                _write_page(options, recorded, nothing_found(str(error)), [])
                print(f"report      {options.report}", file=sys.stderr)
            return 1
        except IdentifyError as error:
            raise CommandError(f"{recorded.path}: {error}") from None
    if options.json is not None:
        write_json(found, options.json)
    if options.json is None or str(options.json) != "-":
        print("\n".join(table(found)))
    if options.table is not None:
        write_table(found, options.table)
        print(f"table       {options.table}")
    if options.plot is not None:
        draw_picture(found, recorded.path.name, options.plot)
        print(f"picture     {options.plot}")
    if options.report is not None:
        page = friction_findings(found, advise(found))
        _write_page(options, recorded, page, friction_facts(found), _counts(found))
    if str(options.json) != "-":
        if options.report is not None:
            print(f"report      {options.report}")
        print(f"\nnext: {_next(found, options.report)}")
    return 0 if found.accepted else 1


def _next(found: Identification, page: Path | None) -> str:
    """Say what to do with the result."""
    read = f"open {page} in a browser" if page is not None else "see why with --report FILE.html"
    return f"{read}; " + (
        "put the values into friction.* of a scene"
        if found.accepted
        else "record the motion that is advised"
    )


def _write_page(
    options: argparse.Namespace,
    recorded: Run,
    found: Findings,
    facts: Sequence[Fact],
    counts: Sequence[tuple[str, str]] = (),
) -> None:
    """Write the page of --report."""
    names = [_stem(path) for path in [options.recording[0], *options.others]]
    sources = [("recording", ", ".join(names))]
    sources += [("connector", options.connector)] if options.connector else []
    sources += [("drive, not friction", options.drive)] if options.drive else []
    if options.params is not None:
        parameters = options.params.read_text(encoding="utf-8")
        sources.append(("parameters", options.params.name))
    else:
        parameters = recorded.metadata.get("parameters", "")
        sources.append(("parameters", "stored in the recording"))
    write_page(options.report, names[0], found, facts, [*sources, *counts], parameters)


def _stem(path: Path) -> str:
    return path.resolve().with_suffix("").name


def _counts(found: Identification) -> list[tuple[str, str]]:
    """Return what the recording contains, and what was skipped."""
    listed = [
        ("intervals of slip", f"{found.slip_intervals} in {found.windows} windows"),
        ("intervals of rest", f"{found.rest_intervals} in {found.rest_windows} windows"),
    ]
    return listed + [("skipped", f"{count} ({reason})") for reason, count in found.skipped.items()]


def _check(options: argparse.Namespace) -> None:
    needed = {"scipy": True, "matplotlib": options.plot is not None}
    for name in (name for name, needs in needed.items() if needs):
        if importlib.util.find_spec(name) is None:
            raise CommandError(f"needs {name}: pip install '.[demo]'")
    if options.report is not None:
        check_page(options.report)
    if options.plot is not None and options.plot.suffix not in _PICTURES:
        raise CommandError(f"{options.plot}: a picture must end in one of {', '.join(_PICTURES)}")


def known_parameter(text: str) -> tuple[str, float | None]:
    """Parse a value of --known; None: use the parameter's value."""
    name, _, value = text.partition("=")
    name = name.removeprefix("friction.")
    if name not in _KNOWN:
        raise argparse.ArgumentTypeError(
            f"{text}: must be one of {', '.join(_KNOWN)}, or NAME=VALUE"
        )
    try:
        number = float(value) if value else None
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: {value!r} is not a number") from None
    least = {"radius": "> 0", "overlap": ">= 0 (0: bending does not count)"}.get(name)
    wrong = number is not None and (
        not math.isfinite(number)
        or (name == "radius" and number <= 0.0)
        or (name == "overlap" and number < 0.0)
    )
    if wrong:
        raise argparse.ArgumentTypeError(
            f"{text}: must be finite" + (f" and {least}" if least else "")
        )
    return name, number


def _bandwidth(text: str) -> float:
    """Parse a value of --bandwidth."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: must be a number > 0 Hz")
    return value


def _topic(text: str) -> tuple[str, str]:
    """Parse a value of --remap: input and recorded topic."""
    ours, mark, theirs = text.partition(":=")
    body, _, kind = ours.rpartition("/")
    good = body in BODIES and kind in _KINDS
    if not (mark and theirs and good):
        raise argparse.ArgumentTypeError(
            f"{text}: must be like body_b/pose:=/arm/pose ({', '.join(_KINDS)})"
        )
    return ours, theirs
