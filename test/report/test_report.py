"""Report of a run: decimated data of the page, notes, terminal output."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from odometry_bag import odometry_bag
from paths import BAGS

from cylconn_ros.cli.main import main
from cylconn_ros.cli.report import facts, sources
from cylconn_ros.connector.summary import FIELDS, RunSummary, summarise
from cylconn_ros.core.layout import STATE_FIELDS
from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.report import decimate, gather, page, payload
from cylconn_ros.report.panels import PANELS, States
from cylconn_ros.report.sparkline import regime_strip, sparkline
from cylconn_ros.scene.scene import shipped

KINDS = {"f4": np.float32, "f8": np.float64, "u1": np.uint8, "u4": np.uint32}


@pytest.fixture(scope="module")
def recording(demo_recording: Path) -> Path:
    return demo_recording


@pytest.fixture(scope="module")
def run(recording: Path) -> Run:
    return read_run(recording)


@pytest.fixture(scope="module")
def report(demo_report: Path) -> Path:
    return demo_report


class Packed:
    """The packed data of a page, decoded with its header."""

    def __init__(self, head: dict[str, Any], numbers: str) -> None:
        self.head = json.loads(json.dumps(head))
        self.data = zlib.decompress(base64.b64decode(numbers))

    def __call__(self, place: list[Any]) -> np.ndarray:
        kind, offset, count = place
        return np.frombuffer(self.data, KINDS[kind], count, offset)

    def curve(self, panel: str, label: str) -> list[np.ndarray]:
        (found,) = (p for p in self.head["panels"] if p["key"] == panel)
        (curve,) = (c for c in found["curves"] if c["label"] == label)
        return [self(place) for place in curve["drawn"]]


def noise_data(count: int) -> gather.RunData:
    """States of noise, with one peak of a single sample in each field."""
    random = np.random.default_rng(7)
    fields: dict[str, np.ndarray] = {}
    for name, width in STATE_FIELDS:
        values = random.normal(size=count if width == 1 else (count, width))
        values[int(0.7318 * count)] = 1e3
        values[int(0.2122 * count)] = -1e3
        fields[name] = values
    fields["regime"] = np.full(count, 2)
    fields["regime"][count // 3] = 1
    fields["flags"] = np.zeros(count, int)
    fields["flags"][count // 5] = 1 << 6
    for name in ("stop", "lock", "status"):
        fields[name] = np.zeros(count, int)
    fixed = np.array([[0.0, 0.0, 0.0, 1.0]])
    up = (0.0, 0.0, 1.0)
    geometry = gather.Geometry(
        fixed[:, :3], fixed, None, 0.02, 0.1, (np.nan, 1.0), (np.nan, 2.0), up
    )
    none = np.zeros(count, bool)
    states = States(fields, 0.02, 1.0)
    return gather.RunData(
        np.arange(count) * 1e-3, 0, none, lambda _: in_blocks(states), lambda _: geometry, 0.02
    )


def in_blocks(states: States) -> Iterator[States]:
    """Yield states block by block, as they are read from a file."""
    count = len(states("regime"))
    for at in range(0, count, 997):
        fields = {name: values[at : at + 997] for name, values in states.fields.items()}
        yield States(fields, states.radius, states.preload)


def states_of(found: gather.RunData) -> States:
    blocks = list(found.read_states(None))
    names = blocks[0].fields
    fields = {n: np.concatenate([block.fields[n] for block in blocks]) for n in names}
    return States(fields, blocks[0].radius, blocks[0].preload)


def geometry_of(found: gather.RunData) -> gather.Geometry:
    return found.geometry_at(np.arange(len(found.time)))


# Decimation


@pytest.mark.parametrize(("count", "buckets"), [(1000, 7), (13, 13), (5, 20), (1, 3)])
def test_a_bucket_has_the_extremes_of_its_samples(count: int, buckets: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    values[::4] = np.nan
    first = decimate.bucket_starts(count, buckets)
    low, high = decimate.extremes(values, first)
    parts = np.split(values, first[1:])
    assert len(parts) == min(count, buckets)
    assert all(len(part) for part in parts)
    for part, least, most in zip(parts, low, high, strict=True):
        finite = part[np.isfinite(part)]
        assert [least, most] == [finite.min(), finite.max()] if len(finite) else np.isnan(least)


def test_extreme_rows_contain_the_extremes_of_every_column() -> None:
    columns = np.random.default_rng(3).normal(size=(2, 5000))
    columns[0, 77] = np.nan
    first = decimate.bucket_starts(5000, 11)
    rows = decimate.extreme_rows(columns, first, 5000)
    assert len(rows) <= 11 * 5 + 1
    for start, end in zip(first, [*first[1:], 5000], strict=True):
        kept = rows[(rows >= start) & (rows < end)]
        for column in columns:
            assert np.nanmin(column[kept]) == np.nanmin(column[start:end])
            assert np.nanmax(column[kept]) == np.nanmax(column[start:end])


def test_bits_of_a_single_sample_are_kept() -> None:
    bits = np.zeros(1000, np.int64)
    bits[537] = 8
    assert decimate.bitwise_or(bits, decimate.bucket_starts(1000, 10)).tolist() == [
        0,
        0,
        0,
        0,
        0,
        8,
        0,
        0,
        0,
        0,
    ]


def test_the_page_contains_every_sample_of_a_short_run(run: Run) -> None:
    found = gather.gather(run)
    packed = Packed(*payload.build_payload(found))
    assert packed.head["whole"]
    state = run.state
    for panel, label, expected in (
        ("slide", "u₁", state["displacement"]),
        ("speed", "spin R ω₁", 0.02 * state["angular_velocity"][:, 0]),
        ("normal", "FN", state["normal_force"]),
        ("normal", "preload", state["normal_force"]),  # the top of the stack
        ("f1", "friction", state["force_friction"]),
        ("violation", "offset [mm]", state["offset_violation"] * 1e3),
    ):
        (drawn,) = packed.curve(panel, label)
        np.testing.assert_allclose(drawn, expected, rtol=1e-6)
    np.testing.assert_array_equal(packed(packed.head["time"]), state.time)
    regime = packed(packed.head["events"]["regime"]["bits"])
    np.testing.assert_array_equal(regime, 1 << state["regime"].astype(int))


def test_a_million_samples_keep_every_extreme_in_a_small_page() -> None:
    found = noise_data(1_000_000)
    head, numbers = payload.build_payload(found)
    packed = Packed(head, numbers)
    assert not head["whole"]
    assert len(numbers) + len(json.dumps(head)) < 8e6
    for panel, label, name, component in (
        ("slide", "u₁", "displacement", None),
        ("f1", "elastic", "force_elastic", None),
        ("across", "f₂", "force", 1),
    ):
        low, high = packed.curve(panel, label)
        assert len(low) == len(high) == payload.BUCKETS
        values = states_of(found)(name, component)
        np.testing.assert_array_equal(
            low,
            np.minimum.reduceat(values, decimate.bucket_starts(10**6, payload.BUCKETS)).astype(
                "f4"
            ),
        )
        assert (low.min(), high.max()) == (-1e3, 1e3)
    events = packed.head["events"]
    assert int((packed(events["regime"]["bits"]) & 2).sum()) == 2  # the single sample with stick
    assert int(packed(events["flags"]["bits"]).sum()) == 1 << 6
    path = packed.head["path"]
    assert packed(path["u1"]).max() == packed(path["f1"]).max() == 1e3
    assert len(packed(path["time"])) <= 9 * payload.PATH_BUCKETS + 1


def test_the_3d_view_has_the_positions_of_the_bodies(run: Run) -> None:
    found = gather.gather(run)
    geometry = geometry_of(found)
    state = run.state
    slot = gather.rotate(geometry.axes, np.array([1.0, 0.0, 0.0]))
    node_b = geometry.origin + state["length"][:, None] * slot
    # In the scene the mass centre is 2.1 mm off the axis and 1.2 mm beyond node b.
    assert geometry.centre is not None
    apart = np.linalg.norm(geometry.centre - node_b, axis=1)
    np.testing.assert_allclose(apart, np.hypot(1.2e-3, np.hypot(1.8e-3, 1.0e-3)), rtol=1e-3)
    assert (geometry.radius, geometry.overlap, geometry.up) == (0.02, 0.08, (0.0, 0.0, 1.0))


def test_poses_are_found_under_other_names_and_types(tmp_path: Path) -> None:
    odometry_bag(tmp_path / "bag", uneven=False)
    options = ["--params", str(shipped("demo")), "--remap", "body_b/odom:=/robot/sleeve"]
    options += ["--set", "input=odometry", "--set", "body_b.frame=sleeve"]
    assert main(["replay", str(tmp_path / "bag"), *options, "-o", str(tmp_path / "run")]) == 0
    found = gather.gather(read_run(tmp_path / "run"))
    geometry = geometry_of(found)
    centre = geometry.centre
    assert centre is not None
    slot = gather.rotate(geometry.axes, np.array([1.0, 0.0, 0.0]))
    node_b = geometry.origin + np.asarray(states_of(found)("length"))[:, None] * slot
    apart = np.linalg.norm(centre - node_b, axis=1)
    np.testing.assert_allclose(apart, np.hypot(1.2e-3, np.hypot(1.8e-3, 1.0e-3)), rtol=1e-3)


def test_stops_of_a_real_recording_are_shown() -> None:
    run = read_run(BAGS / "stop_impact")
    packed = Packed(*payload.build_payload(gather.gather(run)))
    stop = packed.head["events"]["stop"]
    np.testing.assert_array_equal(packed(stop["bits"]), run.state["stop"])
    assert set(packed(stop["bits"])) == {0, 1, 2}
    assert stop["names"][:2] == ["stop length min", "stop length max"]
    assert packed.head["geometry"]["stops"] == [0.0, 0.1]


def test_stops_of_the_spin_are_drawn_where_it_meets_them(tmp_path: Path) -> None:
    """The spin counts from the start, the stop is an angle: the door is let go at 80 degrees."""
    kept = tmp_path / "door"
    assert main(["simulate", "door_closer", "--duration", "0.01", "-o", str(kept)]) == 0
    packed = Packed(*payload.build_payload(gather.gather(read_run(kept))))
    assert packed.head["geometry"]["angle_stops"] == [0.0, None]
    turned = packed(packed.head["path"]["turned"])
    np.testing.assert_allclose(turned, -np.radians(80.0), rtol=1e-6)


def test_friction_by_direction_is_among_the_sources(tmp_path: Path) -> None:
    """Its coefficients replace the common one, which is not used."""
    kept = tmp_path / "ram"
    assert main(["simulate", "hydraulic_ram", "--duration", "0.01", "-o", str(kept)]) == 0
    run = read_run(kept)
    listed = dict(sources(run, gather.gather(run)))
    assert "friction.coefficient" not in listed
    assert listed["friction.coefficient_forward"] == "0.1"
    assert listed["friction.coefficient_backward"] == "0.25"
    assert listed["friction.offset_force"] == "15.0"


def test_a_shared_body_a_moves_in_the_report_of_a_connector(tmp_path: Path) -> None:
    """Its poses have the topic of the body's frame, which the recording states."""
    kept = tmp_path / "telescope"
    given = ["--period", "0.005", "--duration", "0.4"]
    assert main(["simulate", "telescope_of_two_stages", *given, "-o", str(kept)]) == 0
    found = gather.gather(read_run(kept).select("inner"))
    assert not [note for note in found.notes if "body A" in note]
    geometry = found.geometry_at(np.arange(len(found.time)))
    assert geometry.origin[0, 0] == 0.3
    assert geometry.origin[-1, 0] > 0.35
    centre = geometry.centre
    assert centre is not None
    slide = states_of(found)("length")
    np.testing.assert_allclose(centre[:, 0] - geometry.origin[:, 0], slide + 0.05, atol=1e-12)


def test_problems_of_the_samples_are_noted(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    state = run.state
    columns = dict(state.columns)
    nanosec = columns["header.stamp.nanosec"].copy()
    nanosec[10] = nanosec[9]  # a repeated stamp
    keep = np.r_[0:100, 150 : len(nanosec)]  # a gap
    columns = {name: values.copy()[keep] for name, values in columns.items()}
    columns["header.stamp.nanosec"] = nanosec[keep]
    columns["normal_force"][60] = np.nan
    table = type(state)(state.topic, state.type, keep, keep, columns, 3)
    broken = Run(run.source, run.metadata, {})
    broken.incomplete = "the end is missing"
    broken.types = {state.topic: state.type}
    monkeypatch.setattr(broken, "read_blocks", lambda *_, fields=None: iter([table]))
    found = gather.gather(broken)
    head, numbers = payload.build_payload(found)
    notes = " ".join(found.notes)
    assert "incomplete: the end is missing" in notes
    assert "Skipped: 3 states that cannot be decoded." in notes
    assert "Skipped: duplicate or non-monotonic stamps (samples: 1)." in notes
    assert "Gaps without samples: 1, 0.051 s" in notes
    assert "not finite (drawn blank): 1." in notes
    assert np.flatnonzero(found.gaps).tolist() == [99]
    (normal,) = Packed(head, numbers).curve("normal", "FN")
    assert np.flatnonzero(np.isnan(normal)).tolist() == [59]


def test_a_part_of_a_run(run: Run) -> None:
    found = gather.gather(run, 1.0, 1.5)
    assert (found.time[0], found.time[-1]) == (1.0, 1.5)
    assert "Shown: 1 to 1.5 s" in found.notes[0]
    with pytest.raises(RecordingError, match=r"no sample between 9 and inf s; it has 0 to 4 s"):
        gather.gather(run, 9.0)


def test_every_field_of_a_panel_is_in_the_message() -> None:
    found = noise_data(10)
    for panel in PANELS:
        for curve in panel.curves:
            assert curve.values(states_of(found)).shape == (10,), f"{panel.title}: {curve.label}"


def test_panels_that_are_zero_throughout_are_left_out_and_named() -> None:
    found = noise_data(100)
    (states,) = found.read_states(None)  # views of the arrays, one block
    fields = states.fields
    fields["rotation"][:], fields["displacement"][:] = 0.0, -1e-13  # the second: rounding errors
    fields["velocity"][:, 0] = 0.0
    head, _ = payload.build_payload(found)
    assert {"Slide u₁", "Spin uᵣ₁"} <= set(head["empty"])
    shown = {panel["key"]: panel for panel in head["panels"]}
    assert not {"slide", "spin"} & set(shown)
    assert len(shown["speed"]["curves"]) == 2  # zero beside a rate that is not


def test_forces_that_are_rounding_beside_others_are_left_out() -> None:
    """1e-10 N across the slot beside 1000 N along it; the other curve of the panel stays."""
    found = noise_data(100)
    (states,) = found.read_states(None)
    fields = states.fields
    fields["force"][:, 0] = 1e3
    fields["force"][:, 1], fields["force"][:, 2] = 1e-10, 5.0
    head, _ = payload.build_payload(found)
    (across,) = (panel for panel in head["panels"] if panel["key"] == "across")
    assert [curve["label"] for curve in across["curves"]] == ["f₃"]
    fields["force"][:, 2] = -1e-10
    head, _ = payload.build_payload(found)
    assert "Force across the slot" in head["empty"]


def test_texts_of_a_run_are_escaped() -> None:
    head, numbers = payload.build_payload(noise_data(20))
    evil = "</script><img src=x onerror=alert(1)>%%numbers%%"
    head["empty"] = [evil]
    text = page.render(evil, [page.Fact(evil, evil)], [evil], [(evil, evil)], evil, head, numbers)
    assert "<img" not in text
    template = (Path(page.__file__).parent / "static" / "page.html").read_text()
    assert text.count("</script>") == template.count("</script>") == template.count("<script")
    assert text.count(numbers) == 1


def test_the_page_has_no_external_references(report: Path) -> None:
    external = r"""(src|href)=["']?(?!data:)\w|url\(|@import|https?:|\bimport\b.*from|\bfetch\("""
    text = report.read_text()
    library = page.library()
    assert library in text
    # The library names addresses of its documentation and of namespaces, in texts alone: the
    # policy of the page forbids requests, and in a browser none is made.
    assert "default-src 'none'" in text
    assert re.search(external, text.replace(library, "")) is None


# In the terminal


def test_a_sparkline_shows_a_peak_of_one_sample() -> None:
    values = np.zeros(10_000)
    values[4321] = 1.0
    line = sparkline(values, 50)
    assert len(line) == 50
    assert line.index("█") == 21
    assert set(line) == {"▁", "█"}
    values[:300] = np.nan
    assert sparkline(values, 50).startswith(" ▁")
    assert sparkline(np.array([1e-9, 0.0, 1e-5, 1e-1]), 4, log=True) == "▁▁▅█"
    assert sparkline(np.zeros(3), 9) == "▁▁▁"
    assert sparkline(np.array([]), 9) == ""


def test_a_strip_marks_buckets_with_several_states() -> None:
    states = np.full(1000, 2)
    states[500:] = 1
    states[777] = 2
    assert regime_strip(states, ".#~", 10) == "~~~~~##/##"


def test_info_draws_the_course_of_a_run(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "90")
    assert main(["info", str(recording)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 40  # one screen
    (slide,) = (line for line in lines if line.startswith("slide "))
    assert re.search(r"▁▁?▂.*▆▇+█+  0 to 1\.447 m$", slide)
    assert any(re.search(r"^regime .*░+/?█+  █ stick, ░ slip$", line) for line in lines)
    assert all(len(line) <= 90 for line in lines[lines.index(slide) :])


# The command


def test_the_command_prints_file_and_notes(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "r.html"
    part = ["--from", "3", "--to", "3.25", "--title", "The last <metre>"]
    assert main(["report", str(recording), "-o", str(output), *part]) == 0
    printed = capsys.readouterr().out
    assert "251 samples: every sample" in printed
    assert "note        Shown: 3 to 3.25 s of 4 s." in printed
    text = output.read_text()
    assert "<title>The last &lt;metre&gt;</title>" in text
    assert "friction.coefficient: 0.2" in text
    assert main(["report", str(BAGS / "lossy"), "-o", str(output)]) == 0
    assert "duplicate or non-monotonic stamps (samples: 1)" in capsys.readouterr().out
    assert main(["report", str(recording), "-o", str(tmp_path / "r.pdf")]) == 2
    assert main(["report", str(recording), "-o", str(tmp_path / "no" / "r.html")]) == 2
    assert "No such file or directory" in capsys.readouterr().err


def test_a_recording_without_states_is_refused_with_the_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pose = TopicInfo("/body_b/pose", "geometry_msgs/msg/PoseStamped")
    with RunWriter(tmp_path / "inputs", [pose], {}):
        pass
    assert main(["report", str(tmp_path / "inputs")]) == 2
    error = capsys.readouterr().err
    assert "no states of a connector" in error
    assert f"cylconn replay {tmp_path / 'inputs'} --params SCENE.yaml -o RUN" in error


# Summary


def summary_of(regime: list[int], **changed: list[float]) -> RunSummary:
    count = len(regime)
    state = {name: np.zeros(count) for name in FIELDS} | {"stop_time": np.full(count, -1.0)}
    state["regime"] = np.array(regime)
    state |= {name: np.array(values) for name, values in changed.items()}
    return summarise((np.arange(count) * 0.1).astype(np.float64), state)


def test_rest_without_a_stop_time_begins_after_the_last_motion() -> None:
    assert summary_of([2, 2, 1, 1]).stop_time == pytest.approx(0.2)
    assert summary_of([1, 1]).stop_time == 0.0
    assert np.isnan(summary_of([1, 2]).stop_time)
    again = summary_of([2, 1, 2, 1], stop_time=[0.05, -1.0, -1.0, -1.0])
    assert again.stop_time == pytest.approx(0.3)  # not the stop before the last motion
    given = summary_of([2, 2, 1], stop_time=[-1.0, 0.04, -1.0])
    assert given.stop_time == pytest.approx(0.14)


def test_refused_samples_have_no_regime() -> None:
    found = summary_of([0, 0, 2, 2], status=[1, 1, 0, 0])
    assert found.regimes == {"slip": 0.5, "refused": 0.5}
    fields = {"regime": np.array([0.0, 0.0, 2.0]), "status": np.array([1.0, 1.0, 0.0])}
    bits = payload._bits(States(fields, 0.01))  # of the timeline
    assert bits["regime"].tolist() == [0, 0, 4]
    assert bits["status"].tolist() == [1, 1, 0]


def test_a_runaway_is_marked(run: Run) -> None:
    def marked(**changed: list[float]) -> set[str]:
        return {fact.label for fact in facts(summary_of([2], **changed), run) if fact.bad}

    assert marked() == set()
    assert marked(offset_violation=[0.5]) == {"run", "worst offset"}  # not usable
    assert marked(angular_violation=[np.nan]) == {"worst misalignment"}


def test_the_contact_is_shown_where_it_changes() -> None:
    """A panel and the drawn sleeve; older recordings have the scene's overlap."""
    packed = Packed(*payload.build_payload(noise_data(500)))
    assert any(panel["key"] == "contact" for panel in packed.head["panels"])
    for name in ("overlap", "middle"):
        assert len(packed(packed.head["path"][name])) == len(packed(packed.head["path"]["u1"]))
    old = gather.gather(read_run(BAGS / "jam"))
    assert set(states_of(old)("overlap").tolist()) == {0.08}
    assert not states_of(old)("contact_centre").any()
    head, _ = payload.build_payload(old)
    assert not any(panel["key"] == "contact" for panel in head["panels"])
