"""Overlap of shaft and sleeve that changes with the slide, and the moving middle of their contact.

    D    = l - l_L                       l_L: the slide at which L = L0
    L(l) = L0 + sigma D                  sigma: 0, 1 (increasing) or -1 (decreasing); at least
                                         L_min, below which the joint has come apart, at most L_max
    d    = kappa D                       distance of the contact's middle before node b, along the
                                         slot; kappa: 0 if the bearing belongs to B, 1 if to A, 1/2
                                         if the overlap changes at one end, and only while it does:
                                         beyond L_max the whole bearing of B is inserted, and the
                                         middle stays with it, as it does where L is held at L_min

Both enter the normal force alone (core/friction.py). A step takes them in its middle, as far as the
velocity at its sample tells; a semi-implicit plant at its sample, as it takes the wrench. Without a
change nothing is computed.
"""

from typing import Final, NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array, Law, set_contact, with_contact
from cylconn_ros.core.jit import inline_function

SLOPES: Final = {"constant": 0.0, "increasing": 1.0, "decreasing": -1.0}
"""sigma of every value of friction.overlap_change."""

# Numbers from model.OVERLAP on.
SIGMA: Final = 0
KAPPA: Final = 1
AT: Final = 2  # l_L, m; NaN: the reference configuration
LENGTH: Final = 3  # L0, m
LEAST: Final = 4  # L_min, m
MOST: Final = 5  # L_max, m


class ContactRange(NamedTuple):
    """Overlap (m), distance of the contact's middle before node b (m), and whether L > L_min."""

    overlap: float
    centre: float
    engaged: bool


@inline_function
def changes(par: Array) -> bool:
    """Whether overlap or middle of the contact change with the slide."""
    return par[model.OVERLAP + SIGMA] != 0.0 or par[model.OVERLAP + KAPPA] != 0.0


@inline_function
def contact_range(par: Array, start: float, length: float) -> ContactRange:
    """Overlap and middle at the slide ``length``; ``start``: the reference configuration, m."""
    at = model.OVERLAP
    moved = length - model.value_or(par[at + AT], start)
    overlap = par[at + LENGTH] + par[at + SIGMA] * moved
    engaged = overlap >= par[at + LEAST]
    held = min(max(overlap, par[at + LEAST]), par[at + MOST])
    if held != overlap and par[at + KAPPA] == 0.5:
        moved += par[at + SIGMA] * (held - overlap)
    overlap = held
    return ContactRange(overlap, par[at + KAPPA] * moved, engaged)


@inline_function
def set_contact_range(par: Array, start: float, length: float, out: Array) -> bool:
    """Let the friction law of ``par`` hold at the slide ``length``; whether L > L_min.

    Overlap and middle, as a distance from node b along the slot, are written to ``out``.
    """
    if not changes(par):
        out[layout.OVERLAP], out[layout.CONTACT_CENTRE] = par[model.OVERLAP + LENGTH], 0.0
        return True
    found = contact_range(par, start, length)
    set_contact(par, model.FRICTION, found.overlap, found.centre)
    out[layout.OVERLAP], out[layout.CONTACT_CENTRE] = found.overlap, -found.centre
    return found.engaged


@inline_function
def law_at(par: Array, start: float, length: float) -> Law:
    """The friction law at the slide ``length``; ``start``: the reference configuration, m."""
    law = model.law(par)
    if not changes(par):
        return law
    found = contact_range(par, start, length)
    return with_contact(law, found.overlap, found.centre)
