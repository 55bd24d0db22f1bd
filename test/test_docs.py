"""The pages: links resolve, Python examples run, and the site builds without warnings."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT, SOURCE

import cylconn_ros
from cylconn_ros.cli.main import COMMANDS
from cylconn_ros.connector.outputs import DERIVED

DOCS = ROOT / "docs"
PAGES = [
    *sorted(DOCS.rglob("*.md")),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "bags/README.md")),
]
README_LINES = 120

FENCE = re.compile(r"^( *)(```+)([^\n]*)\n(.*?)^\1\2 *$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^()\s]+)\)")
SOURCE_FILE = re.compile(r"`((?:\w+/)+\w+\.(?:py|msg|yaml|xml|json))`")
HEADING = re.compile(r"^#{1,6} +(.+?) *$", re.MULTILINE)
EXTERNAL_FILE = re.compile(r"<(?:script|link|img)\b[^>]*?(?:src|href)=\"(?:https?:)?//[^\"]*\"")


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def prose(page: Path) -> str:
    """The page without its code blocks."""
    return FENCE.sub("", page.read_text())


def anchors(page: Path) -> set[str]:
    """Anchors of the headings, as GitHub and MyST form them."""
    found = set()
    for heading in HEADING.findall(prose(page)):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").lower()
        found.add(re.sub(r"[^\w\- ]", "", text).replace(" ", "-"))
    return found


def python_blocks(page: Path) -> list[str]:
    return [
        code
        for _, _, language, code in FENCE.findall(page.read_text())
        if language.strip() == "python"
    ]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_internal_link_resolves(page: Path) -> None:
    for target in LINK.findall(prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{name(page)}: {target}"
        if anchor:
            assert anchor in anchors(file), f"{name(page)}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_source_file_that_is_named_exists(page: Path) -> None:
    for path in SOURCE_FILE.findall(prose(page)):
        if "NAME" not in path:
            assert any((base / path).exists() for base in (SOURCE, ROOT)), f"{name(page)}: {path}"


def test_a_broken_anchor_would_be_seen() -> None:
    found = anchors(DOCS / "explanation" / "equations.md")
    assert "unknown-inertia" in found
    assert "no-such-heading" not in found


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the examples name: a recorded run, a bag and scene files."""
    recorded = ROOT / "bags" / "slide_and_spin"
    shutil.copytree(recorded, tmp_path / "runs" / "connector_20260101T120000")
    shutil.copytree(recorded, tmp_path / "bag")
    for scene in ("joint.yaml", "my_scene.yaml"):
        shutil.copy(ROOT / "config" / "slide_and_spin.yaml", tmp_path / scene)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", [page for page in PAGES if python_blocks(page)], ids=name)
def test_the_python_examples_of_a_page_run(page: Path, workspace: Path) -> None:
    """The blocks of a page run in their order and share their names, as a reader types them."""
    names: dict[str, object] = {"__name__": "example"}
    for code in python_blocks(page):
        exec(compile(code, name(page), "exec"), names)


def test_the_readme_is_short_and_has_a_python_example() -> None:
    lines = (ROOT / "README.md").read_text().splitlines()
    assert len(lines) <= README_LINES
    assert python_blocks(ROOT / "README.md")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site built as ``make docs`` builds it: a warning is an error."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    built = subprocess.run(
        [*command, "-d", folder / "doctrees", DOCS, folder / "html"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert built.returncode == 0, built.stderr
    return folder / "html"


def test_the_site_has_every_page(site: Path) -> None:
    for page in DOCS.rglob("*.md"):
        assert (site / page.relative_to(DOCS).with_suffix(".html")).is_file(), name(page)


def test_the_site_needs_no_network(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not EXTERNAL_FILE.search(page.read_text()), page.name


def test_the_generated_reference_is_complete(site: Path) -> None:
    messages = (site / "reference" / "messages.html").read_text()
    for line in (ROOT / "msg" / "ConnectorState.msg").read_text().splitlines():
        declaration = line.partition("#")[0].split()
        if declaration:
            assert declaration[1] in messages, declaration
    commands = (site / "reference" / "commands.html").read_text()
    for command in COMMANDS:
        assert f"usage: cylconn {command}" in re.sub("<[^>]*>", "", commands), command
    python = (site / "reference" / "python.html").read_text()
    for public in cylconn_ros.__all__:
        assert f'id="cylconn_ros.{public}"' in python, public
    for name in ("mujoco.Friction", "mujoco.bound_unyielding", "mechanism.Friction"):
        assert f'id="cylconn_ros.{name}"' in python, name


def test_the_glossary_has_every_field_of_the_state_and_the_accelerations() -> None:
    """In the first column of its table, with the unit that the message states."""
    page = (DOCS / "reference/glossary.md").read_text()
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| `")]
    named = {field: row[2] for row in rows for field in re.findall(r"`(\w+)`", row[1])}
    text = (ROOT / "msg/ConnectorState.msg").read_text()
    fields = re.findall(
        r"^(?:float64(?:\[\d\])?|uint8|uint32|string) (\w+)(?!\w*=) *(?:# *(\S*))?", text, re.M
    )
    assert len(fields) > 40
    for field, unit in fields:
        assert field in named, field
        if unit in ("m", "rad", "m/s", "rad/s", "J", "s"):
            assert unit in named[field], field
    assert set(DERIVED) <= set(named)
