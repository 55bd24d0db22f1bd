"""Method minimal on random scenes: it reaches the end with finite numbers and without energy gain.

The scenes have many or no friction solutions: mu up to 10, overlap lengths of a millimetre, preload
of either sign, caps, stops with any restitution, springs. HARD lists scenes that failed earlier.
"""

import math
from typing import Any

import numpy as np
import pytest
from scenes import Array, about_y, pair, sleeve

from cylconn_ros.core import plant
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import Solution, solve

SEED = 20261122
TIMES = np.linspace(0.0, 0.3, 4)
REST_LENGTH = 0.2


def random_scene(number: int) -> Scene:
    """The random scene of this number."""
    rng = np.random.default_rng((SEED, number))

    def one(*values: float) -> float:
        return float(rng.choice(values))

    friction = {
        "coefficient": one(0.05, 0.2, 0.5, 1.0, 3.0, 10.0),
        "radius": float(10.0 ** rng.uniform(-3.0, -1.0)),
        "overlap": one(0.0, 1e-3, 1e-2, 0.1),
        "preload": one(0.0, 1.0, -2.0, 20.0),
    }
    if rng.random() < 0.3:
        friction |= {"static_coefficient": 1.5 * friction["coefficient"], "decay": 10.0}
    if rng.random() < 0.1:
        friction["max_force"] = 5.0
    values: dict[str, Any] = {
        "v": float(rng.normal()) * one(0.0, 0.1, 1.0, 10.0),
        "spin": float(rng.normal()) * one(0.0, 1.0, 30.0),
        "friction": friction if rng.random() < 0.85 else {},
    }
    if rng.random() < 0.4:
        values["stops"] = {
            "l_min": -0.1, "l_max": 0.5, "theta_min": -2.0, "theta_max": 3.0,
            "restitution": one(0.0, 0.3, 0.8, 1.0),
        }  # fmt: skip
    if rng.random() < 0.4:
        values["elasticity"] = {"k1": one(10.0, 1000.0), "kr1": one(0.0, 0.1)}
    if rng.random() < 0.3:
        values["damping"] = {"c1": one(0.1, 5.0)}
    if rng.random() < 0.5:
        x, y, z = map(float, 0.05 * rng.normal(size=3))
        tipped = about_y(float(rng.uniform(-1.5, 1.5)))
        mass = float(10.0 ** rng.uniform(-2.0, 2.0))
        return sleeve(mass=mass, com=(x, y, z), shaft=tipped, l0=REST_LENGTH, **values)
    x, y, z = map(float, rng.normal(size=3) * one(0.0, 1.0, 20.0))
    mass = float(10.0 ** rng.uniform(-3.0, 3.0))
    gravity = [0.0, 0.0, one(0.0, -9.81)]
    return pair(mass_a=mass, turning=(x, y, z), gravity=gravity, l0=REST_LENGTH, **values)


def energy(scene: Scene, found: Solution) -> Array:
    """Energy of both bodies and of the springs, which are relaxed at the start, J."""
    par, k = pack(scene, plant=True), scene.elasticity
    bodies = np.array([plant.energy(par, state) for state in found.states])
    elongation, twist = found.length - REST_LENGTH, found.angle - found.angle[0]
    return np.asarray(bodies + 0.5 * k.k1 * elongation**2 + 0.5 * k.kr1 * twist**2)


# Slip that jams repeatedly as soon as it starts, or that needs the greater of two tractions; many
# bounces, stiff slip, and stick close to breakaway.
HARD = (64, 74, 496, 583, 585, 863, 871, 1189, 1403, 1800, 1880, 2039)
# A cap on P: close to a jam P jumps to it, and slip alternates between the two sides.
ACCUMULATING = (57, 1756, 2369)


@pytest.mark.parametrize("numbers", [range(120), HARD])
def test_random_scenes_reach_the_end(numbers: range | tuple[int, ...]) -> None:
    for number in numbers:
        scene = random_scene(number)
        found = solve(scene, TIMES[-1], 1e-9, TIMES)
        assert found.coarse == math.inf or number in ACCUMULATING, number
        assert np.all(np.isfinite(found.rows)), number
        values = energy(scene, found)
        assert np.max(np.diff(values)) <= 1e-7 * np.abs(values).max() + 1e-12, number
        stops = scene.stops
        slack = 1e-9 + 1e-12 * np.abs(found.length)
        assert not np.any(found.length < stops.l_min - slack), number
        assert not np.any(found.length > stops.l_max + slack), number
        sliding, radius = found.regime == SLIP, scene.friction.radius
        slip = np.stack([found.velocity, radius * found.angular_velocity], axis=1)[sliding]
        traction = (found.friction / [1.0, radius])[sliding]
        power = np.sum(slip * traction, axis=1)
        against = -found.traction[sliding] * np.hypot(*slip.T)
        np.testing.assert_allclose(power, against, rtol=1e-12, atol=1e-14, err_msg=str(number))


@pytest.mark.parametrize("number", ACCUMULATING)
def test_accumulating_events_are_passed_and_reported(number: int) -> None:
    """The end is reached with coarser steps, from the time `coarse` on; the result converges."""
    scene = random_scene(number)
    rough, fine = (solve(scene, 0.3, 1e-9, TIMES, most) for most in (4000, 16000))
    for found in (rough, fine):
        assert 0.0 < found.coarse < 0.3
        assert np.all(np.isfinite(found.rows))
        values = energy(scene, found)
        assert np.max(np.diff(values)) <= 1e-4 * np.abs(values).max()
    assert rough.angle[-1] == pytest.approx(fine.angle[-1], abs=5e-3)
    assert rough.length[-1] == pytest.approx(fine.length[-1], abs=1e-4)


def test_stick_holds_if_slip_would_jam_at_once() -> None:
    """Friction then exceeds its limit: it is the mean of the impulses of infinitely many jams."""
    found = solve(random_scene(496), 0.3, 1e-9, TIMES)
    assert [event.kind for event in found.events] == ["jams"]
    assert np.all(found.regime[1:] == STICK)
    assert np.all(found.traction[1:] > found.limit[1:])
    assert np.ptp(found.length[1:]) == np.ptp(found.angle[1:]) == 0.0
