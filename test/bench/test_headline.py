"""The headline of the precision benchmark: ratios by hand, picture and table."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from cylconn_ros.bench.common.results import Findings, Measurement, Setting
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.precision import headline
from cylconn_ros.bench.precision.cases import ERROR
from cylconn_ros.bench.precision.trials import COST

IMPULSE, MINIMAL, LOOP = "impulse", "minimal", "MuJoCo RK4, loop"


def some(*points: tuple[str, str, float, float, float]) -> Findings:
    """Findings of (case, solver, step or tolerance, cost in ms, error in m)."""
    found = Findings()
    for case, name, value, cost, error in points:
        settings: dict[str, Setting] = {SOLVERS[name].parameter: value}
        found.measurements += [
            Measurement(case, name, ERROR, error, "m", settings=settings),
            Measurement(case, name, COST, cost, "ms", settings=settings),
        ]
    return found


FOUND = some(
    # Two points of a front; own errors at their costs are 1e-6 and 1e-8, those of impulse 1e-4.
    ("demo", LOOP, 1e-3, 1.0, 1e-3),
    ("demo", LOOP, 1e-4, 10.0, 1e-5),
    ("demo", MINIMAL, 1e-6, 0.9, 1e-6),
    ("demo", MINIMAL, 1e-8, 9.0, 1e-8),
    ("demo", IMPULSE, 1e-3, 0.9, 1e-4),
    # A peer that is better and cheaper.
    ("coast", LOOP, 1e-3, 1.0, 1e-5),
    ("coast", IMPULSE, 1e-3, 1.05, 2e-5),
    # No simulator.
    ("free_slide", MINIMAL, 1e-6, 1.0, 1e-6),
)


def test_ratios_are_those_at_equal_cost() -> None:
    by_case = {row.case: row for row in headline.rows(FOUND)}
    demo, coast, alone = by_case["demo"], by_case["coast"], by_case["free_slide"]
    assert demo.worst == pytest.approx(1e-3)
    assert demo.best == pytest.approx(1e-3)
    assert demo.live == pytest.approx(1e-4 / 1e-5)
    assert demo.limit == 1e-2
    assert demo.met
    assert coast.worst == pytest.approx(2.0)
    assert coast.dominated == 1
    assert not coast.met
    assert math.isnan(alone.worst)
    assert alone.met
    assert [row.case for row in headline.rows(FOUND)] == ["demo", "coast", "free_slide"]


def test_the_sentences_say_what_was_measured() -> None:
    assert headline.story(headline.rows(FOUND)) == (
        "not larger on 1 of 2 scenes, at most a hundredth on 1 of 1 whose friction depends on "
        "changing reactions (◆)"
    )
    table = headline.table(headline.rows(FOUND))
    assert "dominate points of our front on coast." in table
    assert "| `demo` ◆" in table
    better = some(("coast", LOOP, 1e-3, 1.0, 1e-5), ("coast", IMPULSE, 1e-3, 0.5, 1e-6))
    assert "No point of another solver dominates" in headline.table(headline.rows(better))


def test_the_picture_is_drawn_for_light_and_dark_pages(tmp_path: Path) -> None:
    files = headline.save(FOUND, tmp_path)
    assert {file.name for file in files} == {
        f"headline{dark}.{end}" for dark in ("", "_dark") for end in ("png", "svg")
    }
    light, dark = ((tmp_path / f"headline{k}.svg").read_text() for k in ("", "_dark"))
    for text in ("1 000× smaller than MuJoCo RK4", "2.0× larger than", "no simulator has"):
        assert text in light
        assert text in dark
    assert headline.LIGHT.page.lower() in light
    assert headline.DARK.page.lower() in dark
