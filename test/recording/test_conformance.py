"""The script that reads the format's conformance files tells right from wrong ones."""

import importlib
import json
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer
from paths import ROOT


def pair(folder: Path, content: list[int]) -> Path:
    """A file with one message, and its description in which the message has ``content``."""
    path = folder / "one.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_message(writer.register_channel("t", "a", 0), 5, bytes([1, 2]), 4)
        writer.finish()

    def record(kind: str, **fields: Any) -> dict[str, Any]:
        return {"type": kind, "fields": list(fields.items())}

    records = [
        record("Channel", id="1", topic="t", message_encoding="a"),
        record("Message", channel_id="1", log_time="5", publish_time="4",
               data=[str(k) for k in content]),
    ]  # fmt: skip
    path.with_suffix(".json").write_text(json.dumps({"records": records}))
    return path


def test_right_and_wrong_files_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    conformance = importlib.import_module("conformance")
    monkeypatch.setattr("sys.argv", ["conformance.py", str(tmp_path)])
    assert conformance.main() == 2
    path = pair(tmp_path, [1, 2])
    assert list(conformance.answers(path)) == []
    assert conformance.main() == 0
    assert "1 of 1 files pass" in capsys.readouterr().out
    pair(tmp_path, [1, 3])
    assert conformance.main() == 1
    assert "differ from the 1 expected" in capsys.readouterr().out
    path.write_bytes(path.read_bytes()[:-20])
    assert "called unfinished" in list(conformance.faults(path))
