"""Rows of a sweep: axes from texts and files, combinations, and what is wrong with a text."""

from pathlib import Path

import numpy as np
import pytest
from scenes import bundled

from cylconn_ros.errors import StudyError
from cylconn_ros.study.rows import axis_of, changes, combine, read_axis
from cylconn_ros.study.sampling import Distribution, read_correlation, read_distribution, sample


def test_all_combinations_the_last_axis_fastest() -> None:
    texts = ("friction.coefficient=0.1:0.3:3", "period=1e-3:4e-3:3:log")
    rows = combine([read_axis(text) for text in texts])
    assert len(rows) == 9
    assert np.allclose(rows.columns["friction.coefficient"], np.repeat([0.1, 0.2, 0.3], 3))
    assert np.allclose(rows.columns["period"], [1e-3, 2e-3, 4e-3] * 3)
    assert rows.part(7, 99).row(1) == pytest.approx({"friction.coefficient": 0.3, "period": 4e-3})
    assert rows.digest() == combine([read_axis(text) for text in texts]).digest()
    assert rows.digest() != rows.part(0, 8).digest()


def test_lists_of_texts_vectors_and_whole_numbers() -> None:
    rows = combine([read_axis("method=impulse,penalty"), read_axis("body_b.com=[0,0,1],[1,0,0]")])
    assert rows.row(3) == {
        "method": "penalty", "body_b.com[0]": 1.0, "body_b.com[1]": 0.0, "body_b.com[2]": 0.0,
    }  # fmt: skip
    scene = bundled("demo")
    assert changes(scene, rows.row(3)) == {"method": "penalty", "body_b.com": [1.0, 0.0, 0.0]}
    assert changes(scene, {"body_b.com[1]": 5.0})["body_b.com"] == [
        scene.body_b.com[0], 5.0, scene.body_b.com[2],
    ]  # fmt: skip
    assert axis_of("latency", [1, 2])["latency"].dtype == np.int64


def test_files_of_values_of_vectors_and_of_columns(tmp_path: Path) -> None:
    values, vectors, table = (tmp_path / f"{n}.csv" for n in ("values", "vectors", "table"))
    values.write_text("# friction of a trial\n0.1\n0.25\n\n0.3\n")
    vectors.write_text("x,y,z\n0.1,0.2,0.3\n0.4,0.5,0.6\n")
    table.write_text("friction.coefficient,body_b.com[2],method\n0.1,0.01,impulse\n0.2,0.02,auto\n")
    mu = read_axis(f"friction.coefficient=@{values}")["friction.coefficient"]
    assert mu.tolist() == [0.1, 0.25, 0.3]
    assert read_axis(f"body_b.com=@{vectors}")["body_b.com[1]"].tolist() == [0.2, 0.5]
    rows = combine([read_axis(f"@{table}")])
    assert rows.row(1) == {"friction.coefficient": 0.2, "body_b.com[2]": 0.02, "method": "auto"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("friction.coeficient=1,2", "no such parameter; did you mean friction.coefficient?"),
        ("friction.coefficient=0.3", "does not vary; give a fixed value with --set"),
        ("friction.coefficient=0.3:0.3:5", "does not vary"),
        ("friction.coefficient=0.1:0.3", "needs --sample N"),
        ("friction.coefficient=0:1:5:log", r"both > 0"),
        ("friction.coefficient=0.1,a", "friction.coefficient = 'a': must be a number"),
        ("friction.coefficient=[1,2],[3,4]", "must be a number"),
        ("friction.coefficient[0]=1,2", "no such component"),
        ("body_b.com[3]=1,2", "no such component"),
        ("body_b.com=[1,2],3", "vectors of one length"),
        ("friction.coefficient=@none.csv", "none.csv: No such file"),
        ("friction.coefficient", "must be NAME=VALUES"),
    ],
)
def test_a_text_that_is_no_axis(text: str, message: str) -> None:
    with pytest.raises(StudyError, match=message.replace("[", r"\[").replace("?", r"\?")):
        read_axis(text)


def test_a_parameter_is_varied_once() -> None:
    with pytest.raises(StudyError, match=r"body_b.com\[1\]: is varied twice"):
        combine([read_axis("body_b.com=[1,2,3],[4,5,6]"), read_axis("body_b.com[1]=1,2")])
    with pytest.raises(StudyError, match="varied twice"):
        combine([read_axis("period=1,2"), read_axis("period=1,2")])


def test_a_sample_has_its_distributions_and_correlations() -> None:
    texts = ("friction.coefficient=normal:0.2:0.02", "body_b.mass=normal:2:0.1", "period=1e-4:1e-3")
    found = dict(map(read_distribution, texts))
    pair = read_correlation("friction.coefficient, body_b.mass=-0.7")
    rows = sample(found, 4096, correlations=[pair], design="sobol", seed=3)
    mu, mass, period = rows.values()
    assert mu.mean() == pytest.approx(0.2, rel=1e-3)
    assert mu.std() == pytest.approx(0.02, rel=1e-2)
    assert mass.std() == pytest.approx(0.1, rel=1e-2)
    assert np.corrcoef(mu, mass)[0, 1] == pytest.approx(-0.7, abs=0.01)
    assert abs(np.corrcoef(mu, period)[0, 1]) < 0.01
    assert [period.min(), period.max()] == pytest.approx([1e-4, 1e-3], rel=1e-2)


@pytest.mark.parametrize("design", ["latin", "sobol", "random"])
def test_the_same_seed_gives_the_same_points(design: str) -> None:
    found = {"period": Distribution("lognormal", (0.01, 0.5), 0.005, 0.02)}
    one, two, other = (sample(found, 100, design=design, seed=s)["period"] for s in (1, 1, 2))
    assert one.tolist() == two.tolist()
    assert one.tolist() != other.tolist()
    assert one.min() >= 0.005
    assert one.max() <= 0.02


def test_a_latin_hypercube_has_one_point_in_every_row() -> None:
    points = sample({"period": Distribution("uniform", (0.0, 1.0))}, 50)["period"]
    assert sorted(np.floor(points * 50).astype(int).tolist()) == list(range(50))


@pytest.mark.parametrize(
    "text",
    [
        "period=normal:1:0", "period=normal:1", "period=uniform:2:1", "period=lognormal:-1:1",
        "period=triangular:1:0:2", "period=odd:1:2", "period=normal:1:1:3:2",
        "period=uniform:1:2:3",
        "period=normal:1:.inf", "body_b.com=normal:1:1", "method=normal:1:1",
    ],
)  # fmt: skip
def test_a_text_that_is_no_distribution(text: str) -> None:
    with pytest.raises(StudyError, match=r"must be NAME=KIND|needs a number"):
        read_distribution(text)


def test_correlations_that_contradict_each_other() -> None:
    found = {n: Distribution("normal", (0.0, 1.0)) for n in ("period", "body_b.mass", "latency")}
    pairs = [("period", "body_b.mass", 0.9), ("period", "latency", 0.9)]
    with pytest.raises(StudyError, match="contradict"):
        sample(found, 9, correlations=[*pairs, ("body_b.mass", "latency", -0.9)])
    with pytest.raises(StudyError, match=r"friction\.radius: has no distribution"):
        sample(found, 9, correlations=[("period", "friction.radius", 0.5)])
    with pytest.raises(StudyError, match="-1 < R < 1"):
        read_correlation("period,latency=1")
