"""What is known of each scene of the library: its quantities, their values, and how near to come.

Tolerances are what the method `impulse` is held to at a period of 1 ms; other periods are granted
their power ``order`` of it, but never less than rounding.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.reference import closed_forms, fixed_shaft
from cylconn_ros.reference.free_pair import free_pair
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import Run

ROUNDING = 1e-9  # of a value, or absolute below 1


@dataclasses.dataclass(frozen=True)
class Expected:
    """A quantity of a run, its value, and the error allowed at a period of 1 ms."""

    name: str
    unit: str
    of: Callable[[Run], float]
    value: float
    tolerance: float
    order: float = 2.0

    def allowed(self, period: float) -> float:
        """The error allowed at a period (s)."""
        return self.tolerance * (period / 1e-3) ** self.order + ROUNDING * max(1.0, abs(self.value))


# --- what is measured of a run


def distance(run: Run) -> float:
    """Slide since the start, m."""
    return float(run.state("displacement")[-1])


def rotation(run: Run) -> float:
    """Spin since the start, rad."""
    return float(run.state("rotation")[-1])


def length(run: Run) -> float:
    """Position in the slot, m."""
    return float(run.state("length")[-1])


def velocity(run: Run) -> float:
    """Of the slide at the end, m/s."""
    return float(run.state("velocity")[-1, 0])


def spin(run: Run) -> float:
    """At the end, rad/s."""
    return float(run.state("angular_velocity")[-1, 0])


def stop_time(run: Run) -> float:
    """When it came to rest for good, s; NaN if it did not."""
    stops = np.flatnonzero(run.state("stop_time") >= 0.0)
    if run.outs[-1, layout.REGIME] != layout.STICK or not len(stops):
        return math.nan
    return float(run.time[stops[-1]] + run.state("stop_time")[stops[-1]])


def creep(run: Run) -> float:
    """Greatest slide or turn at the radius since the start, m."""
    radius = run.connector.scene.friction.radius
    slid, turned = run.state("displacement"), radius * run.state("rotation")
    return float(np.hypot(slid, turned).max())


def energy_change(run: Run) -> float:
    """Greatest change of energy over the energy at the start."""
    return float(np.abs(run.energy / run.energy[0] - 1.0).max())


def momentum_change(run: Run) -> float:
    """Greatest change of total momentum over its greatest component."""
    before = Plant(run.connector.scene).momentum()
    return float(np.abs(run.plant.momentum() - before).max() / np.abs(before).max())


# --- what is expected of a scene, up to the time ``end`` of the last sample (s)


def _speed(scene: Scene) -> float:
    return float(np.linalg.norm(scene.plant.body_b.twist[:3]))


def _weight(scene: Scene) -> float:
    """Gravity across the slot where that is level, m/s^2."""
    return float(np.linalg.norm(scene.gravity))


def along(scene: Scene) -> float:
    """Gravity along a slot that is tipped about y, m/s^2."""
    x, y, z, w = scene.node_a.orientation
    return -2.0 * (x * z - w * y) * _weight(scene)


def _rest(name: str, value: float = 0.0) -> Expected:
    return Expected(name, "m", creep, value, 0.0, 0.0)


def coast(scene: Scene, _end: float) -> list[Expected]:
    """Constant deceleration: exact but for the last, partial period."""
    f, body = scene.friction, scene.body_b
    a = f.coefficient * abs(_weight(scene) + f.preload / body.mass)
    time, way = closed_forms.coast(
        f.coefficient, _weight(scene), f.preload, body.mass, _speed(scene)
    )
    return [
        Expected("stop time", "s", stop_time, time, 0.0, 0.0),
        Expected("distance", "m", distance, way, 1e-6 * a / 8.0),
    ]


def reduced_to_rest(scene: Scene, end: float) -> list[Expected]:
    """Solve the reduced equations; it stops within the duration."""
    found = fixed_shaft.slide_and_spin(scene, end, points=2)
    return [
        Expected("stop time", "s", stop_time, found.stop_time, 1e-4),
        Expected("distance", "m", distance, found.distance, 1e-4),
        Expected("turn", "rad", rotation, float(found.alpha[-1]), 3e-4),
    ]


def stick_ellipse(scene: Scene, _end: float) -> list[Expected]:
    """Statics: traction, limit, and no motion."""
    force, moment = scene.plant.body_b.load[0], scene.plant.body_b.load[3]
    f = scene.friction
    traction = math.hypot(force, moment / f.radius)
    return [
        _rest("creep"),
        Expected("traction", "N", lambda run: run.state("traction")[-1], traction, 0.0, 0.0),
        Expected(
            "limit",
            "N",
            lambda run: run.state("friction_limit")[-1],
            f.coefficient * f.preload,
            0.0,
            0.0,
        ),
    ]


def slide_and_spin(scene: Scene, _end: float) -> list[Expected]:
    """Constant normal force, m R^2/I = 2."""
    v0, f = _speed(scene), scene.friction
    turning = float(np.linalg.norm(scene.plant.body_b.twist[3:]))
    tau = v0 / (f.coefficient * _weight(scene))
    time, way = closed_forms.constant_normal_force(f.radius * turning / v0, v0, tau)
    return [
        Expected("stop time", "s", stop_time, time, 1e-7),
        Expected("distance", "m", distance, way, 3e-7),
    ]


def pushed(scene: Scene, end: float) -> list[Expected]:
    """A push beside the axis, from rest: Fbend = 2 F e/L beside the weight."""
    f, body, load = scene.friction, scene.body_b, scene.plant.body_b.load
    pressed = body.mass * _weight(scene) + 2.0 * math.hypot(load[4], load[5]) / f.overlap
    a = (load[0] - f.coefficient * pressed) / body.mass
    return [
        Expected("distance", "m", distance, 0.5 * a * end * end, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, a * end, 0.0, 0.0),
    ]


def stays(_scene: Scene, _end: float) -> list[Expected]:
    """No motion at all."""
    return [_rest("creep")]


def incline(scene: Scene, end: float) -> list[Expected]:
    """Constant acceleration down the slope, from rest."""
    x, y, z, w = scene.node_a.orientation
    slope = math.asin(-2.0 * (x * z - w * y))
    a = _weight(scene) * (math.sin(slope) - scene.friction.coefficient * math.cos(slope))
    return [Expected("distance", "m", distance, 0.5 * a * end**2, 0.0, 0.0)]


def free_slide(scene: Scene, end: float) -> list[Expected]:
    """Constant acceleration down the slope, constant spin."""
    a = along(scene)
    turn = float(np.linalg.norm(scene.plant.body_b.twist[3:])) * end
    return [
        Expected("distance", "m", distance, _speed(scene) * end + 0.5 * a * end**2, 0.0, 0.0),
        Expected("turn", "rad", rotation, turn, 0.0, 0.0),
    ]


def between_stops(scene: Scene, end: float) -> list[Expected]:
    """Constant speed between instant impacts."""
    stops = scene.stops
    x, v = closed_forms.bouncing(stops.l_max - stops.l_min, _speed(scene), stops.restitution, end)
    return [
        Expected("position", "m", length, stops.l_min + x, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, v, 0.0, 0.0),
    ]


def end_stop(scene: Scene, _end: float) -> list[Expected]:
    """At rest on the stop, which carries the weight along the slope."""
    weight = along(scene) * scene.body_b.mass
    return [
        Expected("position", "m", length, scene.stops.l_max, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, 0.0, 0.0, 0.0),
        Expected(
            "stop's force", "N", lambda run: run.state("force_reaction")[-1], -weight, 0.0, 0.0
        ),
    ]


def dry_friction_oscillator(scene: Scene, _end: float) -> list[Expected]:
    """Half cycles, each about a centre shifted by F/k."""
    mass, k = scene.body_b.mass, scene.elasticity.k1
    force = scene.friction.coefficient * mass * _weight(scene)
    time, place = closed_forms.dry_oscillator(
        k, mass, force, scene.body_b.pose[0] - scene.reference.length
    )
    return [
        # a held wrench spends what is left of a period at each turning point: first order
        Expected("stop time", "s", stop_time, time, 1.5e-3, 1.0),
        Expected("place of rest", "m", length, scene.reference.length + place, 1e-5),
    ]


def conserved(_scene: Scene, _end: float) -> list[Expected]:
    """Momentum to the last digits, energy to second order."""
    return [
        Expected("change of momentum", "", momentum_change, 0.0, 0.0, 0.0),
        Expected("change of energy", "", energy_change, 0.0, 1e-6),
    ]


def turning_pair(scene: Scene, end: float) -> list[Expected]:
    """Both bodies by Newton-Euler."""
    found = free_pair(scene, end)
    return [
        Expected("distance", "m", distance, found.distance, 1e-5),
        Expected("turn", "rad", rotation, found.angle, 1e-3),
        Expected("change of momentum", "", momentum_change, 0.0, 0.0, 0.0),
    ]


def twenty_turns(scene: Scene, end: float) -> list[Expected]:
    """Constant spin, starting short of its reference."""
    turn = float(np.linalg.norm(scene.plant.body_b.twist[3:])) * end
    return [
        Expected("turn", "rad", rotation, turn, 0.0, 0.0),
        Expected(
            "turn beyond theta1ref",
            "rad",
            lambda run: run.state("material_rotation")[-1],
            turn - scene.reference.angle,
            0.0,
            0.0,
        ),
    ]


def three_answers(scene: Scene, _end: float) -> list[Expected]:
    """Least of the solutions of f = mu (FCint + (2/L) |M - d f|), f the friction force."""
    f, d = scene.friction, scene.body_b.com[2]
    couple = abs(scene.plant.body_b.load[4])
    arm = 2.0 / f.overlap
    least = f.coefficient * (f.preload + arm * couple) / (1.0 + f.coefficient * arm * d)
    return [
        Expected(
            "first friction force", "N", lambda run: -run.state("force")[0, 0], least, 0.0, 0.0
        )
    ]


def eccentric_rotor(scene: Scene, end: float) -> list[Expected]:
    """Spin that dies as 1/(1 + q w0 t)."""
    f, body = scene.friction, scene.body_b
    turn, end_spin = closed_forms.own_centrifugal_load(
        f.coefficient,
        f.radius,
        body.mass,
        math.hypot(*body.com),
        body.inertia[0],
        scene.plant.body_b.twist[3],
        end,
    )
    return [
        Expected("turn", "rad", rotation, turn, 1e-3),
        Expected("spin", "rad/s", spin, end_spin, 1e-4),
    ]


def near_jam(scene: Scene, _end: float) -> list[Expected]:
    """Friction that presses itself on: constant deceleration."""
    f = scene.friction
    time, way = closed_forms.near_jam(
        f.coefficient, -scene.body_b.com[2], f.overlap, _weight(scene), _speed(scene)
    )
    a = 0.5 * _speed(scene) ** 2 / way
    return [
        Expected("stop time", "s", stop_time, time, 0.0, 0.0),
        Expected("distance", "m", distance, way, 1e-6 * a / 8.0),
    ]


def jam(scene: Scene, _end: float) -> list[Expected]:
    """At rest at once; a held wrench needs one period for it."""
    v0 = _speed(scene)
    return [
        Expected("distance", "m", distance, 0.0, 0.5e-3 * v0, 1.0),
        Expected("velocity", "m/s", velocity, 0.0, 0.0, 0.0),
    ]


def stuck_pair(scene: Scene, end: float) -> list[Expected]:
    """Nothing slips, and nothing is lost."""
    return [
        Expected("creep", "m", creep, 0.0, 1e-6),
        *conserved(scene, end),
    ]


def bead_on_rod(scene: Scene, end: float) -> list[Expected]:
    """From rest on the rod: l'' = w^2 l."""
    l0, w = scene.initial_pose(1)[0], scene.plant.body_a.twist[5]
    return [Expected("position", "m", length, l0 * math.cosh(w * end), 1e-5)]


def telescopic_strut(scene: Scene, end: float) -> list[Expected]:
    """A damped oscillation about the sag."""
    push = -scene.body_b.mass * _weight(scene)
    u, v = closed_forms.damped_oscillator(
        scene.elasticity.k1, scene.damping.c1, scene.body_b.mass, push, end
    )
    return [
        Expected("distance", "m", distance, u, 3e-6),
        Expected("velocity", "m/s", velocity, v, 5e-5),
    ]


def stribeck_coast(scene: Scene, _end: float) -> list[Expected]:
    """Friction that rises as the sleeve slows down."""
    f = scene.friction
    time = closed_forms.decaying_coefficient(
        f.coefficient, f.static_coefficient, f.decay, _weight(scene), _speed(scene)
    )
    return [Expected("stop time", "s", stop_time, time, 1e-5)]


def table_coast(scene: Scene, _end: float) -> list[Expected]:
    """Mu linear in the slip rate."""
    table = scene.friction.table
    assert table is not None
    slope = (table.values[1] - table.values[0]) / (table.rates[1] - table.rates[0])
    time, way = closed_forms.linear_coefficient(
        table.values[0], slope, _weight(scene), _speed(scene)
    )
    return [
        Expected("stop time", "s", stop_time, time, 1e-6),
        Expected("distance", "m", distance, way, 1e-6),
    ]


def torque_limiter(scene: Scene, _end: float) -> list[Expected]:
    """A constant moment R P."""
    w0, f = scene.plant.body_b.twist[3], scene.friction
    slowing = f.radius * f.max_force / scene.body_b.inertia[0]
    return [
        Expected("stop time", "s", stop_time, w0 / slowing, 0.0, 0.0),
        Expected("turn", "rad", rotation, 0.5 * w0 * w0 / slowing, 1e-6 * slowing / 8.0),
    ]


def latch(scene: Scene, end: float) -> list[Expected]:
    """Held where the lock is; the spin does not notice."""
    turn = scene.plant.body_b.twist[3] * end
    return [
        Expected("position", "m", length, scene.lock.position, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, 0.0, 0.0, 0.0),
        Expected("turn", "rad", rotation, turn, 0.0, 0.0),
    ]
