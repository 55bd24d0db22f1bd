"""Friction of connectors that share bodies: closed forms, and an independent check of every law."""

import numpy as np
import pytest

from cylconn_ros.connector.group import Group
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import several
from cylconn_ros.simulation.group import simulate_group

MASS, PULL, MU, OVERLAP, WEIGHT = 4.0, 40.0, 0.2, 0.1, 4.0 * 9.81


def drawer(beside, places=((0.0, 0.2), (0.0, -0.2)), **changes):
    """A drawer on rails at ``places``, pulled with 40 N ``beside`` its middle."""
    names = [f"rail{k}" for k in range(len(places))]
    found = {
        "connectors": names,
        "body_a": {"frame": "cabinet", "kind": "fixed"},
        "body_b": {"frame": "drawer", "mass": MASS, "inertia": [0.1, 0.0, 0.0, 0.1, 0.0, 0.15]},
        "friction": {"coefficient": MU, "radius": 0.01, "overlap": OVERLAP},
        "plant": {"body_b": {"load": [PULL, 0.0, 0.0, 0.0, 0.0, -PULL * beside]}},
        **changes,
    }
    for name, (x, y) in zip(names, places, strict=True):
        found[name] = {f"node_{end}": {"position": [x, y, 0.0]} for end in "ab"}
        found[name]["node_a"]["orientation"] = [0.0, 0.0, 0.0, 1.0]
    return found


@pytest.mark.parametrize("beside", [0.05, 0.1, 0.19])
def test_a_drawer_pulled_beside_its_middle_slides_as_the_closed_form_says(beside):
    run = simulate_group(list(several(drawer(beside)).values()), 100)
    friction = 2.0 * MU * (WEIGHT / 2.0 + 2.0 / OVERLAP * beside * PULL / 2.0)
    speed = run.outs[:, 0, layout.VELOCITY]
    np.testing.assert_allclose(np.diff(speed) / 0.001, (PULL - friction) / MASS, rtol=1e-9)
    assert run.outs[:, :, layout.RESIDUAL].max() < 1e-12


@pytest.mark.parametrize("beside", [0.21, 0.23, 0.26])
def test_a_drawer_that_friction_holds_shares_it_equally(beside):
    run = simulate_group(list(several(drawer(beside)).values()), 50)
    held = run.outs[:, :, layout.FORCE_FRICTION]
    np.testing.assert_allclose(held.sum(axis=1), -PULL, rtol=1e-12)
    np.testing.assert_allclose(held, -PULL / 2.0, rtol=1e-6)
    assert run.outs[:, :, layout.RESIDUAL].max() < 1e-12
    assert np.all(run.outs[:, :, layout.REGIME] == layout.STICK)
    assert abs(run.bodies.states[0][layout.B_POSE]) < 1e-15


def test_rails_that_are_not_parallel_are_said():
    found = drawer(0.0)
    turned = [0.0, 0.0, np.sin(0.1), np.cos(0.1)]
    found["rail1"]["node_a"]["orientation"] = turned
    outs = simulate_group(list(several(found).values()), 5).outs
    assert np.all(outs[:, :, layout.FLAGS].astype(int) & layout.CONTRADICTORY)
    assert np.isfinite(outs).all()
    assert np.abs(outs[:, :, layout.VELOCITY]).max() < 1e-12
    good = simulate_group(list(several(drawer(0.0)).values()), 5).outs
    assert not np.any(good[:, :, layout.FLAGS].astype(int) & layout.CONTRADICTORY)


def _random_drawer(rng):
    """A drawer on two or four rails of random friction, some with springs, loads and rates."""
    y = rng.uniform(0.05, 0.3)
    places = [(rng.uniform(-0.2, 0.2), s * y) for s in (1, -1)]
    if rng.random() < 0.5:
        places += [(x + 0.3, -1.0 * side) for x, side in places]
    found = drawer(rng.normal() * 0.1, places, gravity=(5.0 * rng.normal(size=3)).tolist())
    found["plant"]["body_b"]["twist"] = [rng.choice([0.0, 0.3 * rng.normal()]), *[0.0] * 5]
    for k in range(len(places)):
        mu, c = rng.uniform(0.05, 0.6), rng.uniform(0.1, 0.99)
        found[f"rail{k}"]["friction"] = {"coefficient": mu, "overlap": 2.0 * mu * y / c}
        if rng.random() < 0.3:
            found[f"rail{k}"]["elasticity"] = {"k1": 10.0 ** rng.uniform(0, 3)}
    return found


def _check_laws(scenes, outs, after, h):
    """Disc, direction, stick and momentum from what is published, the mass and the next sample."""
    total = 0.0
    for scene, out, end in zip(scenes, outs, after, strict=True):
        f, m = out[layout.FORCE : layout.FORCE + 3], out[layout.MOMENT : layout.MOMENT + 3]
        law = scene.friction
        normal = np.hypot(f[1], f[2]) + 2.0 / law.overlap * np.hypot(m[1], m[2])
        friction, limit = out[layout.FORCE_FRICTION], law.coefficient * normal
        scale = limit + abs(friction)
        assert abs(friction) <= limit + 1e-9 * scale
        rate = end[layout.VELOCITY]
        if out[layout.REGIME] == layout.SLIP:
            assert abs(friction) == pytest.approx(limit, rel=1e-9, abs=1e-9 * scale)
            assert friction * (rate + out[layout.VELOCITY]) <= 1e-9 * scale
        else:
            assert abs(rate) < 1e-9
        total += f[0]
    return total


def test_random_drawers_satisfy_every_law():
    rng = np.random.default_rng(14)
    worst, unsolved = 0.0, 0
    for _ in range(200):
        found = _random_drawer(rng)
        scenes = list(several(found).values())
        run = simulate_group(scenes, 4)
        for k in range(3):
            outs, after = run.outs[k], run.outs[k + 1]
            residual = outs[:, layout.RESIDUAL].max()
            flagged = bool(np.any(outs[:, layout.FLAGS].astype(int) & layout.NOT_CONVERGED))
            assert flagged == (residual > 1e-9)
            assert np.isfinite(outs).all()
            unsolved += flagged
            if flagged:
                continue
            worst = max(worst, residual)
            axial = _check_laws(scenes, outs, after, 0.001)
            change = MASS * (after[0, layout.VELOCITY] - outs[0, layout.VELOCITY]) / 0.001
            applied = PULL + MASS * found["gravity"][0] + axial
            assert change == pytest.approx(applied, abs=1e-8 * (abs(axial) + PULL))
    assert worst < 1e-9
    assert unsolved <= 1, unsolved


def test_a_group_gives_the_same_bits_again():
    scenes = list(several(_random_drawer(np.random.default_rng(3))).values())
    first, second = simulate_group(scenes, 20), simulate_group(scenes, 20)
    np.testing.assert_array_equal(first.outs, second.outs)
    group = Group(scenes)
    outs = [group.step(sample) for sample in first.samples]
    np.testing.assert_array_equal(outs, first.outs)
