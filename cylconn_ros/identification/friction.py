"""Friction identification from samples: kinetic fit, excitation, static friction, intervals."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError, IndeterminateError, UnknownNameError
from cylconn_ros.identification import static
from cylconn_ros.identification.intervals import Intervals, measure_intervals
from cylconn_ros.identification.kinetic import (
    MIN_SIGNAL_TO_NOISE,
    NAMES,
    OVERLAP,
    PRELOAD,
    RADIUS,
    ContactLoads,
    FrictionLaw,
    KineticFit,
    fit_law,
    parameter_scales,
    predicted_deviations,
    slip_direction,
    well_above_noise,
)
from cylconn_ros.identification.segments import Segment, find_segments, slip_rate, slip_threshold
from cylconn_ros.identification.windows import Windows, cut_windows
from cylconn_ros.recording.samples import RecordedSample, SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

PARAMETERS = ("preload", "overlap", "radius")
"""Parameters that need not be estimated if they are known."""
MIN_WINDOWS = 10  # slip windows
DIRECTION_SIGNIFICANCE = 8.0  # standard deviations by which slip exceeds its noise in a window
DECAY_TIMES = 5.0  # decay rates above which the static coefficient has no effect on slip
MAX_PREDICTED_DEVIATION = 0.25  # of a parameter's effect on the limit; above: not excited
MAX_RELATIVE_DEVIATION = 0.4  # relative standard deviation of mu
COARSE_DEVIATIONS = 2.0  # standard deviations of the change with half of the samples
SIGNIFICANCE = 0.05


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A friction parameter: estimated with a 95 % interval, assumed, or unavailable; SI units.

    Attributes
    ----------
        name: as below ``friction`` in a scene.
        value: NaN if unavailable.
        low, high: ends of the 95 % interval; NaN if the parameter was not estimated.
        unit: ``1`` for a coefficient.
        note: why it was not estimated, or a remark.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    note: str

    def __post_init__(self) -> None:
        for name in ("value", "low", "high"):  # Python floats also for NumPy scalars
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def found(self) -> bool:
        """Whether the parameter was estimated."""
        return bool(np.isfinite(self.low))


@dataclasses.dataclass(frozen=True)
class Identification:
    """Result of a friction identification.

    Attributes
    ----------
        estimates: by name, in the order of a report.
        samples, duration: of the recording; s.
        slip_intervals, rest_intervals: number of intervals used of either regime.
        windows, rest_windows: number of windows that they make.
        skipped: number of skipped intervals or windows by reason.
        noise: standard deviation of a component of the slip rate, m/s.
        misfit: mean squared residual over that of the noise; 1 if the law fits to within the noise.
        normal, traction, deviation: (windows,) FN, P and the standard deviation of P, N.
        disc: (windows, 2) friction (f1f, m1f/R) over its limit; on the unit circle but for noise.
        law: the fitted law.
        static: static friction.
        problem: why the estimates are worth nothing: the motion leaves the joint; else empty.
    """

    estimates: dict[str, Estimate]
    samples: int
    duration: float
    slip_intervals: int
    rest_intervals: int
    windows: int
    rest_windows: int
    skipped: Counter[str]
    noise: float
    misfit: float
    normal: Array = dataclasses.field(repr=False)
    traction: Array = dataclasses.field(repr=False)
    deviation: Array = dataclasses.field(repr=False)
    disc: Array = dataclasses.field(repr=False)
    law: FrictionLaw
    static: static.StaticFriction = dataclasses.field(repr=False)
    problem: str = ""

    def __getitem__(self, name: str) -> Estimate:
        """Return an estimate by name; raise UnknownNameError if there is none."""
        try:
            return self.estimates[name]
        except KeyError:
            raise UnknownNameError(name, self.estimates) from None


def estimate_friction(
    scene: Scene, samples: Iterable[RecordedSample], known: Mapping[str, float] | None = None
) -> Identification:
    """Estimate friction from samples.

    Args:
        scene: body inertias and nodes; its friction parameters are the start of the search.
        samples: complete samples of a motion.
        known: parameters not to be estimated (:data:`PARAMETERS`), with their values in SI units.

    Raises IndeterminateError if the motion does not suffice, SceneError without an inertia.
    """
    known = dict(known or {})
    start = _start(scene, known)
    samples = SampleArrays.collect(samples)
    measured = measure_intervals(scene, samples)
    segments = find_segments(measured, start.radius)
    slips, skipped = _slip_windows(measured, segments, start.radius)
    between = int(measured.usable.sum()) - sum(segment.size for segment in segments)
    skipped["between slip and rest, or in a segment that is too short"] = between
    loads = ContactLoads.of(slips)
    fitted, notes = _fit_excited(slips, loads, start, _free(known))
    _refuse_noise(fitted)
    coarse = _coarse_change(scene, samples, fitted)
    rest = static.estimate_static(measured, segments, fitted)
    estimates = {e.name: e for e in _estimates(fitted, coarse, notes, known, loads)}
    estimates["static_coefficient"] = _static_estimate(rest)
    law = fitted.law
    along = slip_direction(slips, law.radius) * [1.0, 1.0 / law.radius]
    deviation = np.einsum("ni,nij,nj->n", along, slips.covariance[:, [[0], [3]], [0, 3]], along)
    return Identification(
        estimates=estimates,
        samples=len(samples),
        duration=float(measured.time[-1]),
        slip_intervals=int(slips.intervals.sum()),
        rest_intervals=sum(s.size for s in segments if not s.slips),
        windows=len(slips),
        rest_windows=rest.windows,
        skipped=measured.skipped + +skipped,
        noise=slip_rate(measured, law.radius)[1],
        misfit=fitted.misfit,
        normal=law.normal(loads.radial, loads.moment),
        traction=np.hypot(slips.wrench[:, 0], slips.wrench[:, 3] / law.radius),
        deviation=np.sqrt(deviation),
        disc=slips.wrench[:, [0, 3]]
        / [1.0, law.radius]
        / (law.coefficient * law.normal(loads.radial, loads.moment))[:, None],
        law=law,
        static=rest,
        problem=measured.problem,
    )


def _start(scene: Scene, known: Mapping[str, float]) -> FrictionLaw:
    """Return the friction law of the parameters, at which the search starts."""
    friction = scene.friction
    radius = known.get("radius", friction.radius)
    if not np.isfinite(radius):
        raise IdentifyError(
            "friction.radius: is not in the parameters; the slip rate of a spin needs it: give it "
            "with --params (then it is the start value) or --known radius=0.02"
        )
    overlap = known.get("overlap", friction.overlap)
    mu = friction.coefficient if friction.coefficient > 0.0 else 0.1
    preload = known.get("preload", friction.preload)
    return FrictionLaw(mu, preload, 2.0 / overlap if overlap > 0.0 else 0.0, radius)


def _free(known: Mapping[str, float]) -> list[int]:
    return [k for k, name in enumerate(NAMES) if name not in known]


def _slip_windows(
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
    if np.isfinite(friction.static_coefficient) and friction.decay > 0.0:
        mixed = ~refused & (slip * friction.decay < DECAY_TIMES)
        skipped[f"windows slower than {DECAY_TIMES:g}/friction.decay"] = int(mixed.sum())
        refused |= mixed
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


def _fit_excited(
    w: Windows, loads: ContactLoads, start: FrictionLaw, free: list[int]
) -> tuple[KineticFit, dict[str, str]]:
    """Fit the parameters that the motion excites.

    Returns
    -------
        The fit, and for every other parameter in ``free`` the reason why it is held.
    """
    notes: dict[str, str] = {}
    if OVERLAP in free and len(free) > 1 and loads.signal_to_noise[1] < MIN_SIGNAL_TO_NOISE:
        notes["overlap"] = "not excited: there is no bending moment beyond noise"
        free = [j for j in free if j != OVERLAP]
    # A first estimate of the coefficient, for the predicted deviations.
    traction = np.hypot(w.wrench[:, 0], w.wrench[:, 3] / start.radius)
    guess = float(traction.mean() / max(start.normal(loads.radial, loads.moment).mean(), 1e-300))
    law = dataclasses.replace(start, coefficient=min(max(guess, 1e-3), 10.0))
    while True:
        while True:
            worst = predicted_deviations(w, loads, law, free)
            if (worst <= MAX_PREDICTED_DEVIATION).all() or len(free) == 1:
                break
            k = _least_excited(w, loads, law, free)
            notes[NAMES[k]] = _not_excited(k, w, loads, law)
            free = [j for j in free if j != k]
        fitted = fit_law(w, loads, law, free)
        # Again at the fitted law, and with the spread of the windows themselves.
        size = np.sqrt(np.diag(fitted.covariance)) / parameter_scales(loads, fitted.law)[free]
        if (
            len(free) == 1
            or (
                np.maximum(size, predicted_deviations(w, loads, fitted.law, free))
                <= MAX_PREDICTED_DEVIATION
            ).all()
        ):
            return fitted, notes
        k = _least_excited(w, loads, fitted.law, free)
        notes[NAMES[k]] = _not_excited(k, w, loads, fitted.law)
        free = [j for j in free if j != k]


def _refuse_noise(fitted: KineticFit) -> None:
    """Raise IndeterminateError if the coefficient does not differ significantly from zero."""
    relative = float(np.sqrt(fitted.covariance[0, 0]))
    if relative > MAX_RELATIVE_DEVIATION:
        mu = fitted.law.coefficient
        raise IndeterminateError(
            f"no friction shows beyond the noise: mu = {mu:.2g} with a standard deviation of "
            f"{mu * relative:.2g}"
        )


def _least_excited(w: Windows, loads: ContactLoads, law: FrictionLaw, free: list[int]) -> int:
    """Return the parameter to hold so that the others are determined best.

    Among nearly equal ones: bending before preload before radius.
    """
    order = [k for k in (OVERLAP, PRELOAD, RADIUS) if k in free]
    left = [
        float(predicted_deviations(w, loads, law, [j for j in free if j != k]).max()) for k in order
    ]
    best = min(left)
    return next(k for k, worst in zip(order, left, strict=True) if worst <= 1.5 * best)


def _not_excited(k: int, w: Windows, loads: ContactLoads, law: FrictionLaw) -> str:
    """Return the reason why a motion does not determine a parameter."""
    if k == RADIUS:
        spin = np.abs(w.rates[:, 1]) * law.radius
        share = spin / np.maximum(np.hypot(w.rates[:, 0], spin), 1e-300)
        if share.max() < 0.1:
            return "not excited: it slides and hardly spins"
        if share.min() > 0.9:
            return "not excited: it spins and hardly slides, which determines only mu R"
        return "not excited: the ratio of slide to spin hardly changes"
    radial = f"{loads.radial.min():.3g} to {loads.radial.max():.3g} N"
    if k == OVERLAP:
        if 2.0 * loads.moment.max() < 1e-3 * loads.radial.mean() * law.radius:
            return "not excited: there is no bending moment"
        bending = f"{loads.moment.min():.3g} to {loads.moment.max():.3g} N.m"
        return (
            f"not excited: radial force ({radial}) and bending moment ({bending}) hardly "
            "change relative to each other"
        )
    return f"not excited: the normal force hardly changes (radial force {radial})"


def _coarse_change(scene: Scene, samples: SampleArrays, fitted: KineticFit) -> Array:
    """Return the change (free,) of the estimates, beyond noise, with every second sample removed.

    Zeros if the remaining samples do not suffice.
    """
    try:
        measured = measure_intervals(scene, samples.every_second())
        segments = find_segments(measured, fitted.law.radius)
        slips, _ = _slip_windows(measured, segments, fitted.law.radius)
        again = fit_law(slips, ContactLoads.of(slips), fitted.law, fitted.free)
    except IdentifyError:
        return np.zeros(len(fitted.free))
    moved = (again.law.vector - fitted.law.vector)[list(fitted.free)]
    noise = np.diag(again.covariance) + np.diag(fitted.covariance)
    return np.asarray(np.sqrt(np.maximum(moved**2 - COARSE_DEVIATIONS**2 * noise, 0.0)))


def _estimates(
    fitted: KineticFit,
    coarse: Array,
    notes: Mapping[str, str],
    known: Mapping[str, float],
    loads: ContactLoads,
) -> list[Estimate]:
    from scipy.stats import t

    law, x = fitted.law, fitted.law.vector
    spread = float(t.isf(SIGNIFICANCE / 2.0, fitted.freedom)) * np.sqrt(np.diag(fitted.covariance))
    # An error of second order in the period h is a third of the change from h to 2 h; doubled as a
    # safety margin.
    half = np.sqrt(spread**2 + (coarse * 2.0 / 3.0) ** 2 + fitted.systematic**2)
    units = dict(zip(NAMES, ("1", "N", "m", "m"), strict=True))
    found = []
    for k, name in enumerate(NAMES):
        if k not in fitted.free:
            value = {"preload": law.preload, "radius": law.radius}.get(
                name, 2.0 / law.bending if law.bending > 0.0 else 0.0
            )
            note = "assumed, as given" if name in known else notes[name]
            found.append(Estimate(name, value, np.nan, np.nan, units[name], note))
            continue
        width = half[fitted.free.index(k)]
        low, high = x[k] - width, x[k] + width
        if name == "preload":
            found.append(Estimate(name, x[k], low, high, "N", ""))
        elif name == "overlap":
            found.append(_overlap(x[k], low, high))
        else:
            value, low, high = np.exp(x[k]), np.exp(low), np.exp(high)
            found.append(Estimate(name, value, low, high, units[name], ""))
    return found


def _overlap(bending: float, low: float, high: float) -> Estimate:
    """Convert 2/L to L; if the interval of 2/L contains zero, L has no upper bound."""
    if high <= 0.0:
        note = "the traction decreases with bending: the law does not apply"
        return Estimate("overlap", np.nan, np.nan, np.nan, "m", note)
    value = 2.0 / bending if bending > 0.0 else np.inf
    upper = 2.0 / low if low > 0.0 else np.inf
    note = "" if low > 0.0 else "the effect of bending may be zero"
    return Estimate("overlap", value, 2.0 / high, upper, "m", note)


def _static_estimate(rest: static.StaticFriction) -> Estimate:
    value, half = static.breakaway_interval(rest)
    bound = "" if not np.isfinite(rest.bound) else f"; at least {rest.bound:.4g} at rest"
    if not len(rest.breakaways):
        reason = "no rest" if not rest.windows else "no slip after rest"
        return Estimate(
            "static_coefficient", np.nan, np.nan, np.nan, "1", f"no break-away: {reason}{bound}"
        )
    count = len(rest.breakaways)
    note = f"of {count} break-away{'s' if count > 1 else ''}{bound}"
    return Estimate("static_coefficient", value, value - half, value + half, "1", note)
