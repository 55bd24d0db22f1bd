"""Motions with a solution in closed form (derived from Coulomb's law on one disc)."""

import math


def coast(mu: float, gravity: float, preload: float, mass: float, v0: float) -> tuple[float, float]:
    """Stop time (s) and distance (m) of a sleeve whose mass centre is on the axis, at node b.

    The normal force is m g + FCint throughout, gravity g across the axis: a = mu (g + FCint/m).
    """
    a = mu * (gravity + preload / mass)
    return v0 / a, 0.5 * v0 * v0 / a


def constant_normal_force(c: float, v0: float, tau: float) -> tuple[float, float]:
    """Stop time (s) and distance (m) of slide and spin together, for k = m R^2/I = 2.

    With a constant normal force the slip velocity s = (v, R w) obeys R w / R w0 = (v/v0)^k, and for
    k = 2, c = R w0/v0, tau = m v0/(mu FN):

        T = tau/2 (sqrt(1 + c^2) + asinh(c)/c),     X = tau v0 ((1 + c^2)^1.5 - 1) / (3 c^2)
    """
    root = math.sqrt(1.0 + c * c)
    return 0.5 * tau * (root + math.asinh(c) / c), tau * v0 * (root**3 - 1.0) / (3.0 * c * c)
