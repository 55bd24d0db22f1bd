"""The tutorials for what a user has: their commands run as they stand, in a folder of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from paths import ROOT

TUTORIALS = {  # pages, and what their commands print, which the text relies on
    "urdf": (
        "slip 100.0%",
        "normal force 40.0",
        "stick 100.0%",
        "normal force 92.0",
        "1 s simulated",
    ),
    "mujoco_model": ("6000 steps", "slide 0.3508", "connector: 0.0 mm", "frictionloss: 124"),
    "abaqus_deck": ("*DYNAMIC", "slide 0.0410", "with --set"),
    "recording": ("mu  ", "outputs identical"),
}
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.DOTALL | re.MULTILINE)
GREATEST = 300.0  # s, for a reader with a compiled cache


def blocks(name: str) -> list[str]:
    return BLOCK.findall((ROOT / "docs" / "tutorial" / f"{name}.md").read_text())


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder in which the files of a checkout are, and what the commands write is not in it."""
    for name in ("models", "bags", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


@pytest.mark.parametrize("name", TUTORIALS)
def test_the_commands_of_a_tutorial_run(name: str, checkout: Path) -> None:
    """In order, each with exit code 0, without a traceback and within five minutes."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "MPLBACKEND": "agg"}
    found, printed, begin = blocks(name), "", time.monotonic()
    assert found
    for commands in found:
        run = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", commands],
            cwd=checkout,
            env=environment,
            capture_output=True,
            text=True,
            timeout=600,
        )
        assert run.returncode == 0, f"{commands}\n{run.stdout}\n{run.stderr}"
        assert "Traceback" not in run.stderr, run.stderr
        printed += run.stdout + run.stderr
    assert time.monotonic() - begin < GREATEST
    assert [text for text in TUTORIALS[name] if text not in printed] == [], printed
