"""Laws of the method minimal: friction at every instant of its dense output, and momentum.

The method integrates a whole motion, so its laws are those of an instant and not of a step. Between
events it integrates to a tolerance, so momentum is constant to that tolerance, MOMENTUM.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.friction import along, at_contact, contact, limit
from cylconn_ros.laws.normalised import ratio, worst
from cylconn_ros.laws.parameters import Bodies, Parameters, parameters_of, tables_of, world
from cylconn_ros.laws.sample_state import Motion, motion
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import Solution, solve

Array = NDArray[np.float64]
INSTANTS = 400
MOMENTUM = 1e-9


def check(scene: Scene) -> tuple[dict[str, Array], float]:
    """Residuals (INSTANTS,) by law, and the relative change of momentum.

    The change is 0 for scenes whose momentum is not constant.
    """
    times = np.linspace(0.0, scene.plant.duration, INSTANTS)
    found = solve(scene, times=times)
    p = parameters_of([scene]).take(np.zeros(INSTANTS, dtype=np.intp))
    preload = scene.plant.preload_amplitude
    p = dataclasses.replace(p, preload=p.preload * np.array([preload.at(t) for t in times]))
    p = at_contact(p, found.length, found.length[:1], np.abs(found.length))
    residuals = _friction(p, scene, found)
    events = np.isin(
        times, [event.time for event in found.events]
    )  # an impulse has no finite force
    residuals = {law: np.where(events, np.nan, values) for law, values in residuals.items()}
    return residuals, _momentum(p, scene, found)


def _friction(p: Parameters, scene: Scene, found: Solution) -> dict[str, Array]:
    """Residuals (INSTANTS,) of the laws of friction."""
    tables = tables_of([scene])
    phi = found.friction / np.column_stack([np.ones(INSTANTS), p.radius])
    s = np.column_stack([found.velocity, p.radius * found.angular_velocity])
    force, moment = found.forces[:, :3], found.forces[:, 3:]
    radial, _, bending, normal = contact(p, force, moment)
    terms = radial + bending + np.abs(p.preload)
    rate, traction = rigid.norm(s), rigid.norm(phi)
    slips, sticks = found.regime == layout.SLIP, found.regime == layout.STICK
    cosine = along(np.where(slips[:, None], s, -phi))
    greatest = limit(p, tables, rate, normal, cosine)
    size = np.maximum(greatest, limit(p, tables, rate, terms, cosine))
    over = np.where(slips, traction - greatest, np.maximum(traction - greatest, 0.0))
    rows = rate[:, None] * phi + greatest[:, None] * s
    sizes = rate[:, None] * (np.abs(phi) + traction[:, None]) + (size * rate)[:, None]
    power = np.maximum(rigid.dot(phi, s), 0.0)
    moving = slips & (rate > 0.0)
    return {
        "friction_limit": np.where(p.on & (sticks | moving), ratio(over, size), np.nan),
        "slip_direction": np.where(moving, worst(ratio(rows, sizes)), np.nan),
        "stick": np.where(sticks, rate, np.nan),
        "dissipation": np.where(p.on, ratio(power, traction * rate), np.nan),
    }


def _momentum(p: Parameters, scene: Scene, found: Solution) -> float:
    """Largest change of linear and angular momentum of two free bodies, relative to its size."""
    loads = (*scene.plant.body_a.load, *scene.plant.body_b.load)
    if any(loads) or any(scene.gravity) or not (p.a.free[0] and p.b.free[0]):
        return 0.0
    sample = np.zeros((INSTANTS, layout.NSAMPLE))
    sample[:, layout.MOTION] = found.states
    total, size = np.zeros((INSTANTS, 6)), 0.0
    for body, pose, twist in (
        (p.a, layout.A_POSE, layout.A_TWIST),
        (p.b, layout.B_POSE, layout.B_TWIST),
    ):
        m = motion(body, sample, pose, twist)
        linear = m.velocity / body.inverse_mass[:, None]
        angular = np.cross(m.com, linear) + _angular_momentum(body, m)
        total += np.column_stack([linear, angular])
        size = size + rigid.norm(linear).max() * (1.0 + rigid.norm(m.com).max())
        size = size + rigid.norm(_angular_momentum(body, m)).max()
    return float(np.abs(total - total[0]).max() / size)


def _angular_momentum(body: Bodies, m: Motion) -> Array:
    """(n, 3) angular momentum about the mass centre, world axes."""
    inertia = world(body.inertia, rigid.matrix(m.orientation))
    return rigid.out_of(inertia, m.spin)
