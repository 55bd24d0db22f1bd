"""The plant: two rigid bodies under gravity, loads and held wrenches."""

import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.core import plant
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.bodies import PlantBody
from cylconn_ros.scene.initial import check_start
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]


class Plant:
    """Two rigid bodies, or one and ground, in place of a simulator.

    A wrench is converted once, at the pose of its sample, to force and torque about the mass
    centre, and held over the period in world axes, or in body axes where ``wrench.hold`` is
    ``body``. Translation is then exact, rotation fourth order (:mod:`cylconn_ros.core.rigid_body`);
    with ``plant_integration: semi_implicit`` velocities are updated first, and positions with the
    new velocities.

    Attributes
    ----------
        state: (26,) pose and twist of A, then of B, as in a sample (world axes).
        par: parameter array (core/model.py).
        over_time: what changes over time.
        loads: (12,) external loads on A and B as in a sample, of the coming period.
        time_ns: simulated time. steps: periods since the start. period_ns: of one period.

    Raises :class:`SceneError` if the scene has no period, a body without mass and inertia, or a
    changing overlap that is too short in the initial poses.
    """

    def __init__(self, scene: Scene) -> None:
        if scene.period <= 0.0:
            raise SceneError("period = 0.0: must be > 0 s for a plant, which creates the stamps")
        if scene.constraint == "simulator" and scene.method != "minimal":
            raise SceneError(
                "constraint = 'simulator': the bodies of the plant have no joint; use a simulator "
                "that has one, the constraint 'connector', or the method minimal"
            )
        for name, body in (("body_a", scene.body_a), ("body_b", scene.body_b)):
            if body.kind == "unknown" and (math.isnan(body.mass) or not body.inertia):
                raise SceneError(
                    f"{name}.mass, {name}.inertia: must be given for a plant, "
                    "which moves the body, also if the connector does not know them"
                )
        check_start(scene)
        self.scene = scene
        self.par = pack(scene, plant=True)
        self.period_ns = round(scene.period * 1e9)
        self.steps = 0
        self.over_time = OverTime(scene)
        self.loads = self.over_time.loads(0)
        self.state = np.concatenate(
            [
                _start(scene.body_a.pose, scene.plant.body_a),
                _start(scene.body_b.pose, scene.plant.body_b),
            ]
        )

    @property
    def time_ns(self) -> int:
        """Simulated time, ns."""
        return self.steps * self.period_ns

    def step(self, wrench_a: Array, wrench_b: Array) -> None:
        """Advance one period under wrenches as published: (6,) force, torque each."""
        plant.step(self.par, self.state, wrench_a, wrench_b, self.loads, self.scene.period)
        self._count(self.steps + 1)

    def move(self, state: Array, steps: int) -> None:
        """Set the state (26,) after ``steps`` periods."""
        self.state[:] = state
        self._count(steps)

    def _count(self, steps: int) -> None:
        self.steps = steps
        if self.over_time.loads_change:
            self.loads[:] = self.over_time.loads(steps)

    def energy(self) -> float:
        """Kinetic and gravitational energy of both bodies, J."""
        return float(plant.energy(self.par, self.state))

    def momentum(self) -> Array:
        """(6,) linear momentum and angular momentum about the world's origin, world axes."""
        return np.array(plant.momentum(self.par, self.state))


def _start(pose: tuple[float, ...], initial: PlantBody) -> Array:
    return np.array([*(initial.pose or pose), *initial.twist], dtype=np.float64)
