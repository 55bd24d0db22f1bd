"""Excitation: which parameters of Coulomb friction a motion determines; the others are held."""

from __future__ import annotations

import dataclasses

import numpy as np

from cylconn_ros.identification.likelihood.contact_loads import (
    MIN_SIGNAL_TO_NOISE,
    Calibrated,
    ContactLoads,
)
from cylconn_ros.identification.likelihood.kinetic import (
    KineticFit,
    fit_law,
    parameter_scales,
    predicted_deviations,
)
from cylconn_ros.identification.likelihood.law import (
    COEFFICIENT,
    NAMES,
    OVERLAP,
    PRELOAD,
    RADIUS,
    FrictionLaw,
)

MAX_PREDICTED_DEVIATION = 0.25  # of a parameter's effect on the limit; above: not excited
BASE = (COEFFICIENT, PRELOAD, OVERLAP, RADIUS)
"""Parameters of Coulomb friction."""


def fit_excited(
    data: Calibrated, loads: ContactLoads, start: FrictionLaw, free: list[int]
) -> tuple[KineticFit, dict[str, str]]:
    """Fit the parameters of Coulomb friction that the motion excites.

    Returns
    -------
        The fit, and for every other parameter in ``free`` the reason why it is held.
    """
    notes: dict[str, str] = {}
    if OVERLAP in free and len(free) > 1 and loads.signal_to_noise[1] < MIN_SIGNAL_TO_NOISE:
        notes["overlap"] = "not excited: there is no bending moment beyond noise"
        free = [j for j in free if j != OVERLAP]
    # A first estimate of the coefficient, for the predicted deviations.
    traction = np.hypot(data.force[:, 0], data.force[:, 1] / start.radius)
    normal = np.abs(data.normal(start.bending, start.preload))
    guess = float(traction.mean() / max(normal.mean(), 1e-300))
    law = dataclasses.replace(start, coefficient=min(max(guess, 1e-3), 10.0))
    while True:
        while True:
            worst = predicted_deviations(data, law, free)
            if (worst <= MAX_PREDICTED_DEVIATION).all() or len(free) == 1:
                break
            k = _least_excited(data, law, free)
            notes[NAMES[k]] = _not_excited(k, data, loads, law)
            free = [j for j in free if j != k]
        fitted = fit_law(data, law, free)
        # Again at the fitted law, and with the spread of the windows themselves.
        size = np.sqrt(np.diag(fitted.covariance)) / parameter_scales(data, fitted.law)[free]
        predicted = predicted_deviations(data, fitted.law, free)
        if len(free) == 1 or (np.maximum(size, predicted) <= MAX_PREDICTED_DEVIATION).all():
            return fitted, notes
        k = _least_excited(data, fitted.law, free)
        notes[NAMES[k]] = _not_excited(k, data, loads, fitted.law)
        free = [j for j in free if j != k]


def _least_excited(data: Calibrated, law: FrictionLaw, free: list[int]) -> int:
    """Return the parameter to hold so that the others are determined best.

    Among nearly equal ones: bending before preload before radius.
    """
    order = [k for k in (OVERLAP, PRELOAD, RADIUS) if k in free]
    left = [
        float(predicted_deviations(data, law, [j for j in free if j != k]).max()) for k in order
    ]
    best = min(left)
    return next(k for k, worst in zip(order, left, strict=True) if worst <= 1.5 * best)


def _not_excited(k: int, data: Calibrated, loads: ContactLoads, law: FrictionLaw) -> str:
    """Return the reason why a motion does not determine a parameter."""
    if k == RADIUS:
        spin = np.abs(data.windows.rates[:, 1]) * law.radius
        share = spin / np.maximum(np.hypot(data.windows.rates[:, 0], spin), 1e-300)
        if share.max() < 0.1:
            return "not excited: it slides and hardly spins"
        if share.min() > 0.9:
            return "not excited: it spins and hardly slides, which determines only mu R"
        return "not excited: the ratio of slide to spin hardly changes"
    radial = f"{loads.radial.min():.3g} to {loads.radial.max():.3g} N"
    if k == OVERLAP:
        if 2.0 * loads.moment.max() < 1e-3 * loads.radial.mean() * law.radius:
            return "not excited: there is no bending moment"
        if not loads.radial.any():
            return "not determined: without a radial force in FN (friction.inputs) only mu/L shows"
        bending = f"{loads.moment.min():.3g} to {loads.moment.max():.3g} N.m"
        return (
            f"not excited: radial force ({radial}) and bending moment ({bending}) hardly "
            "change relative to each other"
        )
    return f"not excited: the normal force hardly changes (radial force {radial})"
