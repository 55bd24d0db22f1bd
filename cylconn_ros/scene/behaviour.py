"""Parameter groups of the connector's behaviour: friction, stops, lock, springs, imposed motion.

SI units, radians, quaternions x, y, z, w. Rules between parameters: validation.py.
"""

# ruff: noqa: RUF009 - parameter() and group() make the fields themselves

from __future__ import annotations

import dataclasses
import math

from cylconn_ros.scene.schema import group, parameter
from cylconn_ros.scene.tables import (
    DamperTable,
    RotationalDamperTable,
    RotationalSpringTable,
    SpringTable,
)

NAN = math.nan
INF = math.inf
INPUTS = ("radial", "bending", "preload")


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionTable:
    """Friction coefficient over slip rate and contact force; constant beyond the last entries.

    Example::

        table = cr.FrictionTable(rates=(0.0, 0.1), forces=(10.0,), values=(0.3, 0.2))
    """

    rates: tuple[float, ...] = parameter((), ge=0.0, unit="m/s", doc="Slip rates, ascending.")
    forces: tuple[float, ...] = parameter((), ge=0.0, unit="N", doc="Contact forces, ascending.")
    values: tuple[float, ...] = parameter(
        (), ge=0.0, unit="1", doc="Coefficients row by row: one row a rate, one column a force."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Friction:
    """Coulomb friction on slide and spin together.

    Example::

        friction = cr.Friction(coefficient=0.2, radius=0.02, overlap=0.1, preload=5.0)
    """

    coefficient: float = parameter(
        0.0, ge=0.0, unit="1", doc="Friction coefficient (kinetic); 0: no friction."
    )
    radius: float = parameter(
        NAN, gt=0.0, unit="m", doc="Effective radius R of the shaft; required with friction."
    )
    overlap: float = parameter(
        0.0,
        ge=0.0,
        unit="m",
        doc="Overlap length L of shaft and sleeve; 0: bending adds no normal force.",
    )
    overlap_change: str = parameter(
        "constant",
        choices=("constant", "increasing", "decreasing"),
        doc="How the overlap changes with the slide, one to one: telescopes, drawers, piston rods.",
    )
    overlap_at: float = parameter(
        NAN,
        unit="m",
        doc="Slide at which overlap holds; .nan: the reference configuration.",
    )
    overlap_min: float = parameter(
        1e-3, gt=0.0, unit="m", doc="Below it the joint has come apart: held there, DISENGAGED."
    )
    overlap_max: float = parameter(
        INF, gt=0.0, unit="m", doc="Fully inserted: the overlap does not increase beyond it."
    )
    contact_centre: str = parameter(
        "auto",
        choices=("auto", "body_b", "body_a", "between"),
        doc="What carries the middle of the contact: the bearing of body_b or body_a; between: it "
        "moves with half the slide, as long as the overlap changes if it does. auto: body_b if "
        "the overlap is constant, else between.",
    )
    preload: float = parameter(
        0.0, unit="N", doc="Self-equilibrated contact force FCint (press fit), of either sign."
    )
    static_coefficient: float = parameter(
        NAN, ge=0.0, unit="1", doc="Static coefficient; .nan: equal to the kinetic coefficient."
    )
    decay: float = parameter(
        0.0, ge=0.0, unit="s/m", doc="Stribeck decay dc of mu = mu_k + (mu_s - mu_k) exp(-dc |s|)."
    )
    max_force: float = parameter(INF, ge=0.0, unit="N", doc="Cap on the friction traction P.")
    coefficient_forward: float = parameter(
        NAN,
        ge=0.0,
        unit="1",
        doc="Coefficient of a positive slide; .nan: coefficient. In other directions of slip: "
        "between forward and backward by the cosine of the direction.",
    )
    coefficient_backward: float = parameter(
        NAN, ge=0.0, unit="1", doc="Coefficient of a negative slide; .nan: coefficient."
    )
    offset_force: float = parameter(
        0.0,
        unit="N",
        doc="Constant force (seals, cables) that resists a positive slide; part of the actuation.",
    )
    inputs: tuple[str, ...] = parameter(
        INPUTS,
        choices=INPUTS,
        doc="What presses shaft and sleeve together in FN. [preload]: friction ignores the load; "
        "[]: not set, all of them (without friction: coefficient 0).",
    )
    rest_rate: float = parameter(
        1e-3, ge=0.0, unit="m/s", doc="Method observe: a slip rate below this counts as stick."
    )
    table: FrictionTable | None = group(FrictionTable, absent=True)

    @property
    def on(self) -> bool:
        """Whether the scene has friction."""
        static = self.static_coefficient > 0.0  # False for NaN
        return self.mean_coefficient > 0.0 or static or self.table is not None

    @property
    def by_direction(self) -> tuple[float, float]:
        """Coefficients of a positive and of a negative slide, without a table."""
        given = self.coefficient_forward, self.coefficient_backward
        forward, backward = (self.coefficient if math.isnan(mu) else mu for mu in given)
        return forward, backward

    @property
    def mean_coefficient(self) -> float:
        """Kinetic coefficient, the mean of both directions of slide; 0 with a table."""
        forward, backward = self.by_direction
        return forward if forward == backward else 0.5 * (forward + backward)

    @property
    def direction(self) -> float:
        """Half of the difference of the coefficients of both directions, over their mean."""
        forward, backward = self.by_direction
        return 0.0 if forward == backward else (forward - backward) / (forward + backward)

    def presses(self, kind: str) -> bool:
        """Whether ``radial``, ``bending`` or ``preload`` is in the normal force."""
        return kind in self.inputs


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stops:
    """Bounds of the position in the slot and of the angle; each one optional.

    Example::

        stops = cr.Stops(l_min=0.0, l_max=0.3, restitution=0.5)
    """

    l_min: float = parameter(NAN, unit="m", doc="Least position in the slot; .nan: none.")
    l_max: float = parameter(NAN, unit="m", doc="Greatest position in the slot; .nan: none.")
    theta_min: float = parameter(NAN, unit="rad", doc="Least angle; .nan: none.")
    theta_max: float = parameter(NAN, unit="rad", doc="Greatest angle; .nan: none.")
    restitution: float = parameter(
        0.0, ge=0.0, le=1.0, unit="1", doc="Coefficient of restitution at rigid stops."
    )
    stiffness: float = parameter(
        NAN, gt=0.0, unit="N/m", doc="Stiffness of compliant stops of the slide; .nan: rigid."
    )
    damping: float = parameter(
        NAN, ge=0.0, unit="N.s/m", doc="Damping of compliant stops of the slide; .nan: none."
    )
    damping_depth: float = parameter(
        1e-3, gt=0.0, unit="m", doc="Depth over which the damping rises from zero to its value."
    )
    rotational_stiffness: float = parameter(
        NAN, gt=0.0, unit="N.m/rad", doc="Stiffness of compliant stops of the spin; .nan: rigid."
    )
    rotational_damping: float = parameter(
        NAN, ge=0.0, unit="N.m.s/rad", doc="Damping of compliant stops of the spin; .nan: none."
    )
    rotational_damping_depth: float = parameter(
        1e-2, gt=0.0, unit="rad", doc="Angle over which the damping rises from zero to its value."
    )

    @property
    def compliant(self) -> tuple[bool, bool]:
        """Whether the stops of slide, and those of spin, are compliant."""
        return not math.isnan(self.stiffness), not math.isnan(self.rotational_stiffness)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lock:
    """Lock of one available component once a criterion is met.

    Example::

        lock = cr.Lock(component="slide", position=0.25)
    """

    component: str = parameter(
        "none", choices=("none", "slide", "spin"), doc="The component that locks."
    )
    position: float = parameter(
        NAN, unit="m or rad", doc="The component locks when it passes this position or angle."
    )
    force: float = parameter(
        NAN,
        gt=0.0,
        unit="N or N.m",
        doc="The component locks when its force or moment exceeds this.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Elasticity:
    """Springs on the available components, about the constitutive reference; tables add to k.

    Example::

        elasticity = cr.Elasticity(k1=500.0)
    """

    k1: float = parameter(0.0, ge=0.0, unit="N/m", doc="Axial stiffness.")
    kr1: float = parameter(
        0.0, ge=0.0, unit="N.m/rad", doc="Rotational stiffness about the slot axis."
    )
    table: SpringTable = group(SpringTable)
    rotational_table: RotationalSpringTable = group(RotationalSpringTable)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Damping:
    """Dampers on the available components; tables add to c.

    Example::

        damping = cr.Damping(c1=2.0)
    """

    c1: float = parameter(0.0, ge=0.0, unit="N.s/m", doc="Axial damping.")
    cr1: float = parameter(
        0.0, ge=0.0, unit="N.m.s/rad", doc="Rotational damping about the slot axis."
    )
    table: DamperTable = group(DamperTable)
    rotational_table: RotationalDamperTable = group(RotationalDamperTable)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Penalty:
    """Gains of penalty and augmented_lagrangian: stable up to about m/h^2 and m/h.

    Example::

        gains = cr.Penalty(stiffness=1e5, damping=100.0)
    """

    stiffness: float = parameter(
        NAN, gt=0.0, unit="N/m", example=1e4, doc="Stiffness of the offsets; required by penalty."
    )
    damping: float = parameter(
        NAN, ge=0.0, unit="N.s/m", example=20.0, doc="Damping of the offsets; required by penalty."
    )
    rotational_stiffness: float = parameter(
        NAN,
        gt=0.0,
        unit="N.m/rad",
        doc="Stiffness of the misalignment; .nan: stiffness r^2, r the greater of overlap/2 and "
        "radius.",
    )
    rotational_damping: float = parameter(
        NAN, ge=0.0, unit="N.m.s/rad", doc="Damping of the misalignment; .nan: damping r^2."
    )
    stick_stiffness: float = parameter(
        NAN,
        gt=0.0,
        unit="N/m",
        doc="Stick stiffness; .nan: mu |preload| / elastic_slip if both are given, else stiffness.",
    )
    elastic_slip: float = parameter(
        NAN,
        gt=0.0,
        unit="m",
        doc="Elastic slip allowed at the friction limit of the preload; .nan: not stated.",
    )
    multiplier_gain: float = parameter(
        NAN,
        gt=0.0,
        lt=1.0,
        unit="1",
        doc="augmented_lagrangian: fraction of the spring's force that the multiplier takes over "
        "in each sample; .nan: stiffness h/(32 damping), at most 0.1.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Baumgarte:
    """Feedback gains and regularisation of the method baumgarte.

    Example::

        feedback = cr.Baumgarte(regularisation_velocity=1e-4)
    """

    alpha: float = parameter(
        NAN, gt=0.0, unit="1/s", doc="Half the gain on the constraint's rate; .nan: 0.2/h."
    )
    beta: float = parameter(
        NAN,
        gt=0.0,
        unit="1/s",
        doc="Square root of the gain on the constraint's error; .nan: 0.2/h. A held force is "
        "stable for beta^2 h/4 < alpha < 1/h.",
    )
    regularisation_velocity: float = parameter(
        0.001,
        gt=0.0,
        unit="m/s",
        doc="v0 in mu FN s/sqrt(s^2 + v0^2): below it friction is viscous and a load creeps.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Imposed:
    """Motion or force imposed on one available component; also by the topic ``~/command``.

    Example::

        imposed = cr.Imposed(velocity=0.1)
    """

    position: float = parameter(
        NAN, unit="m or rad", doc="Position in the slot or angle to be held or reached; .nan: none."
    )
    velocity: float = parameter(
        NAN, unit="m/s or rad/s", doc="Velocity to follow; with a position, its rate; .nan: none."
    )
    force: float = parameter(
        NAN, unit="N or N.m", doc="Force or moment on B along e1a; not with a motion; .nan: none."
    )
    max_force: float = parameter(
        INF,
        gt=0.0,
        unit="N or N.m",
        doc="Greatest force or moment of an imposed motion, which gives way beyond it.",
    )
    approach_speed: float = parameter(
        0.1,
        gt=0.0,
        unit="m/s or rad/s",
        doc="Greatest speed at which an imposed position is approached, besides its velocity.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Command:
    """Motion or force imposed on slide and spin.

    Example::

        command = cr.Command(slide=cr.Imposed(position=0.2, velocity=0.1))
    """

    slide: Imposed = group(
        Imposed,
        change={
            "position": {"unit": "m", "doc": "Position in the slot to hold or reach; .nan: none."},
            "velocity": {"unit": "m/s"},
            "force": {"unit": "N", "doc": "Force on B along e1a; not with a motion; .nan: none."},
            "max_force": {"unit": "N"},
            "approach_speed": {"unit": "m/s"},
        },
    )
    spin: Imposed = group(
        Imposed,
        change={
            "position": {"unit": "rad", "doc": "Angle to hold or reach; .nan: none."},
            "velocity": {"unit": "rad/s"},
            "force": {
                "unit": "N.m",
                "doc": "Moment on B about e1a; not with a motion; .nan: none.",
            },
            "max_force": {
                "unit": "N.m",
                "doc": "Greatest moment of an imposed motion, which gives way beyond it.",
            },
            "approach_speed": {"default": 1.0, "unit": "rad/s"},
        },
    )
