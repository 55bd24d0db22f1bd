"""Whether a recording shows the change of overlap that the parameters state.

The model with the change and the one with a constant overlap are fitted to the same windows, with
the same terms, and compared by the information criterion.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.forces.contact import CONSTANT
from cylconn_ros.identification.likelihood.contact_loads import Calibrated, ContactLoads
from cylconn_ros.identification.likelihood.kinetic import KineticFit, fit_law
from cylconn_ros.identification.likelihood.selection import DEMANDED, criterion
from cylconn_ros.identification.slips import Prepared, prepare


def overlap_gain(prepared: Prepared, fitted: KineticFit) -> float:
    """Return by how much the criterion is lower with the change of overlap than without.

    NaN if one of them cannot be fitted. ``prepared``: with the change.
    """
    steady = dataclasses.replace(prepared.measured, contact=CONSTANT)
    known = (1, prepared.noise)  # the intervals are taken together already
    try:
        other = prepare(steady, fitted.law.radius, known).data.windows
        ours = prepared.data.windows
        common = np.intersect1d(ours.time, other.time)
        costs = []
        for windows in (other, ours):
            chosen = windows.take(np.isin(windows.time, common))
            data = Calibrated.of(chosen, ContactLoads.of(chosen), fitted.law.radius)
            costs.append(criterion(fit_law(data, fitted.law, fitted.free), len(data)))
    except (IdentifyError, np.linalg.LinAlgError):
        return float("nan")
    return costs[0] - costs[1]


def judge_overlap(prepared: Prepared, fitted: KineticFit) -> tuple[str, str]:
    """Say whether the change of overlap shows: why the values are withheld, or else a remark.

    Both are empty if the overlap is constant.
    """
    if not prepared.measured.contact.changes:
        return "", ""
    gain = overlap_gain(prepared, fitted)
    given = prepared.measured.scene.friction
    stated = (
        f"friction.overlap_change = {given.overlap_change}, friction.contact_centre = "
        f"{given.contact_centre}"
    )
    if gain < -DEMANDED:
        return (
            f"a constant overlap describes the recording better than {stated} (criterion "
            f"{-gain:+.1f}); correct overlap_change, overlap_at or contact_centre", "",
        )  # fmt: skip
    if gain > DEMANDED:
        return "", f"the recording shows {stated} (criterion {-gain:+.1f} against a constant one)"
    return "", f"the recording does not show {stated}, nor contradict it (slide further)"
