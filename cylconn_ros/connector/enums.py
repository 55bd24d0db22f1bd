"""What the whole numbers of ConnectorState are called, wherever people read them."""

from __future__ import annotations

REGIMES = ("frictionless", "stick", "slip")
STATUS = ("not finite", "bad quaternion", "no period")
"""Of the values but OK, 1 first."""

# Of the bits, lowest first.
STOPS = ("length min", "length max", "angle min", "angle max")
LOCKS = ("slide", "spin")
FLAGS = (
    "undersampled",
    "turn ambiguous",
    "twist contradicts the poses",
    "misaligned by half a turn",
    "limited",
    "several solutions",
    "jammed",
    "stopped",
    "pulling in",
    "gains lowered",
    "plant_integration does not fit",
)


def named(names: tuple[str, ...], bits: int) -> str:
    """The names of the bits that are set."""
    return ", ".join(name for k, name in enumerate(names) if bits >> k & 1)
