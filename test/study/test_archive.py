"""Archives: finding recordings, a row a recording, comparison with an earlier result."""

import re
import shutil
from pathlib import Path

import pytest
from paths import ROOT

from cylconn_ros.cli.main import main
from cylconn_ros.errors import StudyError
from cylconn_ros.study.archive.bags import find_bags
from cylconn_ros.study.dataset import Dataset

GOLDEN = ROOT / "bags"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An archive with two recordings and, between them by name, a file that is none."""
    found = tmp_path / "recordings"
    shutil.copytree(GOLDEN / "jam", found / "deep" / "a_jam")
    shutil.copytree(GOLDEN / "two_free_bodies", found / "z_two")
    (found / "broken.mcap").write_bytes(b"\x89MCAP0\r\n and then nothing of use")
    return found


def rows(address: Path) -> list[dict[str, object]]:
    found: list[dict[str, object]] = Dataset.existing(address).table().to_pylist()
    return found


def test_recordings_are_found(folder: Path, tmp_path: Path, monkeypatch) -> None:
    names = ["broken.mcap", "deep/a_jam", "z_two"]
    found = find_bags([str(folder)])
    assert found.columns["bag"].tolist() == names
    assert found.row(2)["path"] == str(folder / "z_two")
    assert found.row(2)["bytes"] == sum(f.stat().st_size for f in (folder / "z_two").iterdir())
    manifest = folder / "list.txt"
    manifest.write_text(f"# tonight\nz_two\n\n{folder}/deep/a_jam\n")
    assert find_bags([f"@{manifest}"]).columns["bag"].tolist() == [f"{folder}/deep/a_jam", "z_two"]
    assert len(find_bags([str(folder), str(folder / "z_two")])) == 3  # each once
    assert len(find_bags([f"{folder}/*/a_*"])) == 1
    monkeypatch.chdir(folder)
    assert find_bags(["**/a_*"]).columns["bag"].tolist() == ["deep/a_jam"]
    shutil.copytree(folder / "z_two", tmp_path / "other" / "z_two")
    two = find_bags([str(folder), str(tmp_path / "other")]).columns
    assert two["bag"].tolist() == two["path"].tolist()  # one name, two recordings
    for text in ("no_such", "no_such/*", f"@{folder}/none.txt", str(tmp_path / "other" / "*.mcap")):
        with pytest.raises(StudyError, match=re.escape(text.lstrip("@"))):
            find_bags([text])


def test_an_unreadable_recording_is_a_row(folder: Path, tmp_path: Path, capsys) -> None:
    output = tmp_path / "out"
    command = ["archive", "laws", str(folder), "-o", str(output), "--workers", "1"]
    assert main(command) == 1
    broken, jam, two = rows(output)
    assert (broken["status"], broken["passed"]) == ("failed", None)
    assert "broken.mcap" in str(broken["error"])
    for row in (jam, two):
        assert (row["status"], row["passed"], row["violated"]) == ("ok", True, "")
        assert 0.0 <= float(str(row["worst_residual"])) < 1e-12
    printed = capsys.readouterr().out
    assert "passed      2 of 3" in printed
    assert "FAILED    broken.mcap" in printed
    page = (output / "page.html").read_text()
    assert "2 of 3 recordings passed" in page
    assert main(command) == 1
    assert "recordings  0 in 0 s, 3 were there before" in capsys.readouterr().out


def test_changed_outputs_are_listed(folder: Path, tmp_path: Path, capsys) -> None:
    (folder / "broken.mcap").unlink()

    def replay(name: str, *options: str) -> int:
        output = str(tmp_path / name)
        return main(["archive", "replay", str(folder), "-o", output, "--workers", "1", *options])

    first = str(tmp_path / "first")
    assert replay("first") == 0
    for row in rows(tmp_path / "first"):
        assert (row["passed"], row["different"], row["problem"]) == (True, 0, "")
        assert int(str(row["compared"])) >= 3 * int(str(row["samples"]))
    assert replay("same", "--against", first) == 0
    assert "0 recordings changed, 0 new" in capsys.readouterr().out
    assert replay("other", "--against", first, "--set", "friction.coefficient=0.31") == 1
    printed = capsys.readouterr().out
    assert "against     " in printed
    assert "2 recordings changed" in printed
    assert "CHANGED   z_two: digest was " in printed
    shutil.rmtree(folder / "z_two")
    shutil.copytree(GOLDEN / "jam", folder / "new")
    assert replay("fewer", "--against", first) == 1
    printed = capsys.readouterr().out
    assert "CHANGED   z_two: present before, missing now" in printed
    assert "1 recordings changed, 1 new" in printed


def test_results_of_another_command_are_not_compared(folder: Path, tmp_path: Path, capsys) -> None:
    (folder / "broken.mcap").unlink()
    one, two = str(tmp_path / "one"), str(tmp_path / "two")
    assert main(["archive", "info", str(folder), "-o", one, "--workers", "1"]) == 0
    info = rows(tmp_path / "one")
    assert info[1]["flag jammed"] == 0
    assert int(str(info[0]["flag jammed"])) > 0
    command = ["archive", "identify", str(folder), "-o", two, "--workers", "1", "--against", one]
    assert main(command) == 2
    assert "holds results of 'archive info'" in capsys.readouterr().err
    assert main(["archive", "laws", str(folder), "-o", one]) == 2
    assert "holds another study; " in capsys.readouterr().err


def test_recordings_of_an_object_store(folder: Path, tmp_path: Path) -> None:
    import fsspec

    fsspec.filesystem("memory").put(str(folder / "z_two"), "/store/z_two", recursive=True)
    output = tmp_path / "out"
    assert main(["archive", "info", "memory://store", "-o", str(output), "--workers", "1"]) == 0
    (row,) = rows(output)
    assert (row["bag"], row["passed"]) == ("z_two", True)
