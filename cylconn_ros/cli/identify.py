"""Estimate friction from a recording of a joint: mu, FCint, L and R, each with a 95 % interval.

BAG is a recorded directory or an .mcap file with poses and twists of the bodies (and their loads),
of a real joint or a simulated one; a body's mass and inertia must be known. Parameters are those in
the recording, or --params FILE. What the motion does not show is said, and taken as known.
docs/identify.md says how it is done.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.cli.checks import add_connector
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.scene.scene import Scene, load

if TYPE_CHECKING:
    from cylconn_ros.identify.friction import Estimate, Identified

_PICTURES = (".png", ".svg", ".pdf")
_SILENT = 1e-7  # m/s: the sample period, and no sensor, limits what is seen
_KNOWN = ("preload", "overlap", "radius")
_TITLES = {
    "coefficient": "mu",
    "static_coefficient": "mu static",
    "preload": "FCint",
    "overlap": "L",
    "radius": "R",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("recording", metavar="BAG", type=Path, help="recorded directory or file")
    add_connector(parser)
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="parameter file instead of the recording's"
    )
    parser.add_argument(
        "--known",
        type=_known,
        action="append",
        default=[],
        metavar="NAME[=VALUE]",
        help="do not estimate preload, overlap or radius; SI units, default: of the parameters",
    )
    parser.add_argument(
        "--remap",
        "--topic",
        dest="topic",
        type=_topic,
        action="append",
        default=[],
        metavar="OURS:=THEIRS",
        help="the recording's topic for body_b/pose, body_b/twist, body_b/odom, body_b/load, …",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw it: .png, .svg or .pdf")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers (- : print)")


def run(options: argparse.Namespace) -> int:
    """Estimate, and report as asked; 0 if the coefficient was found."""
    _check(options)
    from cylconn_ros.errors import IdentifyError
    from cylconn_ros.identify.friction import identify
    from cylconn_ros.recording.samples import matched

    recorded = read_run(options.recording, options.connector)
    scene = _scene(recorded, options)
    known = {name: _value(scene, name, value) for name, value in options.known}
    _refuse_commands(recorded)
    with Progress("identify") as bar:
        bar.note("preparing (the first run compiles the physics)")
        try:
            found = identify(scene, matched(recorded, scene, dict(options.topic)), known)
        except IdentifyError as error:
            raise CommandError(f"{options.recording}: {error}") from None
    if options.json is not None:
        _write_json(found, options.json)
    if options.json is None or str(options.json) != "-":
        print("\n".join(table(found)))
    if options.plot is not None:
        _draw(found, options.recording.name, options.plot)
        print(f"picture     {options.plot}")
    elif options.json is None:
        print("\nnext: look at it with --plot FILE.png; use it in friction.* of a scene")
    return 0


def _check(options: argparse.Namespace) -> None:
    for name in ("scipy",) if options.plot is None else ("scipy", "matplotlib"):
        if importlib.util.find_spec(name) is None:
            raise CommandError(f"needs {name}: pip install '.[demo]' brings it")
    if options.plot is not None and options.plot.suffix not in _PICTURES:
        raise CommandError(f"{options.plot}: a picture ends in one of {', '.join(_PICTURES)}")


def _scene(recorded: Run, options: argparse.Namespace) -> Scene:
    if options.params is not None:
        return load(options.params)
    if not recorded.parameters:
        raise CommandError(
            f"{recorded.path}: no parameters were stored with it; give inertia, nodes and friction "
            "with --params FILE"
        )
    return Scene.from_parameters(recorded.parameters)


def _value(scene: Scene, name: str, value: float | None) -> float:
    if value is not None:
        return value
    found = float(getattr(scene.friction, name))
    if math.isnan(found):
        raise CommandError(f"--known {name}: the parameters do not have it; give {name}=VALUE")
    return found


def _refuse_commands(recorded: Run) -> None:
    """A drive's force cannot be told from friction."""
    for topic, kind in recorded.types.items():
        name = topic.rsplit("/", 1)[-1]
        if name == "command" and kind == "sensor_msgs/msg/JointState" and recorded.counts[topic]:
            raise CommandError(
                f"{recorded.path}: {recorded.counts[topic]} commands on {topic} drove slide or "
                "spin: the drive's force cannot be told from friction"
            )


def table(found: Identified) -> list[str]:
    """The report as lines of text."""
    lines = [
        f"recording   {found.samples} samples over {found.duration:.6g} s",
        f"slip        {found.slipping} intervals in {found.windows} windows",
        f"rest        {found.resting} intervals in {found.rests} windows",
    ]
    lines += [f"left out    {count} {why}" for why, count in found.left_out.items()]
    lines += [
        f"noise       {found.noise:.2e} m/s of the slip rate, a component",
        f"misfit      {found.misfit:.2f} (1: the law fits to within the noise)"
        if found.noise > _SILENT
        else "misfit      not judged: there is hardly any noise",
        "",
        f"{'parameter':<12}{'estimate':>11}  {'95 % interval':<26}unit",
    ]
    lines += [_row(found.estimates[name]) for name in _TITLES]
    assumed = [e for e in found.estimates.values() if not e.found and math.isfinite(e.value)]
    facts = ["mass, inertia and nodes of the parameters"]
    facts += [
        f"{_TITLES[e.name]} = {e.value:.6g}" + f" {e.unit}".replace(" 1", "") for e in assumed
    ]
    lines += ["", "taken as known: " + ", ".join(facts)]
    if found.misfit > 2.0 and found.noise > _SILENT:
        lines.append(
            "the windows differ from the law by more than their noise: the intervals count that, "
            "as far as it is random"
        )
    return lines


def _row(e: Estimate) -> str:
    title = _TITLES[e.name]
    unit = "" if e.unit == "1" else e.unit
    if e.found:
        between = f"{e.low:.5g} … {e.high:.5g}"
        return f"{title:<12}{e.value:>11.5g}  {between:<26}{unit:<5}{e.note}".rstrip()
    value = f"({e.value:.5g})" if math.isfinite(e.value) else "-"
    return f"{title:<12}{value:>11}  {'-':<26}{unit:<5}{e.note}".rstrip()


def as_json(found: Identified) -> dict[str, Any]:
    """The numbers, for other programs; what is not to be had is null."""

    def number(x: float) -> float | None:
        return float(x) if math.isfinite(x) else None

    return {
        "estimates": {
            f"friction.{e.name}": {
                "estimated": e.found,
                "value": number(e.value),
                "interval_95": [number(e.low), number(e.high)] if e.found else None,
                "unit": e.unit,
                "note": e.note,
            }
            for e in (found.estimates[name] for name in _TITLES)
        },
        "static_lower_bound": number(found.static.bound),
        "samples": found.samples,
        "duration": found.duration,
        "slipping_intervals": found.slipping,
        "resting_intervals": found.resting,
        "windows": found.windows,
        "left_out": dict(found.left_out),
        "slip_rate_noise": found.noise,
        "misfit": found.misfit,
    }


def _write_json(found: Identified, path: Path) -> None:
    text = json.dumps(as_json(found), indent=2, ensure_ascii=False)
    if str(path) == "-":
        print(text)
        return
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None


def _draw(found: Identified, name: str, path: Path) -> None:
    from cylconn_ros.identify.picture import draw, save

    try:
        save(draw(found, name), path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None


def _known(text: str) -> tuple[str, float | None]:
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
    ours, mark, theirs = text.partition(":=")
    body, _, kind = ours.rpartition("/")
    good = body in ("body_a", "body_b") and kind in ("pose", "twist", "odom", "load")
    if not (mark and theirs and good):
        raise argparse.ArgumentTypeError(
            f"{text}: must be like body_b/pose:=/arm/pose (pose, twist, odom or load)"
        )
    return ours, theirs
