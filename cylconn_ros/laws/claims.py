"""Which laws each method claims, and why: what its construction makes exact, sample by sample.

The letters mean the same everywhere; where a method has a law in a form of its own, that is said.
"""

from __future__ import annotations

TITLES = {
    "C": "constraint",
    "D": "disc",
    "S": "slip",
    "K": "stick",
    "E": "dissipation",
    "T": "turning",
    "U": "stops",
    "A": "balance",
    "O": "order",
}

_BALANCE = "opposite wrenches; parts add up; contact forces and every part by their formulas"
_MAPPED = "phi is the elastic slip's force, brought back radially onto the disc"

CLAIMS: dict[str, dict[str, str]] = {
    "impulse": {
        "C": "w+_c = target_c is solved with friction",
        "D": "friction and reactions are of the same step",
        "S": "|s~| phi + r s~ = 0 is solved",
        "K": "s+ = 0 exactly, with the place that stick holds",
        "E": "follows from S",
        "T": "theta = 1/2 only where the slip does not turn too far",
        "U": "bounds on the rates are solved with friction",
        "A": _BALANCE,
    },
    "minimal": {
        "C": "the constraint's part is impulse's",
        "D": "at stops, locks and imposed motion, where the answer is impulse's",
        "S": "as D",
        "E": "as D",
        "T": "as D",
        "U": "as D",
        "A": "opposite wrenches and sums; a mean FN is none of the mean wrench",
    },
    "baumgarte": {
        "C": "J a + J' v = -2 alpha w_c - beta^2 e of the sample's own accelerations",
        "D": "the regularised limit is below mu FN",
        "S": "|s| phi + P s = 0 with the sample's slip",
        "E": "follows from S, with the sample's slip",
        "A": _BALANCE,
    },
    "penalty": {
        "C": "f_c = -k e - c w_c",
        "D": "FN of the same sample's f_c; P = limit on slip",
        "S": _MAPPED,
        "K": "stick is elastic: phi = -ks d - cs s",
        "U": "a stop, lock or motion is a spring and a damper; a stop pushes only",
        "A": _BALANCE,
    },
    "augmented_lagrangian": {
        "D": "as penalty",
        "S": "as penalty",
        "K": "as penalty",
        "U": "as penalty",
        "A": _BALANCE,
    },
}
"""What is not claimed: penalty methods give back what their springs took, so that E holds for sums
only (passivity_balance), and they do not know how a step will end (T). The multiplier of
augmented_lagrangian is not published (C). baumgarte has no stick (K) and no bounds (U). The mean of
a turning reaction is shorter than its mean length, so that D cannot hold for minimal's mean wrench;
it is asked of the motion itself, at every instant (laws/pointwise.py)."""


def claimed(method: str) -> str:
    """The letters that a method claims, in the order of TITLES."""
    return "".join(letter for letter in TITLES if letter in CLAIMS[method])
