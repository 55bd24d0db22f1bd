"""Pages of a sweep and of an archive: what they say, and that they draw without an error."""

from pathlib import Path

import numpy as np
import pytest
from browser import browser

from cylconn_ros.cli.main import main
from cylconn_ros.study.sensitivity import rank_correlation, share


def test_shares_of_the_variance_are_those_of_the_function() -> None:
    generator = np.random.default_rng(5)
    x, y, z = generator.random((3, 20_000))
    # Var(4x) = 16/12, Var((2y - 1)^2) = 4/45, z has no influence.
    output = 4.0 * x + (2.0 * y - 1.0) ** 2
    variance = 16.0 / 12.0 + 4.0 / 45.0
    assert share(x, output) == pytest.approx(16.0 / 12.0 / variance, abs=0.01)
    assert share(y, output) == pytest.approx(4.0 / 45.0 / variance, abs=0.01)
    assert share(z, output) == pytest.approx(0.0, abs=0.003)
    assert rank_correlation(x, output) > 0.9
    assert abs(rank_correlation(y, output)) < 0.03
    words = np.array(["a", "b"], dtype=object)[(x > 0.5).astype(int)]
    assert share(words, output) == pytest.approx(0.75 * 16.0 / 12.0 / variance, abs=0.02)
    assert share(x, np.full(len(x), 3.0)) == 0.0
    rounded = 9.81 + 4e-15 * (x > np.median(x))  # does not change but by rounding
    assert share(x, rounded) == 0.0


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of a scene near its jam, half of whose rows fail."""
    folder = tmp_path_factory.mktemp("page") / "study"
    command = ["sweep", "near_jam", "--sample", "200", "--design", "sobol", "--seed", "2"]
    command += ["--distribution", "friction.coefficient=normal:0.2:0.03"]
    command += ["--vary", "friction.overlap=0.06:0.15", "--vary", "method=impulse,penalty"]
    command += ["--correlation", "friction.coefficient,friction.overlap=-0.3"]
    assert main([*command, "-o", str(folder), "--workers", "2"]) == 1
    return folder


def test_a_page_says_how_many_jam_and_what_failed(study: Path) -> None:
    text = (study / "page.html").read_text()
    for said in (
        "of 200 runs jam", "200 rows failed", "95 % interval of the probability of a jam",
        "200 rows, first 200: penalty.stiffness = .nan: must be given",
    ):  # fmt: skip
        assert said in text


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (1400, True), (390, False)])
def test_a_page_draws_its_plots(study: Path, tmp_path: Path, width: int, dark: bool) -> None:
    with browser(tmp_path) as page:
        page.open(study / "page.html", width, 6000, dark)
        page.wait_for_drawing()
        assert page.problems == []
        titles = page.run("[...document.querySelectorAll('.points h3')].map((e) => e.textContent)")
        assert "Jam map" in titles
        assert "Probability of a jam against friction.overlap" in titles
        drawn = page.run("document.querySelectorAll('.points .stage').length")
        assert drawn == len(titles) >= 5
        assert page.run("document.documentElement.scrollWidth") <= width


def test_one_row_runs_again_as_a_recording(study: Path, tmp_path: Path, capsys) -> None:
    run = tmp_path / "run"
    assert main(["sweep", str(study), "--row", "17", "-o", str(run)]) == 0
    assert "friction.coefficient" in capsys.readouterr().out
    assert main(["replay", str(run), "--compare"]) == 0
    assert main(["sweep", str(study), "--row", "400", "-o", str(tmp_path / "no")]) == 2
    assert "row 400 is not written (of 400 rows)" in capsys.readouterr().err
    assert main(["sweep", str(study), "-o", str(tmp_path / "no")]) == 2
    assert "is a dataset: give --row N" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--vary", "friction.coeficient=1,2"], "did you mean friction.coefficient?"),
        (["--distribution", "period=normal:1:1"], "--distribution needs --sample N"),
        (["--sample", "5"], "at least one"),
        ([], "nothing varies"),
        (["--vary", "period=1e-3,2e-3", "--outputs", "jamm"], "output jamm: must be one of"),
        (["--vary", "friction.coefficient=0.1,-1"], "row 1: friction.coefficient = -1.0: must be"),
        (["--vary", "period=1e-3,2e-3", "--scheduler", "tcp://127.0.0.1:9"], "does not answer"),
    ],
)
def test_what_cannot_be_run_is_said(
    options: list[str], message: str, tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setattr("cylconn_ros.study.executors.PATIENCE", 1.0)
    assert main(["sweep", "coast", *options, "-o", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
