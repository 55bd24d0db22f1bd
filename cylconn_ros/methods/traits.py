"""Traits of the methods: what each one needs and what it models. The one table of method names.

This module imports nothing of the package, so that every layer above ``core`` can read the table.
"""

from typing import Final, NamedTuple


class MethodTraits(NamedTuple):
    """What the rest of the package has to know about a method.

    Attributes
    ----------
        number: the argument ``method`` of the compiled step (methods/dispatch.py).
        summary: how the method works, for the model description (connector/description.py).
        live: computes wrenches sample by sample, so that a Connector can use it. A method that is
            not live simulates whole motions (simulation/minimal.py).
        sends_wrench: the wrench acts on the bodies; False for a method that only measures.
        needs_inertia: mass and inertia of both bodies must be known.
        uses_gains: reads the parameters ``penalty.*``.
        has_limits: models stops, locks and imposed motion.
        limits_drives: an imposed motion can have a greatest force.
        exact_stick: stick has no creep and no elastic slip: s = 0 at the end of the step.
        second_order: converges with second order, so that ``cylconn simulate`` checks its runs
            against the reference solutions of the bundled scenes.
        samples_elements: springs, dampers and compliant stops act with the force of the sample,
            which bounds their stiffness and damping (scene/elements.py).
        couples: connectors with this method can share bodies (methods/coupled/step.py).
    """

    number: int
    summary: str
    live: bool = True
    sends_wrench: bool = True
    needs_inertia: bool = False
    uses_gains: bool = False
    has_limits: bool = True
    limits_drives: bool = True
    exact_stick: bool = False
    second_order: bool = False
    samples_elements: bool = False
    couples: bool = False


TRAITS: Final[dict[str, MethodTraits]] = {
    "impulse": MethodTraits(
        number=0,
        summary="friction and reactions of a step solved together",
        needs_inertia=True,
        exact_stick=True,
        second_order=True,
        couples=True,
    ),
    "minimal": MethodTraits(
        number=4,
        summary="equations of motion in joint coordinates, integrated to a tolerance",
        live=False,
        limits_drives=False,
        needs_inertia=True,
        exact_stick=True,
        second_order=True,
    ),
    "baumgarte": MethodTraits(
        number=3,
        summary="accelerations with feedback, regularised friction: a loaded sleeve creeps",
        needs_inertia=True,
        has_limits=False,
        limits_drives=False,
        samples_elements=True,
    ),
    "augmented_lagrangian": MethodTraits(
        number=2,
        summary="springs, dampers and a multiplier: stick is elastic",
        uses_gains=True,
        samples_elements=True,
    ),
    "penalty": MethodTraits(
        number=1,
        summary="springs and dampers: deflects by load/stiffness, stick is elastic",
        uses_gains=True,
        samples_elements=True,
    ),
    "observe": MethodTraits(
        number=5,
        summary="no wrench is sent; forces and friction of the measured motion",
        sends_wrench=False,
        limits_drives=False,
    ),
}
"""Traits by the value of the parameter ``method``; ``auto`` stands for one of them."""

AUTO: Final = TRAITS["impulse"]._replace(needs_inertia=False)
"""Traits of ``auto``, which is impulse, or penalty for a body of unknown inertia."""

LIVE: Final = tuple(name for name, traits in TRAITS.items() if traits.live)
"""Methods that a Connector can use."""
SOLVERS: Final = tuple(name for name in LIVE if TRAITS[name].sends_wrench)
"""Methods whose wrenches keep the bodies on the constraint."""
