"""Results read back from the JSON they were kept in."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from cylconn_ros.bench.common.results import FORMAT, Findings, Gap, Measurement, Report, Target


def read(file: Path) -> Report:
    """The report of a file written by -o.

    Raises ValueError where the file holds no such results, OSError where it cannot be read.
    """
    try:
        data: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if data["format"] != FORMAT:
            raise ValueError(f"format {data['format']}: must be {FORMAT}")
        found = Findings(
            [_target(t) for t in data["targets"]],
            [Measurement(**_numbers(m, "value", "low", "high")) for m in data["measurements"]],
            [Gap(**gap) for gap in data["gaps"]],
        )
        return Report(data["command"], data["settings"], found, data["machine"], data["started"])
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"no results of a benchmark: {error}") from None


def _target(data: dict[str, Any]) -> Target:
    left = {key: value for key, value in data.items() if key != "met"}
    return Target(**_numbers(left, "value", "limit"))


def _numbers(data: dict[str, Any], *names: str) -> dict[str, Any]:
    """Null is what JSON has for a number that is none."""
    return {k: math.nan if k in names and v is None else v for k, v in data.items()}
