"""Windows of slip with calibrated loads: the data of a fit, from the forces of a recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError, IndeterminateError
from cylconn_ros.identification.forces.correlation import Correlation, independent_noise, together
from cylconn_ros.identification.forces.intervals import Intervals
from cylconn_ros.identification.forces.segments import (
    Segment,
    find_segments,
    slip_rate,
    slip_threshold,
)
from cylconn_ros.identification.forces.windows import Windows, cut_windows
from cylconn_ros.identification.likelihood.contact_loads import (
    Calibrated,
    ContactLoads,
    well_above_noise,
)
from cylconn_ros.identification.likelihood.excitation import BASE
from cylconn_ros.identification.likelihood.law import NAMES, FrictionLaw
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

MIN_WINDOWS = 10  # slip windows
DIRECTION_SIGNIFICANCE = 8.0  # standard deviations by which slip exceeds its noise in a window


class Prepared(NamedTuple):
    """Data of a fit.

    Attributes
    ----------
        measured: intervals, taken together if their noise is correlated.
        taken: how many were taken together; 0: no number makes the noise white.
        noise: correlation of neighbouring samples.
        segments: of slip and rest.
        skipped: number of skipped intervals or windows by reason.
        loads, data: of the windows of slip.
    """

    measured: Intervals
    taken: int
    noise: Correlation
    segments: list[Segment]
    skipped: Counter[str]
    loads: ContactLoads
    data: Calibrated


def prepare(
    measured: Intervals, radius: float, noise: tuple[int, Correlation] | None = None
) -> Prepared:
    """Return the windows of slip with their loads; ``radius`` is the start value of R.

    ``noise``: how many intervals are taken together, and their correlation, if they are known.

    Raises IndeterminateError if there is too little slip.
    """
    if noise is None:
        measured, taken, correlation = independent_noise(measured, radius)
    else:
        taken, correlation = noise
        measured = together(measured, max(taken, 1))
    segments = find_segments(measured, radius)
    slips, skipped = slip_windows(measured, segments, radius)
    between = int(measured.usable.sum()) - sum(segment.size for segment in segments)
    skipped["between slip and rest, or in a segment that is too short"] = between
    loads = ContactLoads.of(slips)
    return Prepared(
        measured, taken, correlation, segments, skipped, loads, Calibrated.of(slips, loads, radius)
    )


def start_law(scene: Scene, known: Mapping[str, float]) -> FrictionLaw:
    """Return the friction law of the parameters, at which the search starts."""
    friction = scene.friction
    radius = known.get("radius", friction.radius)
    if not np.isfinite(radius):
        raise IdentifyError(
            "friction.radius: is not in the parameters; the slip rate of a spin needs it: give it "
            "with --params (then it is the start value) or --known radius=0.02"
        )
    overlap = known.get("overlap", friction.overlap)
    mu = friction.mean_coefficient if friction.mean_coefficient > 0.0 else 0.1
    preload = known.get("preload", friction.preload)
    return FrictionLaw(mu, preload, 2.0 / overlap if overlap > 0.0 else 0.0, radius)


def not_parameters(scene: Scene, commanded: bool, known: Mapping[str, float]) -> dict[str, str]:
    """Return the parameters that the recorded friction does not have, with the reason.

    ``commanded``: the preload is a recorded input. ``known``: values that the user gave. They count
    as zero. Raises IdentifyError if nothing presses shaft and sleeve together.
    """
    inputs, found = scene.friction.inputs, {}
    if "preload" not in inputs:
        found["preload"] = "left out (friction.inputs)"
    elif commanded:
        found["preload"] = "commanded in the recording (~/preload): a known input"
        if "preload" in known:
            raise IdentifyError(
                f"known preload = {known['preload']:g}: the preload was commanded in the recording "
                "(~/preload), and its values are used; do not give another one"
            )
    if "bending" not in inputs:
        found["overlap"] = "left out (friction.inputs)"
    pressing = known.get("preload", scene.friction.preload)
    if tuple(inputs) == ("preload",) and not commanded and not pressing > 0.0:
        raise IdentifyError(
            "friction.inputs = [preload] with preload = 0: nothing presses shaft and sleeve "
            "together; only mu FCint shows in such a recording: give the preload (with --params, "
            "or --known preload=VALUE)"
        )
    return found


def free_parameters(known: Mapping[str, float]) -> list[int]:
    """Return the indices of the parameters of Coulomb friction that are to be estimated."""
    return [k for k in BASE if NAMES[k] not in known]


def slip_windows(
    measured: Intervals, segments: list[Segment], radius: float
) -> tuple[Windows, Counter[str]]:
    """Return the slip windows from which friction can be read, and the skipped ones by reason."""
    windows = cut_windows(measured, [s for s in segments if s.slips])
    skipped: Counter[str] = Counter()
    skipped["windows in which the motion is not smooth"] = windows.rejected
    s = np.concatenate([windows.rates[:, None], windows.ends], axis=1) * [1.0, radius]
    slip = np.linalg.norm(s, axis=2).min(axis=1)
    reverses = (s[:, 1] * s[:, 2]).sum(axis=1) <= 0.0  # between the two ends
    noise = np.linalg.norm(windows.rate_noise * [1.0, radius], axis=1)
    friction = measured.scene.friction
    refused = (slip <= DIRECTION_SIGNIFICANCE * noise) | reverses
    skipped["windows whose slip has no significant direction"] = int(refused.sum())
    if np.isfinite(friction.max_force):
        traction = np.hypot(windows.wrench[:, 0], windows.wrench[:, 3] / radius)
        capped = ~refused & (traction > 0.9 * friction.max_force)
        skipped["windows near friction.max_force"] = int(capped.sum())
        refused |= capped
    chosen = windows.take(~refused)
    if len(chosen) >= MIN_WINDOWS:
        clear = well_above_noise(chosen, ContactLoads.of(chosen))
        if clear.sum() >= MIN_WINDOWS:
            skipped["windows with a radial force or bending moment near zero"] = int((~clear).sum())
            chosen = chosen.take(clear)
    if len(chosen) < MIN_WINDOWS:
        rate, deviation = slip_rate(measured, radius)
        threshold = slip_threshold(measured, deviation)
        reasons = ", ".join(f"{count} {name}" for name, count in (+skipped).items())
        reasons += f"; {measured.problem}" if measured.problem else ""
        raise IndeterminateError(
            f"too little slip to identify friction: {len(chosen)} windows of slip, at least "
            f"{MIN_WINDOWS} are needed; the slip rate reaches {rate.max():.3g} m/s, the threshold "
            f"is {threshold:.3g} m/s (friction.rest_rate, five times the noise)"
            + (f"; skipped: {reasons}" if reasons else "")
        )
    return chosen, +skipped
