"""Friction feed-forward: the effort that a controller adds so that friction does not act on it.

While the joint slips, friction is known: its opposite is returned. While it sticks, friction takes
any value up to its limit P = mu FN and follows what is applied, so that its opposite would be a
feedback of the controller's own effort. With a reference motion (v, w) the break-away effort in its
direction is returned instead,

    (f, m) = share P (v, R^2 w)/|(v, R w)|

and without a reference, or with one of rest, nothing.
"""

from __future__ import annotations

import math

from cylconn_ros.core.layout import SLIP


def feed_forward(
    regime: int,
    friction: tuple[float, float],
    limit: float,
    radius: float,
    reference: tuple[float, float] = (0.0, 0.0),
    share: float = 0.9,
) -> tuple[float, float]:
    """Return the effort along and about the slot to add on body B, N and N m.

    Parameters
    ----------
    regime, friction, limit
        Of ``ConnectorState``: ``regime``; ``force_friction`` (N) and ``moment_friction`` (N m) on
        B; ``friction_limit`` (N).
    radius
        R, m.
    reference
        Rates that the controller wants next, m/s and rad/s.
    share
        Of the friction limit that is given while the joint sticks; below 1 it does not move by it.

    Example::

        import cylconn_ros as cr

        # Slip: the opposite of friction. Stick: 90 % of the limit towards the rate that is wanted
        print(cr.feed_forward(2, (-3.0, 0.0), 3.0, 0.02))
        print(cr.feed_forward(1, (-1.0, 0.0), 3.0, 0.02, reference=(0.1, 0.0)))
    """
    if regime == SLIP:
        return -friction[0], -friction[1]
    slide, spin = reference[0], radius * reference[1]
    rate = math.hypot(slide, spin)
    if rate == 0.0 or not math.isfinite(rate + limit):
        return 0.0, 0.0
    return share * limit * slide / rate, share * limit * radius * spin / rate
