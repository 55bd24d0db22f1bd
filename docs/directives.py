"""Directives for pages that are generated from the package: commands, messages and Python API."""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import io
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import cylconn_ros
from cylconn_ros.cli import main as command_line
from cylconn_ros.laws import guarantees
from cylconn_ros.scene.schema import describe

ROOT = Path(__file__).resolve().parent.parent
EXECUTABLES = {
    "connector": "cylconn_ros/ros/connector/node.py",
    "plant": "cylconn_ros/ros/plant/node.py",
}
"""Source file of each ROS executable, which defines its help text as USAGE."""

_SECTIONS = ("Attributes", "Returns", "Yields", "Raises")
_COLUMNS = 96  # characters; width of the text that --help prints


class CommandHelp(SphinxDirective):
    """``{command-help} NAME``: the ``--help`` text of a command of cylconn or of an executable."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return a literal block with the text."""
        name = self.arguments[0]
        if name in EXECUTABLES:
            text, source = executable_help(name), EXECUTABLES[name]
        else:
            text, source = command_help(name), f"cylconn_ros/cli/{name}.py"
        self.env.note_dependency(str(ROOT / source))
        return [nodes.literal_block(text, text, language="none")]


class Commands(SphinxDirective):
    """``{commands}``: a section per executable and per command of cylconn, with its help text."""

    def run(self) -> list[nodes.Node]:
        """Return the sections, executables first."""
        text = []
        for name in EXECUTABLES:
            text.append(f"## {name}\n\n```{{command-help}} {name}\n```\n")
        for name in command_line.COMMANDS:
            text.append(f"## cylconn {name}\n\n```{{command-help}} {name}\n```\n")
        return self.parse_text_to_nodes("\n".join(text), allow_section_headings=True)


class MessageFields(SphinxDirective):
    """``{message-fields} ConnectorState``: tables of the constants and fields of a message."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the tables, in the order of the .msg file."""
        path = ROOT / "msg" / f"{self.arguments[0]}.msg"
        self.env.note_dependency(str(path))
        return self.parse_text_to_nodes(message_tables(path.read_text()))


class LawGuarantees(SphinxDirective):
    """``{law-guarantees}``: the laws that each method guarantees, and why."""

    def run(self) -> list[nodes.Node]:
        """Return a table of ``cylconn_ros.laws.guarantees``."""
        self.env.note_dependency(str(ROOT / "cylconn_ros/laws/guarantees.py"))
        rows = ["| method | law | reason |", "|---|---|---|"]
        for method, laws in guarantees.GUARANTEES.items():
            for k, (law, reason) in enumerate(laws.items()):
                name = "" if k else f"`{method}`"
                rows.append(f"| {name} | {guarantees.title(law)} | {_escaped(reason)} |")
        return self.parse_text_to_nodes("\n".join(rows) + "\n")


class PublicApi(SphinxDirective):
    """``{public-api}``: autodoc of every name in ``cylconn_ros.__all__``."""

    def run(self) -> list[nodes.Node]:
        """Return the descriptions, in the order of ``__all__``."""
        lines = [".. highlight:: python", ""]
        for name in cylconn_ros.__all__:
            lines += api_entry(name)
        box = nodes.container()
        self.state.nested_parse(StringList(["```{eval-rst}", *lines, "```"], "API"), 0, box)
        return box.children


def command_help(name: str) -> str:
    """Return what ``cylconn NAME --help`` prints at a fixed width."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = str(_COLUMNS)
    text = io.StringIO()
    try:
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            command_line.main([name, "--help"])
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before
    return text.getvalue()


def executable_help(name: str) -> str:
    """Return USAGE of an executable, read from its source: importing it would need rclpy."""
    tree = ast.parse((ROOT / EXECUTABLES[name]).read_text())
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "USAGE":
            return str(ast.literal_eval(node.value)) + "\n"
    raise LookupError(f"{EXECUTABLES[name]} defines no USAGE")


def message_tables(definition: str) -> str:
    """Return Markdown tables of a .msg file: a block of lines without a blank line is one table.

    A comment line above a block is its caption; the comment behind a field is ``unit  meaning``.
    """
    tables = []
    for block in definition.strip().split("\n\n"):
        lines = block.splitlines()
        caption = " ".join(line.lstrip("# ") for line in lines if line.startswith("#"))
        rows = [_message_row(line) for line in lines if not line.startswith("#")]
        if caption:
            tables.append(_escaped(caption))
        if rows:
            head = ("field", "unit", "meaning")
            if "=" in rows[0][0]:
                head, rows = ("constant", "meaning"), [(name, text) for name, _, text in rows]
            tables.append(_table(head, rows))
    return "\n\n".join(tables) + "\n"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _message_row(line: str) -> tuple[str, str, str]:
    declaration, _, comment = line.partition("#")
    kind, _, name = declaration.strip().partition(" ")
    cell = f"`{kind} {name.strip()}`"
    if "=" in name:
        return cell, "", _escaped(comment.strip())
    unit, meaning = _unit_and_meaning(comment.strip())
    return cell, unit, _escaped(meaning)


def _unit_and_meaning(comment: str) -> tuple[str, str]:
    found = re.match(r"(m/s|rad/s|N\.m|rad|m|N|J|s|1)\s{2,}(.*)", comment)
    if found is None:
        found = re.match(r"(m/s|rad/s|N\.m|rad|N|J)\s+(.*)", comment)
    return (found[1], found[2]) if found else ("", comment)


def _escaped(text: str) -> str:
    return re.sub(r"([|*_<\[$])", r"\\\1", text)


def api_entry(name: str) -> list[str]:
    """Return the reStructuredText that documents one public name."""
    value = getattr(cylconn_ros, name)
    target = f"cylconn_ros.{name}"
    if isinstance(value, type) and issubclass(value, BaseException):
        return [f".. autoexception:: {target}", "   :show-inheritance:", ""]
    if isinstance(value, type):
        return [f".. autoclass:: {target}", "   :members:", "", *parameter_list(value), ""]
    if callable(value):
        return [f".. autofunction:: {target}", ""]
    return [f".. autodata:: {target}", ""]


def parameter_list(kind: type) -> list[str]:
    """Return an indented list of the scene parameters that are fields of a dataclass."""
    if not dataclasses.is_dataclass(kind):
        return []
    if not any({"parameter", "group"} & set(each.metadata) for each in dataclasses.fields(kind)):
        return []
    lines = ["   Parameters of the scene:", ""]
    table = describe(kind)
    for each in dataclasses.fields(kind):
        if each.name in table:
            one = table[each.name]
            text = f"{one.rule}. {one.doc}"
        else:
            text = f"group {each.metadata['group'].__name__}."
        lines.append(f"   - ``{each.name}``: " + re.sub(r"([*|`_\\])", r"\\\1", text))
    return lines


def plain_sections(
    app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Turn underlined sections with ``name: text`` entries into the form that napoleon reads.

    The linter asks for underlined headings; their entries follow the same style as ``Args:``.
    """
    for k in range(len(lines) - 1, 0, -1):
        if re.fullmatch(r"-+", lines[k].strip()) and lines[k - 1].strip() in _SECTIONS:
            lines[k - 1] += ":"
            del lines[k]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("command-help", CommandHelp)
    app.add_directive("commands", Commands)
    app.add_directive("message-fields", MessageFields)
    app.add_directive("law-guarantees", LawGuarantees)
    app.add_directive("public-api", PublicApi)
    app.connect("autodoc-process-docstring", plain_sections, priority=400)  # before napoleon
    return {"parallel_read_safe": True}
