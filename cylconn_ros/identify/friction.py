"""Estimate the friction of a joint from a recording: the whole way, and what it has to say."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identify import static as sticking
from cylconn_ros.identify.intervals import Measured, measure
from cylconn_ros.identify.kinetic import (
    CLEAR,
    NAMES,
    Fitted,
    Law,
    Loads,
    away_from_zero,
    direction,
    fit,
    natural,
    precision,
)
from cylconn_ros.identify.segments import Stretch, slip_rate, stretches, threshold
from cylconn_ros.identify.windows import Windows, windows
from cylconn_ros.recording.samples import Sampled, Samples
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

FEWEST = 10  # windows of slip
SURE = 8.0  # standard deviations by which slip must exceed its noise for a direction
FADED = 5.0  # decay times after which the static coefficient no longer counts
EXCITED = 0.25  # natural units: a parameter known worse than to half its effect is not excited
FAINT = 0.4  # relative standard deviation of mu
BEYOND = 2.0  # standard deviations
CHANCE = 0.05


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A parameter: found with its 95 % interval, or assumed, or not to be had; SI units."""

    name: str
    value: float  # NaN: none
    low: float
    high: float
    unit: str
    note: str

    @property
    def found(self) -> bool:
        """Whether it was estimated."""
        return bool(np.isfinite(self.low))


@dataclasses.dataclass(frozen=True)
class Identified:
    """What a recording tells.

    Attributes
    ----------
        estimates: by name, in the order of a report.
        samples, duration: of the recording; s.
        slipping, resting: intervals used, and ``windows``, ``rests`` the windows they make.
        left_out: what was not used, and how much of it.
        noise: standard deviations of a component of the slip rate, m/s.
        misfit: mean squared residual over its noise; 1: the law fits to within the noise.
        normal, traction, deviation: (windows,) FN, P and the standard deviation of P, N.
        disc: (windows, 2) friction (f1f, m1f/R) over its limit: on the unit circle, but for noise.
        law: as fitted. static: what rest tells.
    """

    estimates: dict[str, Estimate]
    samples: int
    duration: float
    slipping: int
    resting: int
    windows: int
    rests: int
    left_out: Counter[str]
    noise: float
    misfit: float
    normal: Array
    traction: Array
    deviation: Array
    disc: Array
    law: Law
    static: sticking.Static


def identify(
    scene: Scene, samples: Iterable[Sampled], known: Mapping[str, float] | None = None
) -> Identified:
    """Estimate friction from samples.

    ``known`` holds parameters not to be estimated (``preload``, ``overlap``, ``radius``; SI).
    Raises IdentifyError where the motion tells nothing, SceneError where no inertia is known.
    """
    known = dict(known or {})
    start = _start(scene, known)
    samples = Samples.of(samples)
    measured = measure(scene, samples)
    found = stretches(measured, start.radius)
    slips, left_out = _slipping(measured, found, start.radius)
    between = int(measured.usable.sum()) - sum(stretch.size for stretch in found)
    left_out["between slip and rest, or in too short a stretch of either"] = between
    loads = Loads.of(slips)
    fitted, notes = _excited(slips, loads, start, _free(known))
    _refuse_noise(fitted)
    coarse = _coarse(scene, samples, fitted)
    rest = sticking.static(measured, found, fitted)
    estimates = {e.name: e for e in _estimates(fitted, coarse, notes, known, loads)}
    estimates["static_coefficient"] = _static(rest)
    law = fitted.law
    along = direction(slips, law.radius) * [1.0, 1.0 / law.radius]
    deviation = np.einsum("ni,nij,nj->n", along, slips.covariance[:, [[0], [3]], [0, 3]], along)
    return Identified(
        estimates=estimates,
        samples=len(samples),
        duration=float(measured.time[-1]),
        slipping=int(slips.intervals.sum()),
        resting=sum(s.size for s in found if not s.slips),
        windows=len(slips),
        rests=rest.windows,
        left_out=measured.left_out + +left_out,
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
    )


def _start(scene: Scene, known: Mapping[str, float]) -> Law:
    """What the recording's parameters say of friction, where the search begins."""
    friction = scene.friction
    radius = known.get("radius", friction.radius)
    if not np.isfinite(radius):
        raise IdentifyError(
            "friction.radius: is not in the parameters; to weigh spin against slide, give it with "
            "--params (estimated from there on) or --known radius=0.02"
        )
    overlap = known.get("overlap", friction.overlap)
    mu = friction.coefficient if friction.coefficient > 0.0 else 0.1
    preload = known.get("preload", friction.preload)
    return Law(mu, preload, 2.0 / overlap if overlap > 0.0 else 0.0, radius)


def _free(known: Mapping[str, float]) -> list[int]:
    return [k for k, name in enumerate(NAMES) if name not in known]


def _slipping(
    measured: Measured, found: list[Stretch], radius: float
) -> tuple[Windows, Counter[str]]:
    """The windows of slip that friction can be read from, and what was left out of them."""
    all_windows = windows(measured, [s for s in found if s.slips])
    left_out: Counter[str] = Counter()
    left_out["windows with a jerk in them"] = all_windows.kinks
    s = np.concatenate([all_windows.rates[:, None], all_windows.ends], axis=1) * [1.0, radius]
    slip = np.linalg.norm(s, axis=2).min(axis=1)
    turns = (s[:, 1] * s[:, 2]).sum(axis=1) <= 0.0  # from one end to the other
    own = np.linalg.norm(all_windows.rate_noise * [1.0, radius], axis=1)
    friction = measured.scene.friction
    slow = (slip <= SURE * own) | turns
    left_out["windows that slip too slowly for a direction"] = int(slow.sum())
    if np.isfinite(friction.static_coefficient) and friction.decay > 0.0:
        mixed = ~slow & (slip * friction.decay < FADED)
        left_out[f"windows slower than {FADED:g}/friction.decay"] = int(mixed.sum())
        slow |= mixed
    if np.isfinite(friction.max_force):
        traction = np.hypot(all_windows.wrench[:, 0], all_windows.wrench[:, 3] / radius)
        capped = ~slow & (traction > 0.9 * friction.max_force)
        left_out["windows near friction.max_force"] = int(capped.sum())
        slow |= capped
    chosen = all_windows.take(~slow)
    if len(chosen) >= FEWEST:
        away = away_from_zero(chosen, Loads.of(chosen))
        if away.sum() >= FEWEST:
            left_out["windows with a radial force or bending near zero"] = int((~away).sum())
            chosen = chosen.take(away)
    if len(chosen) < FEWEST:
        rate, deviation = slip_rate(measured, radius)
        least = threshold(measured, deviation)
        why = ", ".join(f"{count} {name}" for name, count in (+left_out).items())
        raise IdentifyError(
            f"too little slip to see friction: {len(chosen)} windows of slip, at least {FEWEST} "
            f"are needed; the slip rate reaches {rate.max():.3g} m/s and counts from "
            f"{least:.3g} m/s on (friction.rest_rate, five times the noise)"
            + (f"; left out: {why}" if why else "")
        )
    return chosen, +left_out


def _excited(
    w: Windows, loads: Loads, start: Law, free: list[int]
) -> tuple[Fitted, dict[str, str]]:
    """Fit what the motion shows; what it does not show is held, with the reason why."""
    notes: dict[str, str] = {}
    if 2 in free and len(free) > 1 and loads.clear[1] < CLEAR:
        notes["overlap"] = "not excited: there is no bending moment beyond noise"
        free = [j for j in free if j != 2]
    # A plain guess of the coefficient, for the scale on which excitation is judged.
    traction = np.hypot(w.wrench[:, 0], w.wrench[:, 3] / start.radius)
    guess = float(traction.mean() / max(start.normal(loads.radial, loads.moment).mean(), 1e-300))
    law = dataclasses.replace(start, coefficient=min(max(guess, 1e-3), 10.0))
    while True:
        while True:
            worst = precision(w, loads, law, free)
            if (worst <= EXCITED).all() or len(free) == 1:
                break
            k = _least_excited(w, loads, law, free)
            notes[NAMES[k]] = _why(k, w, loads, law)
            free = [j for j in free if j != k]
        fitted = fit(w, loads, law, free)
        # At the law found, and by the spread of the windows themselves.
        size = np.sqrt(np.diag(fitted.covariance)) / natural(loads, fitted.law)[free]
        if (
            len(free) == 1
            or (np.maximum(size, precision(w, loads, fitted.law, free)) <= EXCITED).all()
        ):
            return fitted, notes
        k = _least_excited(w, loads, fitted.law, free)
        notes[NAMES[k]] = _why(k, w, loads, fitted.law)
        free = [j for j in free if j != k]


def _refuse_noise(fitted: Fitted) -> None:
    """Refuse a coefficient that could as well be none."""
    relative = float(np.sqrt(fitted.covariance[0, 0]))
    if relative > FAINT:
        mu = fitted.law.coefficient
        raise IdentifyError(
            f"no friction shows beyond the noise: mu = {mu:.2g} with a standard deviation of "
            f"{mu * relative:.2g}"
        )


def _least_excited(w: Windows, loads: Loads, law: Law, free: list[int]) -> int:
    """The parameter without which the others are known best: bending, then preload, then radius."""
    order = [k for k in (2, 1, 3) if k in free]
    left = [float(precision(w, loads, law, [j for j in free if j != k]).max()) for k in order]
    best = min(left)
    return next(k for k, worst in zip(order, left, strict=True) if worst <= 1.5 * best)


def _why(k: int, w: Windows, loads: Loads, law: Law) -> str:
    """Why a motion does not show a parameter."""
    if NAMES[k] == "radius":
        spin = np.abs(w.rates[:, 1]) * law.radius
        share = spin / np.maximum(np.hypot(w.rates[:, 0], spin), 1e-300)
        if share.max() < 0.1:
            return "not excited: it slides and hardly spins"
        if share.min() > 0.9:
            return "not excited: it spins and hardly slides, which shows mu R alone"
        return "not excited: slide and spin are too much alike throughout"
    radial = f"{loads.radial.min():.3g} to {loads.radial.max():.3g} N"
    if NAMES[k] == "overlap":
        if 2.0 * loads.moment.max() < 1e-3 * loads.radial.mean() * law.radius:
            return "not excited: there is no bending moment"
        bending = f"{loads.moment.min():.3g} to {loads.moment.max():.3g} N.m"
        return (
            f"not excited: radial force ({radial}) and bending moment ({bending}) hardly change "
            "against each other"
        )
    return f"not excited: the normal force hardly changes (radial force {radial})"


def _coarse(scene: Scene, samples: Samples, fitted: Fitted) -> Array:
    """(free,) how far, beyond noise, the estimates move with every second sample left out.

    Zeros where that leaves too little to estimate from.
    """
    try:
        measured = measure(scene, samples.every_second())
        found = stretches(measured, fitted.law.radius)
        slips, _ = _slipping(measured, found, fitted.law.radius)
        again = fit(slips, Loads.of(slips), fitted.law, fitted.free)
    except IdentifyError:
        return np.zeros(len(fitted.free))
    moved = (again.law.vector - fitted.law.vector)[list(fitted.free)]
    noise = np.diag(again.covariance) + np.diag(fitted.covariance)
    return np.asarray(np.sqrt(np.maximum(moved**2 - BEYOND**2 * noise, 0.0)))


def _estimates(
    fitted: Fitted,
    coarse: Array,
    notes: Mapping[str, str],
    known: Mapping[str, float],
    loads: Loads,
) -> list[Estimate]:
    from scipy.stats import t

    law, x = fitted.law, fitted.law.vector
    spread = float(t.isf(CHANCE / 2.0, fitted.freedom)) * np.sqrt(np.diag(fitted.covariance))
    # Second order: h has a third of the difference between 2 h and h; twice that, to be safe.
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
    """L of 2/L: an interval of 2/L that reaches zero leaves L without an upper end."""
    if high <= 0.0:
        return Estimate(
            "overlap", np.nan, np.nan, np.nan, "m", "bending lowers the traction: not this law"
        )
    value = 2.0 / bending if bending > 0.0 else np.inf
    upper = 2.0 / low if low > 0.0 else np.inf
    note = "" if low > 0.0 else "bending may not count at all"
    return Estimate("overlap", value, 2.0 / high, upper, "m", note)


def _static(rest: sticking.Static) -> Estimate:
    value, half = sticking.interval(rest)
    bound = "" if not np.isfinite(rest.bound) else f"; at least {rest.bound:.4g} while it stuck"
    if not len(rest.breaks):
        why = "no rest" if not rest.windows else "no slip that follows a rest"
        return Estimate(
            "static_coefficient", np.nan, np.nan, np.nan, "1", f"no break-away: {why}{bound}"
        )
    count = len(rest.breaks)
    note = f"of {count} break-away{'s' if count > 1 else ''}{bound}"
    return Estimate("static_coefficient", value, value - half, value + half, "1", note)
