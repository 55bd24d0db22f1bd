"""Friction identification from samples: kinetic fit, excitation, static friction, intervals."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError, IndeterminateError, UnknownNameError
from cylconn_ros.identification import static
from cylconn_ros.identification.estimates import (
    Estimate,
    estimates_of,
    static_estimate,
    verdict,
    withheld,
)
from cylconn_ros.identification.forces.contact import Contact
from cylconn_ros.identification.forces.correlation import (
    MOST_TOGETHER,
    together,
)
from cylconn_ros.identification.forces.delay import Delay, twist_delay
from cylconn_ros.identification.forces.drives import PRESSED
from cylconn_ros.identification.forces.intervals import measure_intervals, with_mean_loads
from cylconn_ros.identification.forces.segments import (
    find_segments,
    slip_rate,
)
from cylconn_ros.identification.inertia import InertiaProblem, estimate_inertia
from cylconn_ros.identification.known import contradiction, wrongly_held
from cylconn_ros.identification.likelihood.contact_loads import (
    Calibrated,
    ContactLoads,
)
from cylconn_ros.identification.likelihood.kinetic import KineticFit, fit_law
from cylconn_ros.identification.likelihood.law import COEFFICIENT, FrictionLaw, slip
from cylconn_ros.identification.likelihood.patterns import (
    Pattern,
    Residuals,
    find_patterns,
    residuals_of,
    unexplained_spread,
)
from cylconn_ros.identification.likelihood.selection import Choice, choose
from cylconn_ros.identification.load_lag import LoadLag, Part, retimed
from cylconn_ros.identification.overlap import judge_overlap
from cylconn_ros.identification.sampling import sampled_slowly
from cylconn_ros.identification.slips import (
    Prepared,
    free_parameters,
    not_parameters,
    prepare,
    slip_windows,
    start_law,
)
from cylconn_ros.recording.samples import RecordedSample, SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

PARAMETERS = ("preload", "overlap", "radius")
"""Parameters that need not be estimated if they are known."""
MAX_RELATIVE_DEVIATION = 0.4  # relative standard deviation of mu
SLOWER_FASTER = "record slower and faster slip in both directions under several loads"
COARSE_DEVIATIONS = 2.0  # standard deviations of the change with half of the samples


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
        slides: (windows,) rate of the slide, m/s.
        law: the fitted law.
        contact: how the overlap changes with the slide.
        static: static friction.
        choice: terms of the model, those left out with the reason, and alternatives.
        patterns: residuals over rate, direction, load, place and time, most significant first.
        residuals: of the windows, N, with the quantities of the windows.
        doubts: errors of the sensors for which the estimates are withheld, with the remedy.
        remarks: errors of the sensors that were allowed for.
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
    slides: Array = dataclasses.field(repr=False)
    law: FrictionLaw
    contact: Contact
    static: static.StaticFriction = dataclasses.field(repr=False)
    choice: Choice = dataclasses.field(repr=False)
    patterns: tuple[Pattern, ...] = dataclasses.field(repr=False)
    residuals: Residuals = dataclasses.field(repr=False)
    doubts: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether the values hold: no doubt, and no residual pattern that rejects the model."""
        return not (self.doubts or any(one.rejected for one in self.patterns))

    def verdict(self) -> list[str]:
        """Say in sentences whether to believe the numbers, and why."""
        return [*verdict(self.choice, self.patterns, self.doubts), *self.remarks]

    def __getitem__(self, name: str) -> Estimate:
        """Return an estimate by name; raise UnknownNameError if there is none."""
        try:
            return self.estimates[name]
        except KeyError:
            raise UnknownNameError(name, self.estimates) from None


def estimate_friction(
    scene: Scene,
    samples: Iterable[RecordedSample],
    known: Mapping[str, float] | None = None,
    drive: Array | None = None,
    unknown: Sequence[str] = (),
    coarse: Part | None = None,
    retime: bool = True,
) -> Identification:
    """Estimate friction from samples.

    Args:
        scene: body inertias and nodes; its friction parameters are the start of the search.
        samples: complete samples of a motion.
        known: parameters not to be estimated (:data:`PARAMETERS`), with their values in SI units.
        drive: (n, 2) force and moment of a known drive over the interval that ends with each
            sample; default: the constant one of the scene. A third column is the commanded preload,
            which is then a known input, and no preload is estimated.
        unknown: ``mass`` and ``inertia`` (about the slot) of the free body if they are estimated
            too; the scene's are then the start of the search. It needs known forces.
        coarse: the same motion at half of the bandwidth, with its drive; the change of the
            estimates widens the intervals. Default: every second sample.
        retime: whether loads and drive are corrected to the times at which they act.

    Raises IndeterminateError if the motion does not suffice, SceneError without an inertia.
    """
    commanded = drive is not None and drive.shape[1] > PRESSED
    absent = not_parameters(scene, commanded, asked := dict(known or {}))
    known = {**asked, **dict.fromkeys(absent, 0.0)}
    start, given = start_law(scene, known), scene
    samples = SampleArrays.collect(samples)
    free, beside = free_parameters(known), None
    if unknown:
        problem = InertiaProblem(scene, samples, drive, start, free, unknown)
        beside = estimate_inertia(problem)
        scene = beside.scene
    every = measure_intervals(scene, samples, drive)
    delay = twist_delay(every)
    prepared = prepare(every, start.radius)
    measured, data, loads = prepared.measured, prepared.data, prepared.loads
    choice = choose(data, loads, start, free)
    fitted = choice.fitted
    right, lag = retimed(every, samples, drive, prepared, fitted)
    if right.remark and retime:
        result = estimate_friction(
            given, right.samples, asked, right.drive, unknown, right.coarse(coarse),
            retime=right.shift == 0.0,
        )  # fmt: skip
        return dataclasses.replace(result, remarks=(*result.remarks, right.remark))
    _refuse_noise(choice)
    fitted, inertia = beside.widened(fitted) if beside is not None else (fitted, [])
    residuals = residuals_of(data, fitted)
    patterns = find_patterns(data, fitted, residuals)
    less = coarse or _thinned(samples, drive)
    taken = (max(prepared.taken, 1) + 1) // 2
    change = _coarse_change(scene, less, fitted, taken, whole=coarse is not None)
    rest = static.estimate_static(measured, prepared.segments, fitted)
    estimates = estimates_of(fitted, change, choice, known, measured)
    wrong = contradiction(prepared, start, choice, known, absent)
    doubts, remarks = _judge_sensors(prepared, delay, lag, wrong)
    doubts, remarks, reason = _judge_fit(prepared, choice, fitted, patterns, (doubts, remarks))
    every_estimate = [*_present(estimates, absent), static_estimate(rest), *inertia]
    law = fitted.law
    return Identification(
        estimates={e.name: withheld(e, reason) if reason else e for e in every_estimate},
        samples=len(samples),
        duration=float(samples.stamps[-1] - samples.stamps[0]) * 1e-9,
        rest_windows=rest.windows,
        misfit=fitted.misfit,
        **_of_windows(prepared, law),
        law=law,
        contact=measured.contact,
        static=rest,
        choice=choice,
        patterns=tuple(patterns),
        residuals=residuals,
        doubts=doubts,
        remarks=remarks,
    )


def _present(estimates: Sequence[Estimate], absent: Mapping[str, str]) -> list[Estimate]:
    """Return the estimates, those of ``absent`` parameters without a value and with the reason."""
    return [
        dataclasses.replace(e, value=np.nan, note=absent[e.name]) if e.name in absent else e
        for e in estimates
    ]


def _of_windows(prepared: Prepared, law: FrictionLaw) -> dict[str, Any]:
    """Return the attributes of an identification that describe its windows."""
    slips, loads, measured = prepared.data.windows, prepared.loads, prepared.measured
    _, cos, sin = slip(slips.rates, law.radius)
    along = np.stack([cos, sin / law.radius], axis=1)
    ours = slips.wrench[:, [0, 3]] + law.without_coulomb(slips.rates)
    radial = loads.radial + slips.pressed
    normal = law.normal(radial, loads.moment, prepared.data.bending(law.bending))
    variance = np.einsum("ni,nij,nj->n", along, slips.covariance[:, [[0], [3]], [0, 3]], along)
    limit = law.ratio(slips.rates) * normal
    return {
        "slip_intervals": int(slips.intervals.sum()),
        "rest_intervals": sum(s.size for s in prepared.segments if not s.slips),
        "windows": len(slips),
        "skipped": measured.skipped + +prepared.skipped,
        "noise": slip_rate(measured, law.radius)[1],
        "slides": slips.rates[:, 0],
        "normal": normal,
        "traction": np.hypot(ours[:, 0], ours[:, 1] / law.radius),
        "deviation": np.sqrt(variance),
        "disc": ours / [1.0, law.radius] / limit[:, None],
    }


def _judge_fit(
    prepared: Prepared,
    choice: Choice,
    fitted: KineticFit,
    patterns: Sequence[Pattern],
    known: tuple[tuple[str, ...], tuple[str, ...]],
) -> tuple[tuple[str, ...], tuple[str, ...], str]:
    """Return all doubts and remarks, and the first reason to withhold the estimates, or nothing.

    ``known``: doubts and remarks so far.
    """
    doubts, remarks = known
    if choice.undetermined:
        doubts += (f"{choice.undetermined}; {SLOWER_FASTER}",)
    elif wrong := wrongly_held(prepared, choice):
        doubts += (f"{wrong}; {SLOWER_FASTER}, or give its value (--known)",)
    doubt, remark = judge_overlap(prepared, choice.fitted)
    doubts = (*filter(None, [prepared.measured.problem, doubt]), *doubts)
    rejected = [f"model rejected: {one.describe()}" for one in patterns if one.rejected]
    if not rejected and (spread := unexplained_spread(prepared.data, fitted)):
        doubts += (spread,)
    doubts += sampled_slowly(prepared, fitted)
    reason = next(iter([*doubts, *rejected]), "")
    if remark and not reason:
        remarks += (remark,)
    return doubts, remarks, reason


def _judge_sensors(
    prepared: Prepared, delay: Delay, lag: LoadLag, wrong: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return why the sensors' errors forbid an estimate, and how they were treated otherwise.

    ``wrong``: what contradicts a known value, which hides the lag.
    """
    taken, noise = prepared.taken, prepared.noise
    doubts: tuple[str, ...] = (delay.describe(),) if delay.counts else ()
    if taken == 0:
        doubts += (
            f"{noise.describe()}, also over up to {MOST_TOGETHER} samples; record twists that are "
            "not filtered, or at a higher rate if the motion changes within a few samples; or take "
            "the twists from the poses (--bandwidth 50)",
        )
    late = lag.describe() if lag.counts and not (wrong or delay.counts) else ""
    doubts = (*filter(None, [wrong, late]), *doubts)
    remarks: tuple[str, ...] = ()
    if taken > 1:
        remarks = (f"{noise.describe()}: {taken} intervals were taken as one",)
    return doubts, remarks


def _refuse_noise(choice: Choice) -> None:
    """Raise IndeterminateError if the coefficient does not differ significantly from zero."""
    relative = choice.fitted.deviation(COEFFICIENT)
    if relative > MAX_RELATIVE_DEVIATION:
        mu = choice.fitted.law.coefficient
        seen = f"mu = {mu:.2g} with a standard deviation of {mu * relative:.2g}"
        if choice.terms:
            raise IndeterminateError(
                f"the motion does not separate the coefficient from {', '.join(choice.terms)}: "
                f"{seen}; {SLOWER_FASTER}"
            )
        raise IndeterminateError(f"no friction shows beyond the noise: {seen}")


def _thinned(samples: SampleArrays, drive: Array | None) -> tuple[SampleArrays, Array | None]:
    """Return every second sample, and the mean of the drive over two intervals."""
    thinned = None
    if drive is not None:
        thinned = drive[::2].copy()
        thinned[1:] = 0.5 * (drive[2::2] + drive[1:-1:2])
    # Means of the loads: held over two periods, each would act half a period late.
    return with_mean_loads(samples).every_second(), thinned


def _coarse_change(scene: Scene, part: Part, fitted: KineticFit, taken: int, whole: bool) -> Array:
    """Return the change (free,) of the estimates, beyond noise, with other samples of the motion.

    ``whole``: they contain all of the motion, so that only what they lose of it is independent
    noise; else they are some of the samples. Zeros if they do not suffice.
    """
    try:
        measured = together(measure_intervals(scene, *part), taken)
        segments = find_segments(measured, fitted.law.radius)
        slips, _ = slip_windows(measured, segments, fitted.law.radius)
        data = Calibrated.of(slips, ContactLoads.of(slips), fitted.law.radius)
        again = fit_law(data, fitted.law, fitted.free)
    except (IdentifyError, np.linalg.LinAlgError):
        return np.zeros(len(fitted.free))
    moved = (again.law.vector - fitted.law.vector)[list(fitted.free)]
    own, other = np.diag(fitted.covariance), np.diag(again.covariance)
    noise = np.maximum(other - own, 0.0) if whole else other + own
    return np.asarray(np.sqrt(np.maximum(moved**2 - COARSE_DEVIATIONS**2 * noise, 0.0)))
