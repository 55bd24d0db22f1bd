"""Whether a recording was sampled too slowly for its motion."""

from __future__ import annotations

from cylconn_ros.identification.likelihood.kinetic import KineticFit
from cylconn_ros.identification.slips import Prepared

MATERIAL = 0.8  # mean squared residual over that of the noise: above it the motion is small in it
DEVIATIONS = 5.0  # standard deviations of the misfit below its expectation, 1


def sampled_slowly(prepared: Prepared, fitted: KineticFit) -> tuple[str, ...]:
    """Say that the motion changes within a few samples, if it does; empty if not.

    The noise is what a cubic over the shortest windows leaves. If the motion changes within them,
    its change counts as noise, which then exceeds the residuals of the law by far, and the errors
    of the forces in the windows are no part of the intervals (50 Hz, motion of 1 Hz: R 1.2 % off,
    interval 0.7 %). Noise that is too small to change the forces tells nothing.
    """
    if not prepared.noise.material or prepared.taken != 1:
        return ()
    # Of n windows with two components each: standard deviation (2/(2 n))^1/2.
    if fitted.misfit > min(MATERIAL, 1.0 - DEVIATIONS / len(prepared.data) ** 0.5):
        return ()
    rate = 1.0 / prepared.measured.step
    share = max(fitted.misfit, 1e-6) ** -0.5
    return (
        f"sampled too slowly for the motion: neighbouring samples differ by {share:.1f} times the "
        "residuals of the law (expected 1), since the motion changes within a few of them; record "
        f"at more than {2.0 * rate:.0f} Hz (seen: {rate:.0f} Hz), or move more slowly",
    )
