"""The friction disc: the law, its packing, the selection rule, and completeness of the search."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from cylconn_ros.core import friction, friction_disc, slip_curve
from cylconn_ros.core.friction import Law
from cylconn_ros.core.layout import JAMMED, SEVERAL_ROOTS, SLIP, STICK

PAR = np.zeros(8)


def law(mu: float = 0.5, **change: float) -> Law:
    values = {
        "on": True,
        "kinetic": mu,
        "static": mu,
        "decay": 0.0,
        "cap": math.inf,
        "radius": 0.02,
        "bending": 20.0,
        "preload": 0.0,
        "rate_slope": 0.0,
        "force_slope": 0.0,
        "rates": 0,
        "forces": 0,
        "centre": 0.0,
        "radial": 1.0,
        "direction": 0.0,
        "table": 0,
    }
    return Law(**{**values, **change})  # type: ignore[arg-type]


def test_a_packed_law_is_unpacked() -> None:
    """All numbers differ, so that an exchange of two is found."""
    packed = law(
        0.3, static=0.5, decay=7.0, cap=90.0, preload=-3.0, rate_slope=1.4, force_slope=0.01,
        rates=2, forces=3, centre=0.07, radial=0.0, direction=-0.6, table=20,
    )  # fmt: skip
    par = np.zeros(30)
    par[4 : 4 + friction.SIZE] = friction.pack(packed)
    assert friction.unpack(par, 4, 20) == packed


def test_bounds_of_the_coefficient_hold_for_every_scene_parameter() -> None:
    """Least, greatest coefficient and slopes bound mu, without and with a table."""
    table = friction.Table([0.0, 0.1, 1.0], [0.0, 50.0], [0.4, 0.3, 0.3, 0.2, 0.25, 0.1])
    given = {
        "on": True, "coefficient": 0.2, "static_coefficient": 0.5, "decay": 10.0, "cap": math.inf,
        "radius": 0.02, "overlap": 0.1, "preload": 1.0,
    }  # fmt: skip
    for case in (None, table):
        made = friction.make_law(**given, table=case)  # type: ignore[arg-type]
        par = np.array([] if case is None else [*case.rates, *case.forces, *case.values])
        rates, forces = np.linspace(0.0, 1.5, 151), np.linspace(0.0, 60.0, 61)
        mu = np.array([[friction.coefficient(made, par, s, f) for f in forces] for s in rates])
        least, greatest = friction.least_coefficient(made), friction.greatest_coefficient(made)
        assert least - 1e-12 <= mu.min() <= mu.max() <= greatest + 1e-12
        slope = np.abs(np.diff(mu, axis=0)).max() / (rates[1] - rates[0])
        assert 0.5 * made.rate_slope < slope <= made.rate_slope * (1.0 + 1e-9)
        slope = np.abs(np.diff(mu, axis=1)).max() / (forces[1] - forces[0])
        assert slope <= made.force_slope * (1.0 + 1e-9)


def test_normal_force_is_the_formula() -> None:
    """All numbers differ, so that an exchange of two is found."""
    for preload in (7.0, -40.0):
        c = friction.contact(law(preload=preload), (3.0, 4.0, 0.5, 1.2))
        assert c == pytest.approx((5.0, 1.3, 26.0, abs(31.0 + preload)))
    assert friction.contact(law(bending=0.0), (3.0, 4.0, 0.5, 1.2)).normal == pytest.approx(5.0)


def test_coefficient_decays_from_static_to_kinetic() -> None:
    decaying = law(0.2, static=0.5, decay=3.0)
    for rate in (0.0, 0.1, 2.0):
        expected = 0.2 + 0.3 * math.exp(-3.0 * rate)
        assert friction.coefficient(decaying, PAR, rate, 1.0) == pytest.approx(expected)
    assert friction.limit(decaying, PAR, 0.0, 10.0, 0.0) == pytest.approx(5.0)
    assert friction.limit(law(0.2, static=0.5, decay=3.0, cap=4.0), PAR, 0.0, 10.0, 0.0) == 4.0


def test_table_is_bilinear_and_constant_beyond_its_ends() -> None:
    rates, forces = [0.0, 1.0, 3.0], [10.0, 20.0]
    values = [0.1, 0.2, 0.3, 0.5, 0.6, 0.9]
    par = np.array([*rates, *forces, *values])
    table = law(rates=3, forces=2, table=0)
    for rate, force, expected in (
        (0.0, 10.0, 0.1),
        (3.0, 20.0, 0.9),
        (1.0, 15.0, 0.4),
        (0.5, 10.0, 0.2),
        (2.0, 20.0, 0.7),
        (2.0, 15.0, 0.575),
        (9.0, 5.0, 0.6),
        (-1.0, 99.0, 0.2),
    ):
        assert friction.coefficient(table, par, rate, force) == pytest.approx(expected)
    one = law(rates=1, forces=1, table=0)
    assert friction.coefficient(one, np.array([0.0, 1.0, 0.33]), 5.0, 5.0) == pytest.approx(0.33)


def three_answers() -> slip_curve.DiscProblem:
    """m=1, v=1, h=1 ms, mu=0.5, L=0.1, d=0.2, N0=1 N, 1 N.m of bending against friction's arm.

    f2 = 1 N; the bending moment is 1 - 0.2 |f1| (friction acts through the arm d): with 2/L = 20,
    FN = 1 + 20 |1 - 0.2 P|.
    """
    return slip_curve.make_disc_problem(
        (1.0, 0.0),
        (1.0, 0.0),
        1e-3,
        0.0,
        1.0,
        (1.0, 0.0, 1.0, 0.0),
        (0.0, 0.0, 0.2, 0.0),
        (0.0, 0.0, 0.0, 0.0),
    )


def test_three_solutions() -> None:
    """Case 11: a sliding sleeve takes 3.5 N, not 9.5; a stuck one stays stuck."""
    sliding = friction_disc.solve_disc(law(0.5), PAR, three_answers(), False)
    assert sliding.regime == SLIP
    assert sliding.phi == pytest.approx((-3.5, 0.0), abs=1e-12)
    assert sliding.flags & SEVERAL_ROOTS
    stuck = friction_disc.solve_disc(law(0.5), PAR, three_answers(), True)
    assert stuck.regime == STICK
    assert stuck.phi == pytest.approx((-1000.0, 0.0))


def test_alternative_solutions() -> None:
    """If the limits need another solution: nearest to stick, or of least traction after stick."""
    resting = friction_disc.solve_alternative(law(0.5), PAR, three_answers(), False)
    assert resting.regime == STICK
    assert resting.phi == pytest.approx((-1000.0, 0.0))
    sliding = friction_disc.solve_alternative(law(0.5), PAR, three_answers(), True)
    assert (sliding.regime, sliding.flags) == (SLIP, SEVERAL_ROOTS)
    assert sliding.phi == pytest.approx((-3.5, 0.0), abs=1e-12)
    unstuck = friction_disc.solve_alternative(law(0.001), PAR, three_answers(), False)
    assert (unstuck.regime, unstuck.flags) == (SLIP, 0)


def test_spin_frees_the_slide() -> None:
    """One disc, not a box: slide and spin share the limit by the slip direction."""
    problem = slip_curve.make_disc_problem(
        (3.0, 4.0), (3.0, 4.0), 1e-6, 0.0, 1e-6, (10.0, 0, 0, 0), (0.0, 0, 0, 0), (0.0, 0, 0, 0)
    )
    found = friction_disc.solve_disc(law(0.5), PAR, problem, False)
    assert found.phi == pytest.approx((-3.0, -4.0), rel=1e-6)
    assert math.hypot(*found.phi) == pytest.approx(5.0, rel=1e-14)


def test_no_normal_force_is_no_friction() -> None:
    free = slip_curve.make_disc_problem(
        (1.0, 2.0), (1.0, 2.0), 1.0, 0.0, 1.0, *[(0.0, 0.0, 0.0, 0.0)] * 3
    )
    found = friction_disc.solve_disc(law(), PAR, free, False)
    assert (found.phi, found.s_end) == ((0.0, 0.0), (1.0, 2.0))


def test_self_locking_stops_within_the_step() -> None:
    """FN grows faster than friction: no finite sliding force, stick under any push."""
    for push in (1.0, 1e3, 1e6):
        problem = slip_curve.make_disc_problem(
            (1.0, 0.0), (push, 0.0), 1e-3, 0, 1.0, (1.0, 0, 0, 0), (0.0, 0, 0.2, 0), (0.0, 0, 0, 0)
        )
        found = friction_disc.solve_disc(law(0.5), PAR, problem, False)  # c = 0.5 * 20 * 0.2 = 2
        assert found.regime == STICK
        assert found.flags & JAMMED
        assert found.phi[0] == pytest.approx(-1e3 * push)


def problems(
    seed: int, n: int, by_direction: bool = False
) -> Iterator[tuple[Law, friction_disc.DiscProblem, np.ndarray, bool]]:
    """Random problems over wide scales, including jams and vanishing normal forces."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        s = rng.normal(size=(2, 2))
        s = (s @ s.T + 10 ** rng.uniform(-4, 0) * np.eye(2)) * 10 ** rng.uniform(-3, 3)
        s_minus = rng.normal(size=2) * 10 ** rng.uniform(-2, 1)
        scale = float(np.linalg.norm(s_minus) / np.trace(s))
        push = rng.normal(size=2) * np.linalg.norm(s_minus) * 10 ** rng.uniform(-2, 1)
        base = rng.normal(size=4) * scale * 10 ** rng.uniform(-2, 1)
        c1, c2 = rng.normal(size=(2, 4)) * 10 ** rng.uniform(-1.5, 1.5)
        mu = 10 ** rng.uniform(-1.5, 1)
        rise = float(rng.choice([0.0, 0.0, 1.0])) * mu * rng.random()
        decay = 10 ** rng.uniform(-1, 1) / float(np.linalg.norm(s_minus))
        yield (
            law(
                mu,
                static=mu + rise,
                decay=decay,
                rate_slope=decay * rise,
                cap=math.inf if rng.random() < 0.8 else scale * 10 ** rng.uniform(-1, 1),
                bending=float(rng.choice([0.0, 1.0, 20.0])),
                preload=float(rng.choice([0, 1, -1])) * scale * 10 ** rng.uniform(-2, 1),
                direction=float(rng.choice([rng.uniform(-1, 1), -1, 1])) if by_direction else 0.0,
                radial=float(rng.random() < 0.7) if by_direction else 1.0,
            ),
            slip_curve.make_disc_problem(
                tuple(s_minus), tuple(s_minus + push), s[0, 0], s[0, 1], s[1, 1],
                tuple(base), tuple(c1), tuple(c2),
            ),
            s,
            bool(rng.random() < 0.3),
        )  # fmt: skip


def normal_force(law_: Law, d: friction_disc.DiscProblem, phi: np.ndarray) -> np.ndarray:
    """FN of phi (2, n), implemented independently."""
    f = [d.base[i] + d.c1[i] * phi[0] + d.c2[i] * phi[1] for i in range(4)]
    pressed = (
        law_.radial * np.hypot(f[0], f[1]) + law_.bending * np.hypot(f[2], f[3]) + law_.preload
    )
    return np.asarray(np.abs(pressed))


@pytest.mark.parametrize("by_direction", [False, True])
def test_the_law_holds_and_the_rule_selects_the_root(by_direction: bool) -> None:
    """Friction limit, slip direction and stick to 1e-11; compared with a scan of all roots."""
    several = sticks = 0
    for law_, d, s, was_stick in problems(3, 1500, by_direction):
        found = friction_disc.solve_disc(law_, PAR, d, was_stick)
        phi = np.array(found.phi)
        traction = float(np.linalg.norm(phi))
        normal = float(normal_force(law_, d, phi[:, None])[0])
        s_end = np.array(d.s_free) + s @ phi
        sizes = np.linalg.norm(d.s_free) + np.linalg.norm(s) * traction
        if found.regime == STICK:
            sticks += 1
            most = law_.static * (1.0 - law_.direction * phi[0] / max(traction, 1e-300))
            assert traction <= min(law_.cap, most * normal) * (1.0 + 1e-12)
            assert np.linalg.norm(s_end) <= 1e-11 * sizes
        else:
            theta = 0.5 if np.dot(d.s_minus, s_end) > 0.25 * np.dot(d.s_minus, d.s_minus) else 1.0
            s_mean = np.array(found.s_mean)
            rate = float(np.linalg.norm(s_mean))
            mu = law_.kinetic + (law_.static - law_.kinetic) * math.exp(-law_.decay * rate)
            terms = mu * (1.0 + abs(law_.direction)) * normal
            mu *= 1.0 + law_.direction * s_mean[0] / rate
            limit = min(law_.cap, mu * normal)
            assert traction == pytest.approx(limit, rel=1e-10, abs=1e-14 * terms)
            off = np.linalg.norm(rate * phi + limit * s_mean)
            assert off <= rate * (1e-10 * (traction + limit) + 1e-14 * terms)
            mean = (1.0 - theta) * np.array(d.s_minus) + theta * s_end
            if not np.allclose(mean, s_mean, atol=1e-10 * sizes):
                assert np.allclose(s_end, s_mean, atol=1e-10 * sizes)  # theta = 1 is always allowed
        several += bool(found.flags & SEVERAL_ROOTS)
        least = least_scanned(law_, d, s, was_stick)
        if least is not None and found.regime == SLIP:
            assert traction <= least * 1.02
    assert several > 30
    assert sticks > 300


def least_scanned(
    law_: Law, d: friction_disc.DiscProblem, s: np.ndarray, was_stick: bool
) -> float | None:
    """The least traction at which limit - |phi| changes sign, on a fine grid."""
    values, vectors = np.linalg.eigh(s)
    for theta in (1.0,) if was_stick else (0.5, 1.0):
        mean = (1.0 - theta) * np.array(d.s_minus) + theta * np.array(d.s_free)
        a = vectors.T @ mean
        r = np.geomspace(1e9, 1e-9, 4000) * np.trace(s)
        phi = vectors @ (-a[:, None] / (theta * values[:, None] + r))
        size = np.hypot(*phi)
        rate = r * size
        mu = law_.kinetic + (law_.static - law_.kinetic) * np.exp(-law_.decay * rate)
        mu *= 1.0 - law_.direction * phi[0] / size
        spare = np.minimum(law_.cap, mu * normal_force(law_, d, phi)) - size
        roots = np.flatnonzero((spare[:-1] >= 0.0) & (spare[1:] < 0.0))
        if len(roots):
            first = phi[:, roots[0] + 1]
            s_end = np.array(d.s_free) + s @ first
            if theta == 1.0 or np.dot(d.s_minus, s_end) > 0.25 * np.dot(d.s_minus, d.s_minus):
                return float(np.linalg.norm(first))
    return None


def test_extreme_inertias_have_a_solution() -> None:
    """70 t with an inertia of 1e-9 kg m^2 leave S indefinite by rounding."""
    law_ = law(0.067, static=0.096, decay=0.476, rate_slope=0.0138, bending=4.17, preload=0.008)
    problem = slip_curve.make_disc_problem(
        (-96.12008971843107, -0.9044862930735948),
        (-84.99906539980135, -10.257228859332232),
        7.13899e-07,
        1.413e-08,
        -1.18e-08 + 7.2e-09,
        (61231997.62666528, -29149332.244162012, 596114420.7421695, 1218982063.3723009),
        (-0.24812155306608202, 0.0548531313154722, -0.7607977481499268, -3.4413772616630562),
        (-0.25702526695598205, -0.1335080279730458, 2.664271404526498, -5.129167754414068),
    )
    for was_stick in (False, True):
        found = friction_disc.solve_disc(law_, PAR, problem, was_stick)
        assert np.all(np.isfinite([*found.phi, *found.s_end]))


def test_a_component_at_a_limit_does_not_hide_the_other() -> None:
    """Both at a limit, spin at rest: friction of slide is at its limit, in either search."""
    held = slip_curve.make_disc_problem(
        (1.0, 0.0), (6e-15, 0.0), 0.0, 0.0, 0.0, (10.0, 0, 0, 0), (0.0, 0, 0, 0), (0.0, 0, 0, 0)
    )
    for found in (
        friction_disc.solve_disc(law(0.5), PAR, held, False),
        friction_disc.solve_alternative(law(0.5), PAR, held, False),
        friction_disc.solve_alternative(law(0.5), PAR, held, True),
    ):
        assert found.regime == SLIP
        assert found.phi == pytest.approx((-5.0, 0.0))


def test_the_bending_moment_is_about_the_middle_of_the_contact() -> None:
    """A force at the middle, 30 mm before node b, bends nothing there."""
    moved = law(centre=0.03)
    across = (2.0, -5.0, 0.03 * -5.0, -0.03 * 2.0)  # (f2, f3) and its moment about node b
    assert friction.contact(moved, across).moment == pytest.approx(0.0, abs=1e-15)
    assert friction.contact(law(), across).moment == pytest.approx(0.03 * math.hypot(2.0, 5.0))
