"""Make a scene from a joint of a model: MJCF (.xml), URDF (.urdf) or an Abaqus deck (.inp).

Masses, inertias, axes, limits, springs and damping are taken over. What the model does not say (R
and L of friction, and where the bearing is) is marked in the file with the consequence; what it
says and the scene does not hold is listed. A deck has no units: give them with --units.

For example: cylconn import robot.urdf --joint drawer -o drawer.yaml

Next: fill in what is marked NOT KNOWN, then `cylconn simulate FILE`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from cylconn_ros.errors import CommandError
from cylconn_ros.importing.scene_text import Draft

INCOMPLETE = 1

FRICTION = {
    "coefficient": ("1", "friction coefficient"),
    "radius": ("m", "effective radius R of the shaft"),
    "overlap": ("m", "overlap L of shaft and sleeve"),
}
"""Parameters of friction with unit and meaning; no model has them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "model", metavar="MODEL", type=Path, help=".xml, .urdf, .inp or a bundled model"
    )
    parser.add_argument(
        "--joint", action="append", default=[], metavar="NAME",
        help="joint of an MJCF or URDF model; twice for a slide and a hinge on one axis",
    )  # fmt: skip
    parser.add_argument(
        "--connector", metavar="ELSET", help="element set of the connector in an Abaqus deck"
    )
    parser.add_argument(
        "--units", metavar="L-M-T", help="units of a deck: m-kg-s, mm-t-s, mm-kg-ms, mm-g-ms …"
    )
    add_friction(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="default: standard output"
    )


def add_friction(parser: argparse.ArgumentParser) -> None:
    """Declare the parameters of friction that no model has."""
    for name, (unit, text) in FRICTION.items():
        parser.add_argument(f"--{name}", type=float, metavar="X", help=f"{text}, {unit}")


def put_friction(draft: Draft, options: argparse.Namespace) -> None:
    """Put the given parameters of friction into a scene."""
    for name in FRICTION:
        value = getattr(options, name)
        if value is not None:
            draft.blanks.pop(f"friction.{name}", None)
            draft.put(f"friction.{name}", value)


def print_left_out(draft: Draft) -> None:
    """Print what was not taken over and what is not known, on standard error."""
    for what in draft.left_out:
        print(f"not taken over: {what}", file=sys.stderr)
    for name, (_, consequence) in draft.blanks.items():
        print(f"not known: {name}: {consequence}", file=sys.stderr)


def run(options: argparse.Namespace) -> int:
    """Write the scene; 1 if it cannot be loaded before something required is filled in."""
    draft = _draft(options)
    put_friction(draft, options)
    scene = draft.scene()
    if options.output is None:
        print(draft.text(), end="")
    else:
        options.output.write_text(draft.text())
        print(f"{options.output}: {draft.source}")
    print_left_out(draft)
    if scene is None:
        missing = ", ".join(draft.required)
        print(f"the scene cannot be loaded before these are given: {missing}", file=sys.stderr)
        return INCOMPLETE
    return 0


def _draft(options: argparse.Namespace) -> Draft:
    if options.model.suffix.lower() == ".inp":
        from cylconn_ros.importing import from_abaqus

        if options.joint:
            raise CommandError("--joint: a deck has connectors; give --connector ELSET")
        return from_abaqus.draft_of(options.model, options.connector, options.units)
    from cylconn_ros.importing import from_mujoco
    from cylconn_ros.importing.model_file import find_model

    if not options.joint:
        raise CommandError("--joint: give the name of the joint")
    if options.connector or options.units:
        raise CommandError("--connector, --units: are for Abaqus decks")
    return from_mujoco.draft_of(find_model(options.model), options.joint)
