"""Digests of the sources: what changes them and what does not."""

from __future__ import annotations

from pathlib import Path

import pytest
from paths import SOURCE

from cylconn_ros.bench.common import sources

BEFORE = '''"""A law."""

# The limit of a step.
LIMIT = 1e-3
"""m, of the motion."""


def force(x, *, k=2.0):
    """Force, N."""
    return k * x if abs(x) < LIMIT else 0.0
'''


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("A law.", "Another text"),
        ('"""A law."""', ""),
        ("# The limit of a step.", "# Half of it."),
        ('"""m, of the motion."""\n', ""),
        ('    """Force, N."""\n', ""),
        ("abs(x) < LIMIT", "(abs(x)\n        < LIMIT)"),
        ("1e-3", "0.001"),
    ],
)
def test_wording_and_layout_do_not_count(old: str, new: str) -> None:
    assert old in BEFORE
    changed = BEFORE.replace(old, new)
    assert sources.of_source(changed) == sources.of_source(BEFORE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("1e-3", "1.1e-3"),
        ("2.0", "2"),  # an integer is compiled as another type
        ("<", "<="),
        ("k * x", "x * k"),
        ("abs(x)", "abs(k)"),
        ("*, k", "k"),
        ("0.0", "'0.0'"),
        ("LIMIT = ", "LIMIT: float = "),
        ("LIMIT", "MOST"),
    ],
)
def test_code_counts(old: str, new: str) -> None:
    assert old in BEFORE
    assert sources.of_source(BEFORE.replace(old, new)) != sources.of_source(BEFORE)


def test_a_text_that_is_used_counts() -> None:
    assert sources.of_source("name = 'a'") != sources.of_source("name = 'b'")
    assert sources.of_source("f('a')") != sources.of_source("f('b')")


def test_files_their_names_and_folders_count(tmp_path: Path) -> None:
    (tmp_path / "core" / "inner").mkdir(parents=True)
    (tmp_path / "core" / "law.py").write_text("A = 1\n")
    (tmp_path / "one.py").write_text("B = 1\n")
    (tmp_path / "other.py").write_text("C = 1\n")
    names = ("core", "one.py")
    seen = [sources.digest(names, tmp_path)]
    (tmp_path / "other.py").write_text("C = 2\n")
    assert sources.digest(names, tmp_path) == seen[0], "it is not among the names"
    for change in (
        lambda: (tmp_path / "core" / "inner" / "events.py").write_text("E = 1\n"),
        lambda: (tmp_path / "one.py").write_text("B = 22\n"),
        lambda: (tmp_path / "core" / "law.py").rename(tmp_path / "core" / "laws.py"),
    ):
        change()
        assert sources.digest(names, tmp_path) not in seen
        seen.append(sources.digest(names, tmp_path))
    with pytest.raises(FileNotFoundError, match=r"two\.py"):
        sources.digest(("two.py",), tmp_path)


def test_the_kernel_is_part_of_what_is_measured() -> None:
    for name in sources.KERNEL:
        assert name.split("/")[0] in sources.MEASURED
        assert (SOURCE / name).exists()
    assert len(sources.kernel()) == sources.DIGITS
    assert sources.kernel() != sources.measured()
