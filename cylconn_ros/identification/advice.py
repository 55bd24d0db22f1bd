"""What to record next, and a table of friction over the rate for controllers."""

from __future__ import annotations

import numpy as np

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.friction import Identification
from cylconn_ros.identification.likelihood.law import friction

POINTS = 41  # of a table
ALONE = {
    "preload": "slide under another load across the slot, e.g. hang {mass:.2g} kg on the body "
    "at node b",
    "overlap": "slide with a bending moment that changes: hang {mass:.2g} kg at {arm:.2g} m "
    "from node b",
    "radius": "slide {slide:.2g} m/s and turn {spin:.2g} rad/s at the same time, in changing ratio",
}


def advice(found: Identification) -> list[str]:
    """Return the motions to record for what the recording does not determine."""
    load = max(float(np.median(found.normal)), 1e-3)
    slide = max(float(np.abs(found.slides).max()), 0.05)
    sizes = {
        "mass": load / 9.81,
        "arm": max(found.law.radius * 3.0, 0.05),
        "slide": slide,
        "spin": slide / found.law.radius,
    }
    lines = [
        f"for {name}: {text.format(**sizes)}"
        for name, text in ALONE.items()
        if name in found.choice.held
    ]
    left = found.choice.left_out
    if "one direction only" in left.get("offset force", ""):
        lines.append("for offset and direction: slide to and fro, not in one direction only")
    if _has_preload(found):
        lines.append(
            "if mass centre and gravity of the parameters are not certain: a mass centre off along "
            "the slot, or missing gravity, looks like a preload; identify the same motion with the "
            "slot at another inclination: a preload stays, what looks like one changes with the "
            "weight across the slot"
        )
    if found.choice.alternatives:
        mass = sizes["mass"]
        lines.append(
            f"to tell offset from direction: repeat the motion with {mass:.2g} kg more on the body"
        )
    if "hardly changes" in left.get("Stribeck decay", ""):
        lines.append(
            f"for Stribeck and viscous friction: slide between {0.03 * slide:.2g} and "
            f"{2.0 * slide:.2g} m/s"
        )
    if not found.accepted:
        lines.append("repeat the motion at another rate and load, and compare the pattern")
    return lines


def _has_preload(found: Identification) -> bool:
    e = found.estimates.get("preload")
    return e is not None and e.found and not e.low <= 0.0 <= e.high


def feed_forward(found: Identification, suffix: str) -> str:
    """Return friction over the rate of the slide as text, at the median normal force.

    Columns: rate (m/s) and the force (N) that a controller adds to overcome friction.

    Raises IdentifyError if the model is rejected, ValueError for another suffix than .yaml or .csv.
    """
    if not found.accepted:
        raise IdentifyError("the model is rejected: there is no table of friction")
    top = max(float(np.abs(found.slides).max()), 1e-3)
    positive = np.geomspace(1e-3 * top, top, POINTS // 2)
    rates = np.r_[-positive[::-1], 0.0, positive]
    load = float(np.median(found.normal)) - found.law.preload
    pairs, loads = np.column_stack([rates, 0.0 * rates]), np.full((len(rates), 2), (load, 0.0))
    force = -friction(found.law, pairs, loads, np.zeros(len(rates)))[:, 0]
    force[len(positive)] = found.law.offset
    if suffix == ".csv":
        rows = [f"{r:.9g},{f:.9g}" for r, f in zip(rates, force, strict=True)]
        return "\n".join(["rate_m_per_s,force_N", *rows]) + "\n"
    if suffix in (".yaml", ".yml"):
        values = [", ".join(f"{x:.9g}" for x in column) for column in (rates, force)]
        normal = float(np.median(found.normal))
        return (
            f"# friction at a normal force of {normal:.6g} N\n"
            f"feed_forward:\n  rate: [{values[0]}]  # m/s\n  force: [{values[1]}]  # N\n"
        )
    raise ValueError("a table must end in .yaml or .csv")
