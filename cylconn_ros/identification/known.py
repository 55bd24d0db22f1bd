"""Whether a recording contradicts a parameter that was given as known."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.likelihood.law import NAMES, OVERLAP, RADIUS, FrictionLaw
from cylconn_ros.identification.likelihood.selection import DEMANDED, Choice, choose, criterion
from cylconn_ros.identification.slips import Prepared, free_parameters


def contradiction(
    prepared: Prepared, start: FrictionLaw, choice: Choice, known: Iterable[str]
) -> str:
    """Say which known parameter the recording contradicts; empty if none.

    Each is estimated in turn, with the terms chosen anew. It is contradicted if that lowers the
    criterion by more than DEMANDED.
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
        return (
            f"the recording contradicts the known {name} = {assumed:.4g}: it gives {found:.4g} "
            f"(criterion {-gain:+.1f}); leave {name} to be estimated"
        )
    return ""


def _value(law: FrictionLaw, k: int) -> float:
    if k == OVERLAP:
        return 2.0 / law.bending if law.bending > 0.0 else 0.0
    return law.radius if k == RADIUS else law.preload
