"""Documentation of the parameters, derived from the scene: a table and an example with them all.

``python -m cylconn_ros.scene.documentation table > docs/parameters.md``
``python -m cylconn_ros.scene.documentation example > config/connector.yaml``
"""

from __future__ import annotations

import sys
import textwrap
from typing import Any

from cylconn_ros.scene.scene import schema
from cylconn_ros.scene.schema import Parameter, show

_TABLE_HEAD = """\
# Parameters

One YAML file serves `connector`, `plant` and `cylconn simulate`; `config/connector.yaml` is an
example with every parameter. `connectors: [name, …]` makes several of them, each with the
parameters below in a block of its name ([connectors.md](connectors.md)). Whole numbers are accepted
where numbers are asked for. *Fixed* parameters are read when a node starts; the others can be
changed while it runs (`ros2 param set`): a change is taken as a whole or refused with a reason, and
not during a recording, which holds one set of parameters. A change of bodies, nodes, reference,
period or method begins a new history: the next sample is the reference configuration. This file is
made from `cylconn_ros/connector/scene.py` and `scene_parts.py`.
"""
_EXAMPLE_HEAD = """\
# Every parameter with its default; where one must be given, an example. docs/parameters.md is the
# same as a table. Leave out what may stay as it is.
/**:
  ros__parameters:
"""


def table() -> str:
    """Write docs/parameters.md."""
    lines = [_TABLE_HEAD]
    group = None
    for parameter in schema().values():
        head = parameter.name.rpartition(".")[0]
        if head != group:
            group = head
            lines.append(f"\n## {f'`{head}.…`' if head else 'The scene'}\n")
            lines.append("| parameter | type | unit | default | accepted | meaning |")
            lines.append("|---|---|---|---|---|---|")
        cells = (
            f"`{parameter.name}`" + (" *fixed*" if parameter.read_only else ""),
            _kind(parameter),
            parameter.unit or "–",
            _default(parameter),
            parameter.rule,
            parameter.doc,
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def example() -> str:
    """Write config/connector.yaml."""
    lines = [_EXAMPLE_HEAD.rstrip("\n")]
    open_groups: list[str] = []
    for parameter in schema().values():
        *path, name = parameter.name.split(".")
        while open_groups != path[: len(open_groups)]:
            open_groups.pop()
        for part in path[len(open_groups) :]:
            lines.append("")
            lines.append(f"{_indent(open_groups)}{part}:")
            open_groups.append(part)
        indent = _indent(open_groups)
        lines += textwrap.wrap(
            _comment(parameter), 96, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   "
        )
        lines.append(f"{indent}{name}: {_yaml(_value(parameter))}")
    return "\n".join(lines) + "\n"


def _comment(parameter: Parameter) -> str:
    unit = f"[{parameter.unit}] " if parameter.unit not in ("", "1") else ""
    rule = f" ({parameter.rule})" if parameter.kind != "bool" else ""
    return f"{unit}{parameter.doc.rstrip('.')}{rule}"


def _indent(groups: list[str]) -> str:
    return "  " * (2 + len(groups))


def _value(parameter: Parameter) -> Any:
    """The default, or the example where a scene needs a value."""
    needed = parameter.required or parameter.name in ("body_b.mass", "body_b.inertia")
    return parameter.example if needed else parameter.default


def _yaml(value: Any) -> str:
    return value if isinstance(value, str) else show(value)


def _kind(parameter: Parameter) -> str:
    if parameter.kind == "vector":
        return "numbers" if parameter.size is None else f"{parameter.size} numbers"
    words = {"bool": "truth value", "int": "whole number", "float": "number", "str": "text"}
    return words[parameter.kind]


def _default(parameter: Parameter) -> str:
    if parameter.required:
        return "*required*"
    return f"`{_yaml(parameter.default)}`"


def main() -> int:
    """Print what the first argument asks for."""
    pieces = {"table": table, "example": example}
    if len(sys.argv) != 2 or sys.argv[1] not in pieces:
        print(f"usage: {' | '.join(pieces)}", file=sys.stderr)
        return 2
    print(pieces[sys.argv[1]](), end="")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
