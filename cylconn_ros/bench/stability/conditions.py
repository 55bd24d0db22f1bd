"""Hard conditions of the stability map, each with grades from easy to hard.

docs/benchmarks/stability.md defines the grades. Each scene is hard in one respect only: it is an
unbalanced sleeve on a fixed shaft, or two free bodies that rotate together. The required end of
each case, at rest or sliding, is stated with it and tested against independent solutions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from cylconn_ros.bench.stability.channel import BAD, QUATERNIONS, Faults
from cylconn_ros.bench.stability.criteria import ANY, RESTS, SLIDES
from cylconn_ros.bench.stability.scenes import LENGTH, long_arm, pair, sleeve
from cylconn_ros.scene.scene import Scene

Kind = Literal["physical", "channel"]
G = 9.81


@dataclass(frozen=True)
class Case:
    """One grade: a scene, the faults of the channel, and the required end."""

    grade: str
    scene: Scene
    end: str = ANY
    faults: Faults = field(default_factory=Faults)


@dataclass(frozen=True)
class Condition:
    """A row of the map.

    Attributes
    ----------
        name: the graded quantity. kind: physical, or of the channel between plant and connector.
        about: scene and meaning in a few words.
        make_cases: returns its cases from easy to hard.
        series: whether the grades are steps of one scale; otherwise they are independent.
    """

    name: str
    kind: Kind
    about: str
    make_cases: Callable[[], Iterable[Case]]
    series: bool = True

    def cases(self) -> list[Case]:
        """All grades."""
        return list(self.make_cases())


def conditions() -> list[Condition]:
    """All conditions, in the order of the map's rows."""
    physical = [*_inertias(), *_motions(), *_friction(), *_geometry(), *_devices()]
    return [*physical, *_channels(), *_free_running(), *_events()]


def _over(
    grades: Iterable[float], make: Callable[[float], Scene], end: str | Callable[[float], str] = ANY
) -> Callable[[], Iterator[Case]]:
    """Cases whose grade is a number."""

    def cases() -> Iterator[Case]:
        for x in grades:
            yield Case(f"{x:g}", make(x), end(x) if callable(end) else end)

    return cases


def _inertias() -> Iterator[Condition]:
    heavy, light = (1.0, 1e2, 1e4, 1e6), (1.0, 1e-2, 1e-4, 1e-6)
    yield Condition(
        "mass ratio A:B, A heavy", "physical", "two free bodies",
        _over(heavy, lambda m: pair(mass_a=m), SLIDES),
    )  # fmt: skip
    yield Condition(
        "mass ratio A:B, A light", "physical", "two free bodies",
        _over(light, lambda m: pair(mass_a=m), lambda m: SLIDES if m > 0.1 else RESTS),
    )  # fmt: skip
    yield Condition(
        "inertia ratio A:B", "physical", "two free bodies of one mass",
        _over(heavy, lambda i: pair(mass_a=1.0, inertia_a=i), SLIDES),
    )  # fmt: skip
    rods = (10.0, 100.0, 1000.0)
    yield Condition(
        "rod-like body B", "physical", "two free bodies, B thin along the slot",
        _over(rods, _rod, SLIDES),
    )  # fmt: skip


def _rod(ratio: float) -> Scene:
    return pair(velocity=2.0, inertia_b=(0.01 / ratio, 0.0, 0.0, 0.01, 0.0, 0.01))


def _motions() -> Iterator[Condition]:
    spins = (0.01, 0.1, 0.5, 1.0, 2.0)
    yield Condition(
        "spin ω h, on a shaft", "physical", "an unbalanced rotor; 1 ms",
        _over(spins, lambda x: sleeve(spin=1e3 * x, duration=0.5), SLIDES),
    )  # fmt: skip
    yield Condition(
        "spin ω h, tumbling", "physical", "two free bodies held together by friction; 1 ms",
        _over(spins, _tumbling, RESTS),
    )  # fmt: skip
    periods = (0.1, 1.0, 10.0, 50.0, 100.0)
    yield Condition(
        "period, ms, on a shaft", "physical", "mass centre below a shaft inclined by 30°",
        _over(periods, _slowly_down, SLIDES),
    )  # fmt: skip
    yield Condition(
        "period, ms, two bodies", "physical", "two free bodies, 5 rad/s",
        _over(periods, lambda h: pair(duration=2.0, period=1e-3 * h), SLIDES),
    )  # fmt: skip


def _slowly_down(period_ms: float) -> Scene:
    """A slow motion, so that only the long period is hard."""
    return sleeve(
        spin=1.0,
        com=(0.03, 0.0, -0.01),
        slope=math.radians(30.0),
        duration=2.0,
        period=1e-3 * period_ms,
    )


def _tumbling(wh: float) -> Scene:
    """Rotation as one body about an axis that is a principal axis of neither body."""
    direction = np.array([1.0, 2.0, 0.5])
    turning = direction / np.linalg.norm(direction) * wh / 1e-3
    friction = {"coefficient": 10.0, "preload": 1e6}
    return pair(
        velocity=0.0, spin=0.0, turning=tuple(turning), duration=0.5, friction=friction
    )  # fmt: skip


def _friction() -> Iterator[Condition]:
    coefficients = (0.1, 0.5, 1.0, 3.0, 10.0)
    slope = math.radians(15.0)

    def on_slope(mu: float) -> Scene:
        friction = {"coefficient": mu}
        return sleeve(slope=slope, velocity=0.5, com=(0.0, 0.0, -0.01), friction=friction)

    yield Condition(
        "friction μ, on a slope", "physical", "inclined by 15°; from μ = 0.5 on it sticks",
        _over(coefficients, on_slope, lambda mu: SLIDES if mu < 0.2 else RESTS),
    )  # fmt: skip
    yield Condition(
        "friction μ, two bodies", "physical", "two free bodies",
        _over(coefficients, _rubbing, lambda mu: SLIDES if mu < 0.3 else RESTS),
    )  # fmt: skip
    couplings = (0.5, 0.9, 0.99, 1.01, 2.0, 10.0)
    yield Condition(
        "coupling c (jam)", "physical", "strong push; from c = 1 on it jams and sticks",
        _over(couplings, _jam, lambda c: SLIDES if c < 1.0 else RESTS),
    )  # fmt: skip


def _rubbing(mu: float) -> Scene:
    return pair(duration=2.0, friction={"coefficient": mu})


def _jam(c: float) -> Scene:
    """Mass centre d below node b, c = 2 μ d/L; below c = 1 the push is twice the friction limit.

    The friction limit is μ m g/(1 - c) there. From c = 1 on any push is held; it is 20 m/s².
    """
    mu, overlap = 0.2, 0.1
    push = 2.0 * mu * G / (1.0 - c) if c < 1.0 else 20.0
    return sleeve(
        com=(0.0, 0.0, -0.5 * c * overlap / mu),
        velocity=1.0,
        spin=0.0,
        duration=0.4,
        gravity=[push, 0.0, -G],
        friction={"coefficient": mu, "overlap": overlap, "preload": 0.0},
    )


def _geometry() -> Iterator[Condition]:
    sizes = (1e-1, 1e-3, 1e-6)
    for name, make, least in (("on a shaft", sleeve, 0.01), ("two bodies", pair, 1.0)):
        yield Condition(
            f"overlap L, m, {name}", "physical", "a short bearing jams",
            _over(sizes, _of(make, "overlap"), lambda x: SLIDES if x > 0.01 else RESTS),
        )  # fmt: skip
        yield Condition(
            f"radius R, m, {name}", "physical", "with a small radius, spin hardly frees the slide",
            _over(sizes, _of(make, "radius"), _rests_from(least)),
        )  # fmt: skip
    angles = (1.0, 30.0, 90.0, 179.9)
    yield Condition(
        "misalignment held, °", "physical", "sleeve tilted on its shaft",
        _over(angles, lambda x: sleeve(tilt=math.radians(x))),
    )  # fmt: skip
    yield Condition(
        "misalignment pulled in, °", "physical", "sleeve tilted on its shaft, 1 rad/s",
        _over(angles, lambda x: _pulled_in(math.radians(x))),
    )  # fmt: skip
    speeds = (0.1, 1.0, 10.0, 100.0)
    for restitution in (0.0, 0.5):
        yield Condition(
            f"impact, m/s, ε = {restitution:g}", "physical",
            "two stops 2 mm apart and friction, all in one step at high speed",
            _over(speeds, _between_stops(restitution), RESTS),
        )  # fmt: skip


def _of(make: Callable[..., Scene], name: str) -> Callable[[float], Scene]:
    return lambda x: make(friction={name: x})


def _pulled_in(tilt: float) -> Scene:
    return sleeve(
        tilt=tilt, duration=max(1.0, 0.7 + 2.0 * tilt), reference={"misalignment": "zero"}
    )


def _rests_from(size: float) -> Callable[[float], str]:
    return lambda x: RESTS if x > size else SLIDES


def _between_stops(restitution: float) -> Callable[[float], Scene]:
    stops = {"l_min": LENGTH - 1e-3, "l_max": LENGTH + 1e-3, "restitution": restitution}

    def at(speed: float) -> Scene:
        rub = {"coefficient": 0.5}
        return sleeve(velocity=speed, spin=0.0, com=(0.0, 0.0, 0.0), stops=stops, friction=rub)

    return at


def _devices() -> Iterator[Condition]:
    yield Condition(
        "arm/radius of gyration", "physical", "a light body at an arm; ω h = 0.1, 1 ms",
        _over((1.0, 2.0, 5.0, 10.0), long_arm),
    )  # fmt: skip
    yield Condition(
        "load on a stop, m/s²", "physical", "pressed against a stop 5 cm away, friction",
        _over((10.0, 1e3, 1e5), _pressed, RESTS),
    )  # fmt: skip
    yield Condition(
        "changing overlap, m", "physical", "pulled out of its sleeve; overlap at the start",
        _over((0.1, 0.03, 0.01), _pulled_out),
    )  # fmt: skip
    yield Condition(
        "spring k h²/m", "physical", "a linear spring along the slide",
        _over((1e-3, 1.0, 1e3), lambda x: sleeve(elasticity={"k1": 1e6 * x})),
    )  # fmt: skip


def _pressed(load: float) -> Scene:
    stops = {"l_min": LENGTH - 0.05, "l_max": LENGTH + 0.05}
    return sleeve(gravity=[load, 0.0, -G], spin=0.0, com=(0.0, 0.0, 0.0), stops=stops)


def _pulled_out(overlap: float) -> Scene:
    friction = {"overlap": overlap, "overlap_change": "decreasing", "overlap_min": 1e-3}
    return sleeve(velocity=0.5, friction=friction)


def _free_running() -> Iterator[Condition]:
    kinds = (
        ("constant", "constant, a fraction of a sample included"),
        ("jitter", "lag of every sample ±50 %"),
        ("stall", "stops of 50 ms every half second"),
    )
    for kind, about in kinds:
        yield Condition(
            f"free running, lag in samples, {kind}", "channel",
            f"sleeve on a shaft; the plant does not wait, latency measured; {about}",
            _lags(kind),
        )  # fmt: skip


def _lags(kind: str) -> Callable[[], Iterator[Case]]:
    def cases() -> Iterator[Case]:
        for lag in (0.3, 1.0, 2.5, 5.0):
            yield Case(f"{lag:g}", sleeve(latency=-1), SLIDES, Faults(lag=lag, lag_kind=kind))

    return cases


def _channels() -> Iterator[Condition]:
    def over(name: str, shares: Iterable[float]) -> Callable[[], Iterator[Case]]:
        def cases() -> Iterator[Case]:
            for x in shares:
                value: Any = 0.01 * x
                yield Case(f"{abs(x):g}", sleeve(), SLIDES, Faults(**{name: value}))

        return cases

    def late(latency: Callable[[int], int]) -> Callable[[], Iterator[Case]]:
        def cases() -> Iterator[Case]:
            for d in (1, 2, 3, 5):
                yield Case(f"{d}", sleeve(latency=latency(d)), SLIDES, Faults(late=d))

        return cases

    percentages, share = (1, 10, 30), "sleeve on a shaft; share of samples"
    rows: tuple[tuple[str, str, str, tuple[int, ...]], ...] = (
        ("twist too large, %", "twist", "sleeve on a shaft; contradicts the poses", (1, 10, 100)),
        ("twist too small, %", "twist", "the same with the opposite sign", (-1, -10, -100)),
        ("jitter, %", "jitter", "sleeve on a shaft; irregular periods", percentages),
        ("drops, %", "drop", share, percentages),
        ("duplicates, %", "duplicate", share, (10,)),
        ("reordering, %", "reorder", share, (10,)),
    )
    for setting, latency in (
        ("latency not set", lambda d: 0),
        ("latency set", lambda d: d),
        ("latency measured", _measured),
    ):
        yield Condition(
            f"wrench late, samples, {setting}", "channel", "sleeve on a shaft", late(latency)
        )
    for title, name, about, grades in rows:
        yield Condition(title, "channel", about, over(name, grades))


def _measured(_late: int) -> int:
    return -1


def _events() -> Iterator[Condition]:
    def events() -> Iterator[Case]:
        for name in ("pause", "jump", "restart", "teleport"):
            faults: Any = {name: True}
            scene = sleeve(duration=2.0)
            yield Case(name, scene, SLIDES, Faults(**faults))

    def corrupted() -> Iterator[Case]:
        for kind in (*BAD, *QUATERNIONS):
            yield Case(kind, pair(), SLIDES, Faults(corrupt=kind))

    yield Condition(
        "clock and plant", "channel", "one each at half time: pause, jump back, restart, teleport",
        events, series=False,
    )  # fmt: skip
    yield Condition(
        "unusable numbers", "channel", "two free bodies; each field once", corrupted, series=False
    )
