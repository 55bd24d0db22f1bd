"""Whether a recording contradicts a parameter that was given as known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.likelihood.kinetic import fit_law
from cylconn_ros.identification.likelihood.law import NAMES, OVERLAP, RADIUS, FrictionLaw
from cylconn_ros.identification.likelihood.selection import (
    DEMANDED,
    Choice,
    choose,
    criterion,
)
from cylconn_ros.identification.slips import Prepared, free_parameters


def contradiction(
    prepared: Prepared,
    start: FrictionLaw,
    choice: Choice,
    known: Iterable[str],
    absent: Mapping[str, str],
) -> str:
    """Say which known parameter the recording contradicts; empty if none.

    Each is estimated in turn, with the terms chosen anew. It is contradicted if that lowers the
    criterion by more than DEMANDED. ``absent``: those that are zero since the friction does not
    have them, with the reason.
    """
    data, given = prepared.data, set(known)
    for name in sorted(given):
        free = free_parameters(dict.fromkeys(given - {name}, 0.0))
        try:
            other = choose(data, prepared.loads, start, free)
        except (IdentifyError, np.linalg.LinAlgError):
            continue
        k, fitted = NAMES.index(name), other.fitted
        gain = criterion(choice.fitted, len(data)) - criterion(fitted, len(data))
        if k not in fitted.free or gain <= DEMANDED:
            continue
        found, assumed = (_value(law, k) for law in (fitted.law, start))
        if name in absent:
            return (
                f"the recording contradicts that {name} is {absent[name]}: a constant one of "
                f"{found:.4g} beside it describes it better (criterion {-gain:+.1f}); correct "
                "friction.inputs or the commanded preload"
            )
        return (
            f"the recording contradicts the known {name} = {assumed:.4g}: it gives {found:.4g} "
            f"(criterion {-gain:+.1f}); leave {name} to be estimated"
        )
    return ""


def _value(law: FrictionLaw, k: int) -> float:
    if k == OVERLAP:
        return 2.0 / law.bending if law.bending > 0.0 else 0.0
    return law.radius if k == RADIUS else law.preload


def wrongly_held(prepared: Prepared, choice: Choice) -> str:
    """Say which value that was assumed, since its parameter is not excited, the recording refutes.

    It is refuted if its estimate lowers the criterion, however wide its interval. With a wrong
    preload, mu was 15 % too large beside Stribeck friction, in a narrow interval. A radius that is
    free where it has no effect changes the covariance alone, and a bending moment that is noise
    refutes nothing.
    """
    data, fitted = prepared.data, choice.fitted
    for name, reason in choice.held.items():
        k = NAMES.index(name)
        if k == RADIUS or "no bending" in reason:
            continue
        try:
            other = fit_law(data, fitted.law, sorted([*fitted.free, k]))
        except (IdentifyError, np.linalg.LinAlgError):
            continue
        gain = criterion(fitted, len(data)) - criterion(other, len(data))
        if gain > 0.0:
            return (
                f"the recording contradicts {name} = {_value(fitted.law, k):.4g}, assumed "
                f"(criterion {-gain:+.1f}), and does not determine it ({reason})"
            )
    return ""
