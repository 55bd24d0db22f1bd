"""The public Python API: complete, documented, light to import, and its examples run."""

import inspect
import subprocess
import sys
import textwrap

import pytest
from paths import CONFIG, ROOT

import cylconn_ros as cr


def examples(name: str) -> list[str]:
    """The code blocks behind `Example::` in a public name's docstring and in its methods'."""
    value = getattr(cr, name)
    texts = [value.__doc__ or ""]
    if inspect.isclass(value):
        texts += [one.__doc__ or "" for key, one in vars(value).items() if not key.startswith("_")]
    found = []
    for text in map(inspect.cleandoc, texts):
        for part in text.split("Example::\n")[1:]:
            lines = []
            for line in part.splitlines():
                if line and not line.startswith(" "):
                    break
                lines.append(line)
            found.append(textwrap.dedent("\n".join(lines)))
    return found


PUBLIC = [name for name in cr.__all__ if not name.endswith("Error")]


def test_every_public_name_is_there_and_listed() -> None:
    assert sorted(cr.__all__) == list(cr.__all__)
    assert set(cr.__all__) <= set(dir(cr))
    assert set(cr._MODULE_OF) == set(cr.__all__)
    for name in cr.__all__:
        assert inspect.getdoc(getattr(cr, name)), name
    with pytest.raises(AttributeError, match="simulat"):
        cr.simulat  # noqa: B018


def test_errors_have_one_base() -> None:
    for name in cr.__all__:
        if name.endswith("Error"):
            assert issubclass(getattr(cr, name), cr.CylconnError)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_has_an_example_that_runs(name, tmp_path, monkeypatch) -> None:
    blocks = examples(name)
    if name != "StepResult":  # its use is Connector's example
        assert blocks, f"{name}: no example"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bag").symlink_to(ROOT / "bags" / "two_free_bodies")
    (tmp_path / "drawer.yaml").symlink_to(CONFIG / "demo.yaml")
    for block in blocks:
        exec(block, {"cr": cr, "scene": cr.load(cr.shipped("coast"))})


def test_importing_the_package_imports_nothing_else_of_it() -> None:
    code = (
        "import sys; before = set(sys.modules); import cylconn_ros;"
        "print(*sorted(m for m in set(sys.modules) - before if '.' in m or m in "
        "('typing', 'numpy', 'numba', 'rclpy')))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert [m for m in run.stdout.split() if m.startswith(("cylconn_ros", "numpy", "numba"))] == []
    assert "rclpy" not in run.stdout
