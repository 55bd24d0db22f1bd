"""Estimate friction from a recording of a joint: mu, FCint, L and R with 95 % intervals.

BAG is a recorded directory or an .mcap file with poses and twists of the bodies, and their loads if
there are any, of a real or a simulated joint. Mass and inertia of a free body must be known, or are
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
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.cli.checks import add_connector, add_recording
from cylconn_ros.cli.identify_axis import axis_report
from cylconn_ros.cli.identify_page import (
    friction_facts,
    friction_findings,
    given,
    nothing_found,
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
    from cylconn_ros.identification.friction import Estimate, Identification

_PICTURES = (".png", ".svg", ".pdf")
_LEAST_NOISE = 1e-7  # m/s; below, the sample period limits the accuracy and not a sensor
_KINDS = tuple(kind.topic for kind in INPUTS)
_KNOWN = ("preload", "overlap", "radius")
_TITLES = {
    "coefficient": "mu",
    "static_coefficient": "mu static",
    "preload": "FCint",
    "overlap": "L",
    "radius": "R",
    "c1": "c1",
    "cr1": "cr1",
    "coefficient_positive": "mu forward",
    "coefficient_negative": "mu backward",
    "direction": "direction",
    "offset": "offset",
    "stribeck": "Stribeck",
    "decay": "decay",
    "mass": "mass",
    "inertia": "inertia",
}
_BASE = ("coefficient", "static_coefficient", "preload", "overlap", "radius")
_INERTIA = ("mass", "inertia")
_ALWAYS = (*_BASE, *_INERTIA)


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
        type=_known,
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
        _write_json(found, options.json)
    if options.json is None or str(options.json) != "-":
        print("\n".join(table(found)))
    if options.table is not None:
        _write_table(found, options.table)
        print(f"table       {options.table}")
    if options.plot is not None:
        _draw(found, recorded.path.name, options.plot)
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


def table(found: Identification) -> list[str]:
    """The results as lines of text."""
    lines = [
        f"recording   {found.samples} samples over {found.duration:.6g} s",
        f"slip        {found.slip_intervals} intervals in {found.windows} windows",
        f"rest        {found.rest_intervals} intervals in {found.rest_windows} windows",
    ]
    lines += [f"skipped     {count} ({reason})" for reason, count in found.skipped.items()]
    lines += [
        f"noise       {found.noise:.2e} m/s standard deviation of a component of the slip velocity",
        f"misfit      {found.misfit:.2f} (1: the law fits within the noise)"
        if found.noise > _LEAST_NOISE
        else f"misfit      not computed: noise below {_LEAST_NOISE:.0e} m/s",
        "",
        f"{'parameter':<12}{'estimate':>11}  {'95 % interval':<26}unit",
    ]
    lines += [
        _row(found.estimates[name])
        for name in _TITLES
        if name in found.estimates and (name in _ALWAYS or found.estimates[name].found)
    ]
    lines += ["", *(f"verdict     {line}" for line in found.verdict())]
    lines += [f"left out    {name}: {why}" for name, why in found.choice.left_out.items()]
    lines += [f"next        {line}" for line in advise(found)]
    assumed = [
        e
        for e in found.estimates.values()
        if e.name in _BASE and not e.found and math.isfinite(e.value)
    ]
    facts = [f"{given(found)} of the parameters"]
    facts += [
        f"{_TITLES[e.name]} = {e.value:.6g}" + f" {e.unit}".replace(" 1", "") for e in assumed
    ]
    lines += ["", "taken as known: " + ", ".join(facts)]
    if not found.accepted:
        return lines
    if found.misfit > 2.0 and found.noise > _LEAST_NOISE:
        lines.append(
            "the windows differ from the law by more than their noise; the intervals include the "
            "random part of that"
        )
    return lines


def advise(found: Identification) -> list[str]:
    """Say which motion to record next."""
    from cylconn_ros.identification.advice import advice

    return advice(found)


def _row(e: Estimate) -> str:
    """Line of the table for one parameter; a value in brackets is not estimated."""
    title = _TITLES[e.name]
    unit = "" if e.unit == "1" else e.unit
    if e.found:
        between = f"{e.low:.5g} … {e.high:.5g}"
        return f"{title:<12}{e.value:>11.5g}  {between:<26}{unit:<5}{e.note}".rstrip()
    value = f"({e.value:.5g})" if math.isfinite(e.value) else "-"
    return f"{title:<12}{value:>11}  {'-':<26}{unit:<5}{e.note}".rstrip()


def as_json(found: Identification) -> dict[str, Any]:
    """The results as a JSON value; numbers that could not be estimated are null."""

    def number(x: float) -> float | None:
        return float(x) if math.isfinite(x) else None

    return {
        "estimates": {
            (e.name if e.name in _INERTIA else f"friction.{e.name}"): {
                "estimated": e.found,
                "value": number(e.value),
                "interval_95": [number(e.low), number(e.high)] if e.found else None,
                "unit": e.unit,
                "note": e.note,
            }
            for e in (found.estimates[name] for name in _TITLES if name in found.estimates)
        },
        "accepted": found.accepted,
        "verdict": found.verdict(),
        "terms": list(found.choice.terms),
        "left_out_terms": found.choice.left_out,
        "advice": advise(found),
        "static_lower_bound": number(found.static.bound),
        "samples": found.samples,
        "duration": found.duration,
        "slipping_intervals": found.slip_intervals,
        "resting_intervals": found.rest_intervals,
        "windows": found.windows,
        "left_out": dict(found.skipped),
        "slip_rate_noise": found.noise,
        "misfit": found.misfit,
        "problem": next(iter(found.doubts), ""),
    }


def _write_json(found: Identification, path: Path) -> None:
    text = json.dumps(as_json(found), indent=2, ensure_ascii=False)
    if str(path) == "-":
        print(text)
        return
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None


def _write_table(found: Identification, path: Path) -> None:
    from cylconn_ros.identification.advice import feed_forward

    try:
        path.write_text(feed_forward(found, path.suffix), encoding="utf-8")
    except (OSError, ValueError) as error:
        raise CommandError(f"{path}: {getattr(error, 'strerror', None) or error}") from None


def _draw(found: Identification, name: str, path: Path) -> None:
    from cylconn_ros.identification.picture import draw, save

    try:
        save(draw(found, name), path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None


def _known(text: str) -> tuple[str, float | None]:
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
