"""Documentation of the parameters, derived from the schema: a table and an example file.

``python -m cylconn_ros.scene.documentation table > docs/reference/parameters.md``
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

One YAML file serves `connector`, `plant` and `cylconn simulate`. `config/connector.yaml` is an
example with every parameter. `connectors: [name, …]` makes several connectors, each with the
parameters below in a block of its name ([Several connectors](../how_to/connectors.md)).
Integers are accepted for floats.

A *fixed* parameter is read when a node starts. The others can be changed while the node runs
(`ros2 param set`): a change is applied as a whole or refused with a reason. During a recording
changes are refused, as the recording holds one set of parameters. A change of a parameter marked
*restarts* starts a new history: the next sample is the reference configuration. A parameter marked
*node* stands outside the blocks of connectors. *Shared* parameters must agree between connectors
that share a body.

This page is generated from `cylconn_ros/scene/fields.py` and the groups beside it.
"""
_EXAMPLE_HEAD = """\
# Every parameter with its default, or an example if it has none; docs/reference/parameters.md is
# the same as a table. Omit a parameter to keep its default.
/**:
  ros__parameters:
"""


def table() -> str:
    """Write docs/reference/parameters.md."""
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
            f"`{parameter.name}`{_marks(parameter)}",
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


def _marks(parameter: Parameter) -> str:
    marks = {
        "fixed": parameter.read_only,
        "restarts": parameter.restarts,
        "node": parameter.node,
        "shared": bool(parameter.shared),
    }
    return "".join(f" *{mark}*" for mark, applies in marks.items() if applies)


def _indent(groups: list[str]) -> str:
    return "  " * (2 + len(groups))


def _value(parameter: Parameter) -> Any:
    """The default, or the example if a scene needs a value."""
    needed = parameter.required or parameter.name in ("body_b.mass", "body_b.inertia")
    return parameter.example if needed else parameter.default


def _yaml(value: Any) -> str:
    return value if isinstance(value, str) else show(value)


def _kind(parameter: Parameter) -> str:
    if parameter.kind == "vector":
        return "floats" if parameter.size is None else f"{parameter.size} floats"
    return {"str": "string", "words": "strings"}.get(parameter.kind, parameter.kind)


def _default(parameter: Parameter) -> str:
    if parameter.required:
        return "*required*"
    return f"`{_yaml(parameter.default)}`"


def main() -> int:
    """Print the table or the example, as the first argument says."""
    pieces = {"table": table, "example": example}
    if len(sys.argv) != 2 or sys.argv[1] not in pieces:
        print(f"usage: {' | '.join(pieces)}", file=sys.stderr)
        return 2
    print(pieces[sys.argv[1]](), end="")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
