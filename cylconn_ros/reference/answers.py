"""Reference values of the bundled scenes: quantities of a run, their values and tolerances.

A tolerance is the error allowed for the method `impulse` at a period of 1 ms. It scales with the
power ``order`` of the period, and is never less than rounding.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.reference import closed_forms, fixed_shaft
from cylconn_ros.reference.free_pair import free_pair
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import Run

ROUNDING = 1e-9  # relative for values above 1, else absolute


@dataclasses.dataclass(frozen=True)
class Expected:
    """Reference value of a quantity of a run.

    Attributes
    ----------
        name, unit: of the quantity.
        of: computes the quantity from a Run, or the GroupRun of a scene of several connectors.
        value: reference value.
        tolerance: error allowed at a period of 1 ms, beyond rounding.
        order: power of the period with which the tolerance scales.
    """

    name: str
    unit: str
    of: Callable[[Any], float]
    value: float
    tolerance: float
    order: float = 2.0

    def allowed(self, period: float) -> float:
        """Error allowed at a period (s)."""
        return self.tolerance * (period / 1e-3) ** self.order + ROUNDING * max(1.0, abs(self.value))


# --- quantities of a run


def distance(run: Run) -> float:
    """Slide since the start, m."""
    return float(run["displacement"][-1])


def rotation(run: Run) -> float:
    """Spin since the start, rad."""
    return float(run["rotation"][-1])


def length(run: Run) -> float:
    """Position in the slot, m."""
    return float(run["length"][-1])


def velocity(run: Run) -> float:
    """Velocity of the slide at the end, m/s."""
    return float(run["velocity"][-1, 0])


def spin(run: Run) -> float:
    """Angular velocity of the spin at the end, rad/s."""
    return float(run["angular_velocity"][-1, 0])


def stop_time(run: Run) -> float:
    """Begin of the final rest, s; NaN if the run does not end at rest."""
    stops = np.flatnonzero(run["stop_time"] >= 0.0)
    if run.outs[-1, layout.REGIME] != layout.STICK or not len(stops):
        return math.nan
    return float(run.time[stops[-1]] + run["stop_time"][stops[-1]])


def creep(run: Run) -> float:
    """Largest displacement since the start, slide and turn times radius combined, m."""
    radius = run.scene.friction.radius
    slid, turned = run["displacement"], radius * run["rotation"]
    return float(np.hypot(slid, turned).max())


def energy_change(run: Run) -> float:
    """Largest change of energy, relative to the energy at the start."""
    return float(np.abs(run.energy / run.energy[0] - 1.0).max())


def momentum_change(run: Run) -> float:
    """Largest change of total momentum, relative to its largest component."""
    before = Plant(run.scene).momentum()
    return float(np.abs(run.plant.momentum() - before).max() / np.abs(before).max())


# --- reference values of a scene, for the time ``end`` of the last sample (s)


def _speed(scene: Scene) -> float:
    return float(np.linalg.norm(scene.plant.body_b.twist[:3]))


def _gravity_across(scene: Scene) -> float:
    """Gravity across a level slot, m/s^2."""
    return float(np.linalg.norm(scene.gravity))


def gravity_along_slot(scene: Scene) -> float:
    """Gravity along a slot that is inclined about y, m/s^2."""
    x, y, z, w = scene.node_a.orientation
    return -2.0 * (x * z - w * y) * _gravity_across(scene)


def _rest(name: str, value: float = 0.0) -> Expected:
    return Expected(name, "m", creep, value, 0.0, 0.0)


def coast(scene: Scene, _end: float) -> list[Expected]:
    """Constant deceleration: exact except for the last, partial period."""
    f, body = scene.friction, scene.body_b
    a = f.coefficient * abs(_gravity_across(scene) + f.preload / body.mass)
    time, travel = closed_forms.coast(
        f.coefficient, _gravity_across(scene), f.preload, body.mass, _speed(scene)
    )
    return [
        Expected("stop time", "s", stop_time, time, 0.0, 0.0),
        Expected("distance", "m", distance, travel, 1e-6 * a / 8.0),
    ]


def reduced_to_rest(scene: Scene, end: float) -> list[Expected]:
    """Solution of the reduced equations, with a stop within the duration."""
    found = fixed_shaft.slide_and_spin(scene, end, points=2)
    return [
        Expected("stop time", "s", stop_time, found.stop_time, 1e-4),
        Expected("distance", "m", distance, found.distance, 1e-4),
        Expected("turn", "rad", rotation, float(found.alpha[-1]), 3e-4),
    ]


def stick_ellipse(scene: Scene, _end: float) -> list[Expected]:
    """Statics: traction, friction limit, no motion."""
    force, moment = scene.plant.body_b.load[0], scene.plant.body_b.load[3]
    f = scene.friction
    traction = math.hypot(force, moment / f.radius)
    return [
        _rest("creep"),
        Expected("traction", "N", lambda run: run["traction"][-1], traction, 0.0, 0.0),
        Expected(
            "limit",
            "N",
            lambda run: run["friction_limit"][-1],
            f.coefficient * f.preload,
            0.0,
            0.0,
        ),
    ]


def slide_and_spin(scene: Scene, _end: float) -> list[Expected]:
    """Constant normal force, m R^2/I = 2."""
    v0, f = _speed(scene), scene.friction
    turning = float(np.linalg.norm(scene.plant.body_b.twist[3:]))
    tau = v0 / (f.coefficient * _gravity_across(scene))
    time, travel = closed_forms.constant_normal_force(f.radius * turning / v0, v0, tau)
    return [
        Expected("stop time", "s", stop_time, time, 1e-7),
        Expected("distance", "m", distance, travel, 3e-7),
    ]


def pushed(scene: Scene, end: float) -> list[Expected]:
    """An eccentric push from rest: Fbend = 2 F e/L in addition to the weight."""
    f, body, load = scene.friction, scene.body_b, scene.plant.body_b.load
    pressed = body.mass * _gravity_across(scene) + 2.0 * math.hypot(load[4], load[5]) / f.overlap
    a = (load[0] - f.coefficient * pressed) / body.mass
    return [
        Expected("distance", "m", distance, 0.5 * a * end * end, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, a * end, 0.0, 0.0),
    ]


def stays(_scene: Scene, _end: float) -> list[Expected]:
    """No motion."""
    return [_rest("creep")]


def incline(scene: Scene, end: float) -> list[Expected]:
    """Constant acceleration down the slope, from rest."""
    x, y, z, w = scene.node_a.orientation
    slope = math.asin(-2.0 * (x * z - w * y))
    a = _gravity_across(scene) * (math.sin(slope) - scene.friction.coefficient * math.cos(slope))
    return [Expected("distance", "m", distance, 0.5 * a * end**2, 0.0, 0.0)]


def free_slide(scene: Scene, end: float) -> list[Expected]:
    """Constant acceleration down the slope, constant spin."""
    a = gravity_along_slot(scene)
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
    """Rest on the stop, which carries the component of the weight along the slope."""
    weight = gravity_along_slot(scene) * scene.body_b.mass
    return [
        Expected("position", "m", length, scene.stops.l_max, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, 0.0, 0.0, 0.0),
        Expected("stop's force", "N", lambda run: run["force_reaction"][-1], -weight, 0.0, 0.0),
    ]


def dry_friction_oscillator(scene: Scene, _end: float) -> list[Expected]:
    """Half cycles, each about a centre shifted by F/k."""
    mass, k = scene.body_b.mass, scene.elasticity.k1
    force = scene.friction.coefficient * mass * _gravity_across(scene)
    time, position = closed_forms.dry_oscillator(
        k, mass, force, scene.body_b.pose[0] - scene.reference.length
    )
    return [
        # a held wrench loses the rest of a period at each turning point: first order
        Expected("stop time", "s", stop_time, time, 1.5e-3, 1.0),
        Expected("position of rest", "m", length, scene.reference.length + position, 1e-5),
    ]


def conserved(_scene: Scene, _end: float) -> list[Expected]:
    """Momentum to rounding, energy to second order."""
    return [
        Expected("change of momentum", "", momentum_change, 0.0, 0.0, 0.0),
        Expected("change of energy", "", energy_change, 0.0, 1e-6),
    ]


def turning_pair(scene: Scene, end: float) -> list[Expected]:
    """Newton-Euler equations of both bodies."""
    found = free_pair(scene, end)
    return [
        Expected("distance", "m", distance, found.distance, 1e-5),
        Expected("turn", "rad", rotation, found.angle, 1e-3),
        Expected("change of momentum", "", momentum_change, 0.0, 0.0, 0.0),
    ]


def twenty_turns(scene: Scene, end: float) -> list[Expected]:
    """Constant spin that starts below its reference angle."""
    turn = float(np.linalg.norm(scene.plant.body_b.twist[3:])) * end
    return [
        Expected("turn", "rad", rotation, turn, 0.0, 0.0),
        Expected(
            "turn beyond theta1ref",
            "rad",
            lambda run: run["material_rotation"][-1],
            turn - scene.reference.angle,
            0.0,
            0.0,
        ),
    ]


def three_answers(scene: Scene, _end: float) -> list[Expected]:
    """Least solution of f = mu (FCint + (2/L) |M - d f|), f the friction force."""
    f, d = scene.friction, scene.body_b.com[2]
    couple = abs(scene.plant.body_b.load[4])
    arm = 2.0 / f.overlap
    least = f.coefficient * (f.preload + arm * couple) / (1.0 + f.coefficient * arm * d)
    return [Expected("first friction force", "N", lambda run: -run["force"][0, 0], least, 0.0, 0.0)]


def eccentric_rotor(scene: Scene, end: float) -> list[Expected]:
    """Spin that decays as 1/(1 + q w0 t)."""
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
    """Friction that increases its own normal force: constant deceleration."""
    f = scene.friction
    time, travel = closed_forms.near_jam(
        f.coefficient, -scene.body_b.com[2], f.overlap, _gravity_across(scene), _speed(scene)
    )
    a = 0.5 * _speed(scene) ** 2 / travel
    return [
        Expected("stop time", "s", stop_time, time, 0.0, 0.0),
        Expected("distance", "m", distance, travel, 1e-6 * a / 8.0),
    ]


def jam(scene: Scene, _end: float) -> list[Expected]:
    """Immediate rest; a held wrench needs one period for it."""
    v0 = _speed(scene)
    return [
        Expected("distance", "m", distance, 0.0, 0.5e-3 * v0, 1.0),
        Expected("velocity", "m/s", velocity, 0.0, 0.0, 0.0),
    ]


def stuck_pair(scene: Scene, end: float) -> list[Expected]:
    """No slip, and no loss of momentum or energy."""
    return [
        Expected("creep", "m", creep, 0.0, 1e-6),
        *conserved(scene, end),
    ]


def bead_on_rod(scene: Scene, end: float) -> list[Expected]:
    """From rest on the rod: l'' = w^2 l."""
    l0, w = scene.initial_pose(1)[0], scene.plant.body_a.twist[5]
    return [Expected("position", "m", length, l0 * math.cosh(w * end), 1e-5)]


def telescopic_strut(scene: Scene, end: float) -> list[Expected]:
    """A damped oscillation about the static deflection."""
    push = -scene.body_b.mass * _gravity_across(scene)
    u, v = closed_forms.damped_oscillator(
        scene.elasticity.k1, scene.damping.c1, scene.body_b.mass, push, end
    )
    return [
        Expected("distance", "m", distance, u, 3e-6),
        Expected("velocity", "m/s", velocity, v, 5e-5),
    ]


def stribeck_coast(scene: Scene, _end: float) -> list[Expected]:
    """Friction that increases as the sleeve slows down."""
    f = scene.friction
    time = closed_forms.decaying_coefficient(
        f.coefficient, f.static_coefficient, f.decay, _gravity_across(scene), _speed(scene)
    )
    return [Expected("stop time", "s", stop_time, time, 1e-5)]


def table_coast(scene: Scene, _end: float) -> list[Expected]:
    """A coefficient that is linear in the slip rate."""
    table = scene.friction.table
    assert table is not None
    slope = (table.values[1] - table.values[0]) / (table.rates[1] - table.rates[0])
    time, travel = closed_forms.linear_coefficient(
        table.values[0], slope, _gravity_across(scene), _speed(scene)
    )
    return [
        Expected("stop time", "s", stop_time, time, 1e-6),
        Expected("distance", "m", distance, travel, 1e-6),
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
    """Slide held at the lock, spin unaffected."""
    turn = scene.plant.body_b.twist[3] * end
    return [
        Expected("position", "m", length, scene.lock.position, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, 0.0, 0.0, 0.0),
        Expected("turn", "rad", rotation, turn, 0.0, 0.0),
    ]
