"""Names of the enums and flag bits of ConnectorState."""

from __future__ import annotations

REGIMES = ("frictionless", "stick", "slip")
STATUS = ("not finite or too large", "bad quaternion", "no period", "unknown method")
"""Names of the status values from 1 on; 0 is OK."""

# Names of bits, lowest bit first.
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
    "not converged",
    "contradictory constraints",
    "drive blocked",
    "disengaged",
)


def names_of(names: tuple[str, ...], bits: int) -> tuple[str, ...]:
    """The names of the bits that are set."""
    return tuple(name for k, name in enumerate(names) if bits >> k & 1)


def named(names: tuple[str, ...], bits: int) -> str:
    """The names of the bits that are set, separated by commas."""
    return ", ".join(names_of(names, bits))
