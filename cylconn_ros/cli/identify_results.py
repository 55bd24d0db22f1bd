"""Results of an identification as text, JSON, feed-forward table and picture."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.cli.identify_page import given
from cylconn_ros.errors import CommandError

if TYPE_CHECKING:
    from cylconn_ros.identification.friction import Estimate, Identification

_LEAST_NOISE = 1e-7  # m/s; below, the sample period limits the accuracy and not a sensor
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


def write_json(found: Identification, path: Path) -> None:
    """Write the results to a file; ``-``: print them."""
    text = json.dumps(as_json(found), indent=2, ensure_ascii=False)
    if str(path) == "-":
        print(text)
        return
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None


def write_table(found: Identification, path: Path) -> None:
    """Write the feed-forward table of friction."""
    from cylconn_ros.identification.advice import feed_forward

    try:
        path.write_text(feed_forward(found, path.suffix), encoding="utf-8")
    except (OSError, ValueError) as error:
        raise CommandError(f"{path}: {getattr(error, 'strerror', None) or error}") from None


def draw_picture(found: Identification, name: str, path: Path) -> None:
    """Write the picture of the estimate."""
    from cylconn_ros.identification.picture import draw, save

    try:
        save(draw(found, name), path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None
