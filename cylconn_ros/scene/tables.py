"""Parameter groups of nonlinear springs and dampers: force over position, and over rate.

SI units, radians. The force of a table opposes: a rising table is a spring or a damper.
"""

from __future__ import annotations

import dataclasses

from cylconn_ros.scene.schema import parameter

BEYOND = ("constant", "linear")
_FORCE = "Force F at each; -F acts on B along e1a."
_MOMENT = "Moment at each; its negative acts on B about e1a."
_BEYOND = "Beyond the first and the last point: constant, or linear as between the last two."


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpringTable:
    """Force over the elongation u1mat, piecewise linear.

    Example::

        table = cr.SpringTable(positions=(-0.01, 0.0, 0.02), forces=(-50.0, 0.0, 20.0))
    """

    positions: tuple[float, ...] = parameter(
        (), unit="m", doc="Elongations u1mat, ascending, 2 to 16; []: no table."
    )
    forces: tuple[float, ...] = parameter((), unit="N", doc=_FORCE)
    extrapolation: str = parameter("constant", choices=BEYOND, doc=_BEYOND)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RotationalSpringTable:
    """Moment over the rotation ur1mat, piecewise linear.

    Example::

        table = cr.RotationalSpringTable(angles=(-0.5, 0.5), moments=(-2.0, 2.0))
    """

    angles: tuple[float, ...] = parameter(
        (), unit="rad", doc="Rotations ur1mat, ascending, 2 to 16; []: no table."
    )
    moments: tuple[float, ...] = parameter((), unit="N.m", doc=_MOMENT)
    extrapolation: str = parameter("constant", choices=BEYOND, doc=_BEYOND)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DamperTable:
    """Force over the rate of slide, piecewise linear, zero at rest.

    Example::

        table = cr.DamperTable(rates=(-1.0, 0.0, 1.0), forces=(-900.0, 0.0, 300.0))
    """

    rates: tuple[float, ...] = parameter(
        (), unit="m/s", doc="Rates of slide, ascending, 2 to 16; []: no table."
    )
    forces: tuple[float, ...] = parameter(
        (), unit="N", doc=_FORCE + " It must oppose the rate, and be 0 at rate 0."
    )
    extrapolation: str = parameter("constant", choices=BEYOND, doc=_BEYOND)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RotationalDamperTable:
    """Moment over the rate of spin, piecewise linear, zero at rest.

    Example::

        table = cr.RotationalDamperTable(rates=(-2.0, 0.0, 2.0), moments=(-8.0, 0.0, 1.0))
    """

    rates: tuple[float, ...] = parameter(
        (), unit="rad/s", doc="Rates of spin, ascending, 2 to 16; []: no table."
    )
    moments: tuple[float, ...] = parameter(
        (), unit="N.m", doc=_MOMENT + " It must oppose the rate, and be 0 at rate 0."
    )
    extrapolation: str = parameter("constant", choices=BEYOND, doc=_BEYOND)
