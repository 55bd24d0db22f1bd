"""A scene as a commented parameter file: what a model says, and what it leaves open."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Iterable
from typing import Any

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.parameter_file import parse
from cylconn_ros.scene.scene import Scene

BLANK = "NOT KNOWN"
"""Marks in a comment what the model does not say."""


@dataclasses.dataclass
class Draft:
    """Parameters by dotted name, with comments, and what was not taken over.

    Attributes
    ----------
    values
        Dotted name to value.
    comments
        Dotted name of a parameter or of a group to the comment above it.
    blanks
        Dotted name to an example and the consequence of leaving the value out.
    left_out
        What the model contains and the scene does not.
    required
        Names among ``blanks`` without which the scene cannot be loaded.
    """

    source: str
    values: dict[str, Any] = dataclasses.field(default_factory=dict)
    comments: dict[str, str] = dataclasses.field(default_factory=dict)
    blanks: dict[str, tuple[str, str]] = dataclasses.field(default_factory=dict)
    left_out: list[str] = dataclasses.field(default_factory=list)
    required: list[str] = dataclasses.field(default_factory=list)

    def put(self, name: str, value: Any, comment: str = "") -> None:
        """Set a parameter, with the comment above it."""
        self.values[name] = value
        if comment:
            self.comments[name] = comment

    def blank(self, name: str, example: str, consequence: str, required: bool = False) -> None:
        """Leave a parameter open; ``required``: the scene cannot be loaded without it."""
        if name in self.values:
            return
        self.blanks[name] = (example, consequence)
        if required:
            self.required.append(name)

    def friction_blanks(self) -> None:
        """Leave open what no joint of a simulator has."""
        self.blank("friction.coefficient", "0.2", "there is no friction")
        self.blank("friction.radius", "0.01", "R, the shaft's effective radius, m; required with "
                   "friction: it turns slide and spin into one slip velocity")  # fmt: skip
        self.blank("friction.overlap", "0.1", "L, overlap of shaft and sleeve, m; without it "
                   "bending adds no normal force, and the joint cannot jam")  # fmt: skip

    def text(self) -> str:
        """The parameter file."""
        lines = [f"# Imported from {self.source}. SI units, radians, quaternions x, y, z, w."]
        if self.blanks:
            lines.append(f"# {BLANK} marks what the model does not say: fill in and uncomment.")
        for what in self.left_out:
            lines += _comment(f"Not taken over: {what}", "")
        lines += ["/**:", "  ros__parameters:"]
        groups: list[str] = []
        for name in [*self.values, *self.blanks]:
            groups += [] if name.split(".")[0] in groups else [name.split(".")[0]]
        for group in groups:
            lines += self._group(group, "", 4)
        return "\n".join(lines) + "\n"

    def _group(self, name: str, prefix: str, indent: int) -> list[str]:
        space, whole = " " * indent, prefix + name
        lines = _comment(self.comments.get(whole, ""), space)
        if whole in self.values:
            return [*lines, f"{space}{name}: {_shown(self.values[whole])}"]
        if whole in self.blanks:
            example, consequence = self.blanks[whole]
            lines += _comment(f"{BLANK}: {consequence}.", space)
            return [*lines, f"{space}# {name}: {example}"]
        below = [n[len(whole) + 1 :] for n in (*self.values, *self.blanks)
                 if n.startswith(f"{whole}.")]  # fmt: skip
        some = any(n.startswith(f"{whole}.") for n in self.values)
        lines.append(f"{space}{name}:" if some else f"{space}# {name}:")
        for part in dict.fromkeys(n.split(".")[0] for n in below):
            inner = self._group(part, f"{whole}.", indent + 2)
            value = f"# {part}: {self.blanks.get(f'{whole}.{part}', ('',))[0]}"
            for line in inner:
                text = line.strip()
                shown = f"  {text.removeprefix('# ')}" if text == value else f"  {text}"
                lines.append(line if some else f"{space}# {shown}".rstrip())
        return lines

    def scene(self) -> Scene | None:
        """The scene, read back from the text; None if something required is open.

        Raises SceneError.
        """
        if self.required:
            return None
        parameters = parse(self.text())["/**"]["ros__parameters"]
        try:
            return Scene.from_parameters(parameters)
        except SceneError as error:
            raise SceneError(f"{self.source}: {error}") from None


def _comment(text: str, space: str) -> list[str]:
    return [f"{space}# {line}" for line in textwrap.wrap(text, 96 - len(space))]


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, Iterable):
        return "[" + ", ".join(_shown(x) for x in value) + "]"
    number = float(value)
    if math.isnan(number):
        return ".nan"
    if math.isinf(number):
        return ".inf" if number > 0 else "-.inf"
    return repr(round(number, 15) + 0.0)
