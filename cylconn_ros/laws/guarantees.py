"""The laws of a step by name, and those that each method guarantees, with reasons.

A law has the same meaning for every method. A reason states the form that a method gives to it.
"""

from __future__ import annotations

LAWS = (
    "constraint",
    "friction_limit",
    "slip_direction",
    "stick",
    "dissipation",
    "slip_averaging",
    "stops",
    "balance",
    "never_gains",
    "order",
)
"""Names of the laws, in the order in which they are printed; docs/laws.md states each."""

_BALANCE = "opposite wrenches; components add up; contact forces and each component by its formula"
_RETURN = "phi is the elastic slip's force, returned radially onto the friction disc"
_LIKE_PENALTY = "as penalty"

GUARANTEES: dict[str, dict[str, str]] = {
    "impulse": {
        "constraint": "w+_c = target_c is solved with friction",
        "friction_limit": "friction and reactions are of the same step",
        "slip_direction": "|s~| phi + r s~ = 0 is solved",
        "stick": "s+ = 0 exactly, with the position that stick holds",
        "dissipation": "follows from the slip direction",
        "slip_averaging": "theta = 1/2 only if the slip does not turn too far",
        "stops": "bounds on the rates are solved with friction",
        "balance": _BALANCE,
        "never_gains": "the wrench is integrated on its predicted motion before it is sent",
    },
    "minimal": {
        "friction_limit": "FN is solved with the accelerations at every instant",
        "slip_direction": "friction opposes the slip velocity of the same instant",
        "stick": "sticking coordinates are removed from the equations of motion",
        "dissipation": "follows from the slip direction",
    },
    "baumgarte": {
        "constraint": "J a + J' v = -2 alpha w_c - beta^2 e of the sample's own accelerations",
        "friction_limit": "the regularised limit is below mu FN",
        "slip_direction": "|s| phi + P s = 0 with the sample's slip",
        "dissipation": "follows from the slip direction, with the sample's slip",
        "balance": _BALANCE,
    },
    "penalty": {
        "constraint": "f_c = -k e - c w_c",
        "friction_limit": "FN of the same sample's f_c; P = limit on slip",
        "slip_direction": _RETURN,
        "stick": "stick is elastic: phi = -ks d - cs s",
        "stops": "a stop, lock or motion is a spring and a damper; a stop only pushes",
        "balance": _BALANCE,
    },
    "augmented_lagrangian": {
        "friction_limit": _LIKE_PENALTY,
        "slip_direction": _LIKE_PENALTY,
        "stick": _LIKE_PENALTY,
        "stops": _LIKE_PENALTY,
        "balance": _BALANCE,
    },
}
"""Reasons by method and law. What is not guaranteed, and why:

Penalty methods: their springs return stored energy, so dissipation holds for sums only
(passivity_balance). They do not compute the end of the step, so slip_averaging does not apply.
augmented_lagrangian: the multiplier is not published, so constraint cannot be checked.
baumgarte: it has no stick and no bounds, so stick and stops do not apply.
minimal: it computes whole motions and no wrench of a sample. Its laws hold at every instant of the
motion (laws/pointwise.py); momentum of two free bodies holds to the integrator's tolerance.
"""


def guaranteed_laws(method: str) -> list[str]:
    """Names of the laws that a method guarantees, in the order of LAWS."""
    return [law for law in LAWS if law in GUARANTEES[method]]


def title(law: str) -> str:
    """The name of a law as printed: words separated by spaces."""
    return law.replace("_", " ")
