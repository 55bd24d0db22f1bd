"""``cylconn bench all``: what is measured, kept, written and reported.

The benchmarks are replaced by a program that writes results, or does not.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from paths import ROOT, SOURCE

from cylconn_ros.bench.common import machine, report
from cylconn_ros.cli import bench_all, bench_parts, main
from cylconn_ros.cli.bench_parts import Part
from cylconn_ros.cli.benchmarks import BENCHMARKS

PROGRAM = """
import json, os, sys
from pathlib import Path
from cylconn_ros.bench.common.results import Findings, Measurement, NotMeasured, Report, Target
command, name, *options = sys.argv[1:]
output = Path(options[options.index("-o") + 1])
log = output.parent / "log"
log.write_text((log.read_text() if log.exists() else "") + name + "\\n")
told = json.loads((output.parent / "behaviour.json").read_text())
behaviour = told["behaviour"].get(name, "")
if behaviour == "crashes":
    os.abort()
words = ["cylconn bench", name, *options[: options.index("-o")]]
found = Findings([Target("fast", 2.0, 1.0, "us")], [Measurement("case", "node", "time", 1.5, "us")])
if behaviour == "fails":
    found.not_measured.append(NotMeasured("case", "peer", "failed", "out of order"))
print("measuring: it")
output.write_text(Report(" ".join(words), {}, found, told["machine"]).json())
"""
PARTS = (
    Part("kernel", "a.md", 1.0),
    Part("orders", "a.md", 1.0),
    Part("soak", "b.md", 1.0, ("--samples", "5")),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of results; pages stand in ``docs`` beside it."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    monkeypatch.setenv("PYTHONPATH", str(SOURCE.parent))
    monkeypatch.setattr(bench_all, "PARTS", PARTS)
    monkeypatch.setattr(
        bench_all,
        "module_command",
        lambda _, *arguments: [sys.executable, str(program), *arguments],
    )
    monkeypatch.setattr(bench_all, "BENCHMARKS", dict.fromkeys(BENCHMARKS, _benchmark))
    docs, run = tmp_path / "docs", tmp_path / "run"
    docs.mkdir()
    run.mkdir()
    (docs / "a.md").write_text(
        "".join(
            f"<!-- cylconn bench {name} -->\nold\n<!-- end -->\n" for name in ("kernel", "orders")
        )
    )
    (docs / "b.md").write_text(
        "<!-- cylconn bench soak -->\nlong\n<!-- end -->\n"
        "<!-- cylconn bench soak --samples 5 -->\nold\n<!-- end -->\n"
    )
    return run


def _benchmark() -> object:
    from cylconn_ros.cli.benchmarks import Benchmark

    return Benchmark(())


def run(folder: Path, *more: str, **behaviour: str) -> int:
    told = {"behaviour": behaviour, "machine": machine.describe()}
    (folder / "behaviour.json").write_text(json.dumps(told))
    return main.main(["bench", "all", "-o", str(folder), *more])


def measured(folder: Path) -> list[str]:
    log = folder / "log"
    names = log.read_text().split() if log.exists() else []
    log.unlink(missing_ok=True)
    return names


def test_every_page_has_the_results_with_their_kernel(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    docs = folder.parent / "docs"
    assert run(folder, "--document", str(docs)) == 0
    assert measured(folder) == ["kernel", "orders", "soak"]
    pages = "".join(page.read_text() for page in sorted(docs.iterdir()))
    assert "old" not in pages
    assert "\nlong\n" in pages, "results of the long form stay"
    blocks = report.blocks(pages)
    kernel = report.stated_kernel(machine.describe()["cylconn_ros"])
    for part in PARTS:
        assert report.stated_kernel(blocks[part.command]) == kernel
        assert f"made by `{part.command}`" in blocks[part.command]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["kernel"] == kernel
    assert [(one["part"], one["state"]) for one in manifest["parts"]] == [
        (part.name, "measured") for part in PARTS
    ]
    assert all(one["seconds"] > 0.0 for one in manifest["parts"])
    seen = capsys.readouterr()
    assert "part 1 of 3: kernel, " in seen.err
    assert " left" in seen.err
    assert "  measuring: it" in seen.err
    assert "target missed: soak: fast" in seen.out
    assert "next: look at the pages" in seen.err


def test_an_interrupted_run_continues(folder: Path) -> None:
    assert run(folder) == 0
    (folder / "orders.json").unlink()
    measured(folder)
    assert run(folder) == 0
    assert measured(folder) == ["orders"]
    states = {
        one["part"]: one for one in json.loads((folder / "manifest.json").read_text())["parts"]
    }
    assert states["kernel"]["state"] == "kept"
    assert states["kernel"]["seconds"] > 0.0, "the duration of its measurement"


def test_results_of_other_sources_are_measured_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(folder) == 0
    measured(folder)
    here = machine.describe()
    monkeypatch.setattr(machine, "describe", lambda: {**here, "cylconn_ros": "others"})
    assert run(folder) == 0
    assert measured(folder) == ["kernel", "orders", "soak"]
    assert len(list(folder.glob("kernel.*.json"))) == 1, "the old results stay"


def test_a_part_that_fails_loses_no_other_and_is_measured_again(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    docs = folder.parent / "docs"
    assert run(folder, "--document", str(docs), kernel="crashes", orders="fails") == 1
    seen = capsys.readouterr()
    assert "kernel         failed" in seen.out
    assert "exit code -6" in seen.out
    assert "peer: out of order" in seen.out
    assert "next: the same command measures again" in seen.err
    page = (docs / "a.md").read_text()
    assert page.count("old") == 1, "what could be measured of orders is in the page"
    assert "old" not in (docs / "b.md").read_text()
    assert measured(folder) == ["kernel", "orders", "soak"]
    assert run(folder, "--document", str(docs)) == 0
    assert measured(folder) == ["kernel", "orders"]


def test_kept_results_are_documented_without_measuring(folder: Path) -> None:
    docs = folder.parent / "docs"
    assert run(folder) == 0
    measured(folder)
    arguments = ["bench", "all", "--from", str(folder), "--document", str(docs)]
    assert main.main(arguments) == 0
    assert measured(folder) == []
    assert "| fast" in (docs / "b.md").read_text()
    assert main.main([*arguments, "--strict"]) == 1, "a target is missed"


def test_a_page_without_a_place_is_an_error_before_measuring(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    docs = folder.parent / "docs"
    (docs / "b.md").write_text("nothing")
    assert run(folder, "--document", str(docs)) == main.USAGE_ERROR
    assert "b.md" in capsys.readouterr().err
    assert run(folder, "--quick", "--document", str(docs)) == main.USAGE_ERROR
    assert measured(folder) == []


def test_a_run_anew_has_a_folder_of_its_own(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert run(folder, "--anew") == main.USAGE_ERROR
    made = []
    for more in ([], [], ["--anew"], []):
        options = main.parser().parse_args(["bench", "all", *more])
        made.append(bench_all._folder(options))
        made[-1].mkdir(parents=True, exist_ok=True)
    assert made[0] == made[1]
    assert made[2] == made[3] == Path(f"{made[0]}.2")


# --- the table of parts ---


def test_every_benchmark_is_a_part_with_a_place_in_the_pages() -> None:
    assert {part.name for part in bench_parts.PARTS} == set(BENCHMARKS)
    assert sum(part.minutes for part in bench_parts.PARTS) <= 40.0
    for part in bench_parts.PARTS:
        blocks = report.blocks((ROOT / "docs" / part.page).read_text())
        assert part.command in blocks, (part.page, part.command)
        if part.name in bench_parts.LONG:
            assert part.options
            assert f"cylconn bench {part.name}" in blocks, "the long form has a place of its own"
