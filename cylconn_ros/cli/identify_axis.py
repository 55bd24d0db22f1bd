"""``cylconn identify --axis``: mass and friction of one axis from its positions and efforts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.errors import CommandError, IdentifyError

if TYPE_CHECKING:
    from cylconn_ros.identification.effort import AxisEstimate

_TITLES = {"mass": "M", "c1": "c1", "preload_friction": "mu FN0", "offset": "offset"}
_WITHHELD = "not determined: the interval is wider than half of the value"


def axis_report(axis: str, recordings: Sequence[Path], output: Path | None) -> int:
    """Estimate and report; 1 if a value is withheld."""
    from cylconn_ros.identification.effort import NAMES
    from cylconn_ros.identification.recording import identify_axis

    topic, _, joint = axis.partition(":")
    try:
        found = identify_axis(recordings, topic, joint)
    except IdentifyError as error:
        raise CommandError(f"{recordings[0]}: {error}") from None
    if output is not None:
        text = json.dumps(_as_json(found), indent=2, ensure_ascii=False)
        if str(output) == "-":
            print(text)
        else:
            try:
                output.write_text(text + "\n", encoding="utf-8")
            except OSError as error:
                raise CommandError(f"{output}: {error.strerror or error}") from None
    if str(output) != "-":
        print("\n".join(_table(found)))
    return 0 if all(found.determined(name) for name in NAMES) else 1


def _table(found: AxisEstimate) -> list[str]:
    from cylconn_ros.identification.effort import NAMES, UNITS

    lines = [
        f"windows     {found.windows}",
        f"residual    {found.residual:.3g} N, root mean square of the effort of a window",
        f"delay       {1e3 * found.delay:.3g} ms of the effort against the position",
        "",
        f"{'parameter':<12}{'estimate':>11}  {'95 % interval':<26}unit",
    ]
    for name, unit in zip(NAMES, UNITS, strict=True):
        value, low, high = found[name]
        if found.determined(name):
            between = f"{low:.5g} … {high:.5g}"
            lines.append(f"{_TITLES[name]:<12}{value:>11.5g}  {between:<26}{unit}")
        else:
            lines.append(f"{_TITLES[name]:<12}{'-':>11}  {'-':<26}{unit:<6}{_WITHHELD}")
    lines += [
        "",
        "friction is one number: without reactions mu, FCint, L and R are not told apart",
        "of a spin: M in kg.m^2, forces in N.m",
    ]
    return lines


def _as_json(found: AxisEstimate) -> dict[str, Any]:
    from cylconn_ros.identification.effort import NAMES, UNITS

    estimates = {}
    for name, unit in zip(NAMES, UNITS, strict=True):
        value, low, high = found[name]
        good = found.determined(name)
        estimates[name] = {
            "estimated": good,
            "value": value if good else None,
            "interval_95": [low, high] if good else None,
            "unit": unit,
            "note": "" if good else _WITHHELD,
        }
    return {
        "estimates": estimates,
        "windows": found.windows,
        "residual": found.residual,
        "delay": found.delay,
    }
