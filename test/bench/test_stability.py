"""The map of hard conditions says what is promised, and where methods are known to fail."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cylconn_ros.bench.common.results import Findings, Gap, Measurement
from cylconn_ros.bench.stability import criteria, measure, picture
from cylconn_ros.bench.stability.conditions import conditions
from cylconn_ros.bench.stability.criteria import RESTS, SLIDES, Verdict
from cylconn_ros.bench.stability.solvers import contestants
from cylconn_ros.cli import main
from cylconn_ros.core import layout
from cylconn_ros.laws import runs_recorded_or_simulated
from cylconn_ros.reference import slide_and_spin
from cylconn_ros.simulation.minimal import solve
from cylconn_ros.simulation.simulate import simulate

Array = NDArray[np.float64]
ROWS = {row.name: row for row in conditions()}
CASES = {(row.name, case.grade): case for row in conditions() for case in row.cases()}
WHO = {who.name: who for who in contestants()}


@functools.cache
def verdict(row: str, grade: str, who: str) -> Verdict:
    return measure.outcome(WHO[who], CASES[row, grade], runs_recorded_or_simulated.broken)


# --- what the default method promises, and where it falls short of it ---

# Promised and not kept yet. Whoever mends one of these takes it out.
SHORT = {
    ("twist too large, %", "100"),  # a method that relies on its rates
    ("twist too small, %", "100"),
}
# Not promised: beyond ω h = 0.5; a delay that nobody told.
OUTSIDE = {
    ("spin ω h, tumbling", "1"),
    ("spin ω h, tumbling", "2"),
    *(("wrench late, samples, not told", grade) for grade in ("1", "2", "3", "5")),
}


@pytest.mark.parametrize("row", ROWS)
def test_the_default_method_survives(row: str) -> None:
    lost = {(row, c.grade) for c in ROWS[row].cases() if verdict(row, c.grade, "impulse").reason}
    assert lost <= SHORT | OUTSIDE, [verdict(*where, "impulse").reason for where in lost]


@pytest.mark.parametrize("grade", ["1", "2"])
@pytest.mark.parametrize("row", ["spin ω h, on a shaft", "spin ω h, tumbling"])
def test_beyond_half_a_radian_a_sample_it_says_so_and_only_loses(row: str, grade: str) -> None:
    scene = CASES[row, grade].scene
    run = simulate(scene, round(scene.plant.duration / scene.period))
    flags = run.outs[:, layout.FLAGS].astype(int)
    assert (flags & layout.UNDERSAMPLED).any()
    assert np.isfinite(run.outs).all()
    kinetic, _ = criteria.energies(scene, run.states)
    assert kinetic.max() <= (1.0 + 1e-9) * kinetic[0]


def test_slow_spin_is_not_said_to_be_undersampled() -> None:
    run = simulate(CASES["spin ω h, tumbling", "0.1"].scene, 100)
    assert not (run.outs[:, layout.FLAGS].astype(int) & layout.UNDERSAMPLED).any()


# --- what is known to fail does ---

FAILS = [
    ("penalty", "coupling c (jam)", "2", "offset"),
    ("penalty", "period, ms, on a shaft", "10", "offset"),  # gains fall with 1/h²: it sags
    ("penalty", "rod-like body B", "1000", "offset"),
    ("penalty", "spin ω h, on a shaft", "0.5", "offset"),
    ("penalty", "wrench late, samples, not told", "5", ""),
    ("baumgarte", "coupling c (jam)", "2", "does not rest"),
    ("baumgarte", "friction μ, on a slope", "0.5", "does not rest"),  # creeps
    ("baumgarte", "spin ω h, on a shaft", "1", ""),
    ("penalty by hand", "friction μ, on a slope", "0.5", "does not rest"),  # regularised
    ("penalty by hand", "overlap L, m, on a shaft", "1e-06", "not finite"),
    ("penalty by hand", "unusable numbers", "NaN", "not finite"),
]


@pytest.mark.parametrize(("who", "row", "grade", "how"), FAILS)
def test_what_is_known_to_fail_fails(who: str, row: str, grade: str, how: str) -> None:
    found = verdict(row, grade, who)
    assert found.reason.startswith(how)
    assert not found.survived


def test_mujocos_constant_friction_slides_through_a_jam() -> None:
    assert verdict("coupling c (jam)", "2", "MuJoCo").reason.startswith("does not rest")
    assert verdict("coupling c (jam)", "2", "MuJoCo loop").survived


@pytest.mark.parametrize("who", ["penalty", "baumgarte", "penalty by hand", "minimal"])
def test_easy_grades_are_survived_by_everybody(who: str) -> None:
    for row in ("mass ratio A:B, A heavy", "friction μ, on a slope", "jitter, %"):
        easiest = ROWS[row].cases()[0].grade
        assert verdict(row, easiest, who).survived, row


@pytest.mark.parametrize("who", ["penalty", "augmented_lagrangian", "baumgarte", "minimal"])
def test_a_misalignment_is_held_by_every_method(who: str) -> None:
    lost = [
        c.grade
        for c in ROWS["misalignment held, °"].cases()
        if not verdict("misalignment held, °", c.grade, who).survived
    ]
    assert lost == []


# --- the ends that the scenes demand, by independent solutions ---


JAMS = {("friction μ, on a slope", "10"), *(("coupling c (jam)", c) for c in ("1.01", "2", "10"))}
SLIDING_ON = ("friction μ, on a slope", "period, ms, on a shaft", "coupling c (jam)")


@pytest.mark.parametrize(
    ("row", "grade"),
    [(row, c.grade) for row in SLIDING_ON for c in ROWS[row].cases() if c.scene.period == 1e-3],
)
def test_ends_on_a_shaft_are_those_of_the_reduced_equations(row: str, grade: str) -> None:
    case = CASES[row, grade]
    if (row, grade) in JAMS:
        with pytest.raises(ValueError, match="jams"):
            slide_and_spin(case.scene, points=2)
        assert case.end == RESTS
        return
    truth = slide_and_spin(case.scene, points=2)
    rests = truth.stop_time < case.scene.plant.duration - criteria.END
    assert case.end == (RESTS if rests else SLIDES)


@pytest.mark.parametrize(("row", "grade"), [where for where, case in CASES.items() if case.end])
def test_ends_are_those_of_the_motion_in_its_own_coordinates(row: str, grade: str) -> None:
    scene = CASES[row, grade].scene
    times = np.arange(0.0, scene.plant.duration, 1e-2, dtype=np.float64)
    states = solve(scene, times[-1], 1e-8, times).states
    slip = criteria.end_slip(scene, times, criteria.look(scene, states))
    assert (slip > criteria.AT_REST) == (CASES[row, grade].end == SLIDES)
    assert not criteria.AT_REST / 10 < slip < 10 * criteria.AT_REST, "not a clear case"


# --- how it is shown ---


def found(results: dict[tuple[str, str], dict[str, str]]) -> Findings:
    return Findings(
        measurements=[
            Measurement(
                row, who, measure.SURVIVED, float(not reason), "1",
                settings={"grade": grade}, note=reason,
            )
            for (row, who), grades in results.items()
            for grade, reason in grades.items()
        ],
        gaps=[Gap("drops, %", "beta", "left out", "because")],
    )  # fmt: skip


RESULTS = found(
    {
        ("jitter, %", "alpha"): {"1": "", "10": "", "30": ""},
        ("jitter, %", "beta"): {"1": "", "10": "offset 2 mm", "30": ""},
        ("drops, %", "alpha"): {"1": "", "10": "offset 2 mm", "30": "offset 9 mm"},
        ("clock and plant", "alpha"): {"pause": "", "jump": "angle 20 mrad"},
        ("clock and plant", "beta"): {"pause": "", "jump": ""},
    }
)


def test_marks_are_the_hardest_grade_and_its_share() -> None:
    marks = picture.Map(RESULTS).marks
    assert marks["jitter, %", "alpha"] == picture.Mark("**30**", 1.0)
    assert marks["jitter, %", "beta"].text == "30 (not 10)"
    assert marks["drops, %", "alpha"] == picture.Mark("1", 1 / 3, "10: offset 2 mm")
    assert marks["drops, %", "beta"].text == picture.NOTHING
    assert marks["clock and plant", "alpha"].text == "1 of 2"
    assert marks["clock and plant", "alpha"].failure == "jump: angle 20 mrad"


def test_the_picture_has_every_mark() -> None:
    figure = picture.draw(RESULTS, "title")
    drawn = {text.get_text() for text in figure.axes[0].texts}
    assert {"30", "30 (not 10)", "1", "1 of 2", "2 of 2", picture.NOTHING, "On the way"} <= drawn


def test_the_quick_form_is_a_whole_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, picture, drawing = (tmp_path / f"stability.{end}" for end in ("json", "png", "svg"))
    arguments = ["--quick", "-o", str(data), "--pictures", str(tmp_path)]
    assert main.main(["bench", "stability", *arguments]) == 0
    printed = capsys.readouterr().out
    report = json.loads(data.read_text())
    tried = {m["problem"] for m in report["measurements"]}
    assert tried == set(ROWS)
    assert all(f"| {name} " in printed for name in ROWS)
    assert "The first failure" in printed
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "tumbling" in drawing.read_text()
    assert main.main(["bench", "stability", "--from", str(data)]) == 0
    assert capsys.readouterr().out.startswith(printed.partition("\nkept in")[0])


def test_a_picture_of_something_else_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["bench", "orders", "--pictures", "somewhere"]) != 0
    assert "only precision and stability" in capsys.readouterr().err
