"""Choice of the friction model by the data: excitation, terms by an information criterion.

The search starts at Coulomb friction with those of preload, overlap and radius that the motion
excites. A term enters if it lowers ``-2 ln L + k ln n`` by more than MIN_GAIN, the one that lowers
it most first; afterwards every term that does not pay any more leaves. While several terms are
missing, their misfit makes the intervals of each single one so wide that none enters. If the
residuals exceed the noise in the end, the search begins anew with all terms, and the one whose loss
costs least leaves first.
"""

from __future__ import annotations

import contextlib
import dataclasses
from typing import NamedTuple

import numpy as np

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.likelihood.contact_loads import Calibrated, ContactLoads
from cylconn_ros.identification.likelihood.excitation import (
    BASE,
    MAX_PREDICTED_DEVIATION,
    fit_excited,
)
from cylconn_ros.identification.likelihood.kinetic import (
    MAX_ITERATIONS,
    KineticFit,
    cost,
    finished,
    fit_law,
    parameter_scales,
    predicted_deviations,
    searched,
    unexplained,
)
from cylconn_ros.identification.likelihood.law import (
    DECAY,
    DIRECTION,
    NAMES,
    OFFSET,
    STRIBECK,
    VISCOUS,
    VISCOUS_SPIN,
    FrictionLaw,
    slip,
)

MIN_GAIN = 2.0  # of the criterion
DEMANDED = 10.0  # gain of a term that no model can lack
MIN_DEVIATIONS = 2.5  # standard deviations of a term that enters
ENOUGH = 1.5  # misfit up to which terms are added one by one only
SAME = 3.0  # difference of the criterion below which two models describe the data equally well
MIN_UNEXPLAINED = 0.02  # of the effect of a term: what the terms in the model cannot imitate
ROUGH = 10  # iterations of the fits that search for the decay
DECAYS = 6  # start values of the decay
TERMS: dict[str, tuple[int, ...]] = {
    "viscous friction of the slide": (VISCOUS,),
    "viscous friction of the spin": (VISCOUS_SPIN,),
    "offset force": (OFFSET,),
    "difference by direction": (DIRECTION,),
    "Stribeck decay": (STRIBECK, DECAY),
}
"""Terms beyond Coulomb friction and the indices of their parameters."""


class Choice(NamedTuple):
    """The chosen model."""

    fitted: KineticFit
    terms: tuple[str, ...]  # of TERMS, that are in
    left_out: dict[str, str]  # the others, with the reason
    alternatives: dict[str, str]  # terms that are in, with the one that would do as well
    held: dict[str, str]  # preload, overlap or radius, with the reason why they are not estimated
    steps: tuple[tuple[tuple[str, ...], KineticFit], ...]  # terms and fit, from Coulomb to the last
    undetermined: str  # the term that the data demand most and do not determine, in words


def choose(data: Calibrated, loads: ContactLoads, start: FrictionLaw, free: list[int]) -> Choice:
    """Choose and fit the model; ``free`` are the parameters of :data:`NAMES` to be estimated.

    Raises IdentifyError if the traction does not oppose the slip.
    """
    fitted, held = fit_excited(data, loads, start, free)
    terms: list[str] = []
    reasons: dict[str, str] = {}
    gains: dict[str, float] = {}
    steps: list[tuple[tuple[str, ...], KineticFit]] = [((), fitted)]
    while True:
        best: tuple[float, str, KineticFit] | None = None
        for name in TERMS:
            if name in terms:
                continue
            tried, reasons[name], gains[name] = _with_term(data, fitted, name)
            gain = gains[name]
            if tried is not None and gain > MIN_GAIN and (best is None or gain > best[0]):
                best = (gain, name, tried)
        if best is None:
            break
        _, name, fitted = best
        terms.append(name)
        steps.append((tuple(terms), fitted))
    fitted, terms = _pruned(data, fitted, terms, terms[:-1], reasons)
    if fitted.misfit > ENOUGH:
        fitted, terms = _from_all_terms(data, fitted, terms, reasons)
    freed = _freed(data, fitted, held)
    if freed is not fitted:
        fitted, terms = _pruned(data, freed, terms, terms, reasons)
    if fitted is not steps[-1][1]:
        steps.append((tuple(terms), fitted))
        gains = {n: _with_term(data, fitted, n)[2] for n in TERMS if n not in terms}
    alternatives = _alternatives(data, fitted, terms)
    left = {name: reasons[name] for name in TERMS if name not in terms}
    most = max(left, key=lambda name: gains.get(name, 0.0), default="")
    undetermined = ""
    if most and (gain := gains.get(most, 0.0)) > DEMANDED:
        undetermined = (
            f"the recording demands {most} (criterion {-gain:+.1f}), not determined by it"
        )
    return Choice(fitted, tuple(terms), left, alternatives, held, tuple(steps), undetermined)


def criterion(fitted: KineticFit, n: int) -> float:
    """Return -2 ln L + k ln n."""
    return 2.0 * fitted.cost + len(fitted.free) * float(np.log(n))


def _excitation(data: Calibrated, law: FrictionLaw, name: str) -> str:
    """Return why a motion cannot show a term, whatever the model; empty if it can."""
    size, cos, _ = slip(data.windows.rates, law.radius)
    rates = np.abs(data.windows.rates)
    if name == "viscous friction of the spin" and rates[:, 1].max() * law.radius < 0.1 * size.max():
        return "not excited: it hardly spins"
    if name == "viscous friction of the slide" and rates[:, 0].max() < 0.1 * size.max():
        return "not excited: it hardly slides"
    both = (cos > 0.3).sum() >= 3 and (cos < -0.3).sum() >= 3
    if name in ("offset force", "difference by direction") and not both:
        return "not excited: it slides in one direction only"
    if name == "Stribeck decay" and size.max() < 3.0 * size.min():
        return "not excited: the slip rate hardly changes"
    return ""


def _starts(data: Calibrated, law: FrictionLaw, names: list[str]) -> list[FrictionLaw]:
    """Return the laws from which a fit with the terms ``names`` begins."""
    if "Stribeck decay" not in names:
        return [law]
    size = slip(data.windows.rates, law.radius)[0]
    decays = np.geomspace(1.0 / size.max(), 3.0 / size.min(), DECAYS)
    return [dataclasses.replace(law, stribeck=0.3, decay=float(d)) for d in decays]


def _best_fit(data: Calibrated, starts: list[FrictionLaw], free: list[int]) -> KineticFit | None:
    """Return the most likely fit of several starts; rough if there are several."""
    iterations = ROUGH if len(starts) > 1 else MAX_ITERATIONS
    laws = []
    for start in starts:
        with contextlib.suppress(np.linalg.LinAlgError):
            laws.append(searched(data, start, free, iterations))
    if len(laws) > 1:
        laws.sort(key=lambda law: _cost(data, law))
    for law in laws:
        with contextlib.suppress(IdentifyError, np.linalg.LinAlgError):
            return finished(data, law, free)
    return None


def _cost(data: Calibrated, law: FrictionLaw) -> float:
    """Return -ln L, infinite if it is no number."""
    found = cost(data, law)
    return found if np.isfinite(found) else float("inf")


def _not_needed(fitted: KineticFit, name: str, cost: float) -> str:
    """Say what a term is that is left out, and what it costs in the criterion to leave it out."""
    k = TERMS[name][0]
    value, half = fitted.law.vector[k], 1.96 * fitted.deviation(k)
    return f"not needed: {NAMES[k]} = {value:.3g} ± {half:.2g} (criterion {-cost:+.1f})"


def _wide(data: Calibrated, fitted: KineticFit) -> bool:
    """Return whether a parameter is known worse than a half of its effect."""
    allowed = 2.0 * MAX_PREDICTED_DEVIATION * parameter_scales(data, fitted.law)[list(fitted.free)]
    return not bool((np.sqrt(np.diag(fitted.covariance)) <= allowed).all())


def _with_term(
    data: Calibrated, fitted: KineticFit, name: str
) -> tuple[KineticFit | None, str, float]:
    """Fit with one more term; None and the reason if the motion does not determine it.

    Also what the criterion gains by it; 0 if it was not fitted.
    """
    law, free = fitted.law, list(fitted.free)
    at = TERMS[name]
    if reason := _excitation(data, law, name):
        return None, reason, 0.0
    if name != "Stribeck decay":
        if unexplained(data, law, free, at[0]) < MIN_UNEXPLAINED:
            reason = "not excited: the terms in the model have the same effect in this motion"
            return None, reason, 0.0
        worst = predicted_deviations(data, law, [*free, at[0]])
        if (worst > 2.0 * MAX_PREDICTED_DEVIATION).any():
            return None, "not excited: the motion does not separate it from the others", 0.0
    best = _best_fit(data, _starts(data, law, [name]), sorted([*free, *at]))
    if best is None:
        return None, "no fit", 0.0
    gain = criterion(fitted, len(data)) - criterion(best, len(data))
    if name == "Stribeck decay" and gain > -SAME:
        best = fit_law(data, best.law, best.free)
        gain = criterion(fitted, len(data)) - criterion(best, len(data))
    main = best.law.vector[at[0]]
    text = _not_needed(best, name, gain)
    if abs(main) < MIN_DEVIATIONS * best.deviation(at[0]):
        return None, text, gain
    if _wide(data, best) or (name == "Stribeck decay" and not -0.95 < main < 10.0):
        return None, "not excited: the motion does not separate it from the others", gain
    return best, text, gain


def _pruned(
    data: Calibrated,
    fitted: KineticFit,
    terms: list[str],
    tested: list[str],
    reasons: dict[str, str],
) -> tuple[KineticFit, list[str]]:
    """Leave out those of the ``tested`` terms that do not pay any more."""
    for name in list(tested):
        again = _without(data, fitted, name)
        if again is not None and criterion(again, len(data)) < criterion(fitted, len(data)):
            reasons[name] = "not needed: the terms that entered later explain it"
            fitted = again
            terms = [one for one in terms if one != name]
    return fitted, terms


def _from_all_terms(
    data: Calibrated, fitted: KineticFit, terms: list[str], reasons: dict[str, str]
) -> tuple[KineticFit, list[str]]:
    """Return the model that is left of all terms, if it describes the data better."""
    base = [k for k in fitted.free if k in BASE]
    names = [name for name in TERMS if not _excitation(data, fitted.law, name)]
    free = sorted([*base, *(k for name in names for k in TERMS[name])])
    best = _best_fit(data, _starts(data, fitted.law, names), free)
    if best is not None:
        best = fit_law(data, best.law, best.free)
    why: dict[str, str] = {}
    while best is not None and names:
        without = {name: _without(data, best, name) for name in names}
        costs = {
            name: criterion(one, len(data)) - criterion(best, len(data))
            for name, one in without.items()
            if one is not None
        }
        worst = min(costs, key=lambda name: costs[name], default="")
        if not worst or costs[worst] > MIN_GAIN:
            break
        why[worst] = _not_needed(best, worst, costs[worst])
        names.remove(worst)
        best = without[worst]
    better = best is not None and (
        criterion(best, len(data)) < criterion(fitted, len(data)) - MIN_GAIN
    )
    if best is None or not better or _wide(data, best):
        return fitted, terms
    reasons.update(why)
    return best, names


def _freed(data: Calibrated, fitted: KineticFit, held: dict[str, str]) -> KineticFit:
    """Estimate held parameters that only the missing terms had hidden; remove them from held."""
    for name in list(held):
        k = NAMES.index(name)
        free = sorted([*fitted.free, k])
        if "no bending" in held[name] or "hardly spins" in held[name]:
            continue
        if (predicted_deviations(data, fitted.law, free) > MAX_PREDICTED_DEVIATION).any():
            continue
        try:
            tried = fit_law(data, fitted.law, free)
        except (IdentifyError, np.linalg.LinAlgError):
            continue
        scale = parameter_scales(data, tried.law)[free]
        if (np.sqrt(np.diag(tried.covariance)) <= MAX_PREDICTED_DEVIATION * scale).all():
            fitted = tried
            del held[name]
    return fitted


def _without(data: Calibrated, fitted: KineticFit, name: str) -> KineticFit | None:
    vector = {NAMES[k]: 0.0 for k in TERMS[name] if k != DECAY}
    try:
        law = dataclasses.replace(fitted.law, **vector)
        return fit_law(data, law, [k for k in fitted.free if k not in TERMS[name]])
    except (IdentifyError, np.linalg.LinAlgError):
        return None


def _alternatives(data: Calibrated, fitted: KineticFit, terms: list[str]) -> dict[str, str]:
    """Return the terms that another one could replace, with that one."""
    found: dict[str, str] = {}
    for name in terms:
        less = _without(data, fitted, name)
        if less is None:
            continue
        for other in TERMS:
            if other in terms or other == "Stribeck decay":
                continue
            if _same_effect(data, fitted, less, other):
                found[name] = other
                continue
            tried, _, _ = _with_term(data, less, other)
            if tried is None:
                continue
            if criterion(tried, len(data)) - criterion(fitted, len(data)) < SAME:
                found[name] = other
    return found


def _same_effect(data: Calibrated, fitted: KineticFit, less: KineticFit, other: str) -> bool:
    """Return whether a term has the effect of the one that ``less`` lacks, and no other one.

    Then only the spread of the residuals prefers one of them, which is not enough.
    """
    k = TERMS[other][0]
    own = unexplained(data, less.law, less.free, k)
    return own > MIN_UNEXPLAINED > unexplained(data, fitted.law, fitted.free, k)
