"""The cache of compiled code: damaged files, directories that cannot be written, two processes."""

import functools
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from paths import ROOT

PHYSICS = """
from cylconn_ros.core.jit import c_function, device_function, is_ready, kernel

@device_function
def twice(x: float) -> float:
    return 2.0 * x

@kernel
def step(x: float) -> float:
    return twice(x) + 1.0

@c_function("float64(float64)")
def called(x):
    return twice(x) + 1.0

ready = is_ready(step), is_ready(called)
print(*ready, step(1.0), called.handle != 0, is_ready(step), is_ready(called))
"""
COMPILED = "False False 3.0 True True True"
LOADED = "True True 3.0 True True True"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A directory with a module of two kernels, and with their cache."""
    (tmp_path / "physics.py").write_text(PHYSICS)
    assert run(tmp_path) == (COMPILED, "")
    return tmp_path


def start(folder: Path, **environment: str) -> subprocess.Popen[str]:
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    given = {"CYLCONN_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": paths, **environment}
    return subprocess.Popen(
        [sys.executable, "-c", "import physics"],
        cwd=folder,
        env={**os.environ, **given},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(folder: Path, **environment: str) -> tuple[str, str]:
    """Standard output and standard error of a process that uses the kernels."""
    with start(folder, **environment) as process:
        out, err = process.communicate()
    assert process.returncode == 0, err
    return out.strip(), err.strip()


def files(folder: Path) -> list[Path]:
    return sorted((folder / "cache").rglob("*.kernel"))


def test_code_is_loaded_by_the_next_process(folder: Path) -> None:
    assert len(files(folder)) == 2
    assert run(folder) == (LOADED, "")


def test_a_change_of_the_source_makes_code_stale(folder: Path) -> None:
    (folder / "physics.py").write_text(PHYSICS.replace("1.0\n", "2.0\n"))
    assert run(folder)[0] == COMPILED.replace("3.0", "4.0")
    (folder / "physics.py").write_text(PHYSICS)  # the same content at another time
    assert run(folder) == (LOADED, "")


def flip(share: float, content: bytes) -> bytes:
    at = int(share * (len(content) - 1))
    return content[:at] + bytes([content[at] ^ 0x10]) + content[at + 1 :]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "half": lambda content: content[: len(content) // 2],
    "one byte short": lambda content: content[:-1],
    "another file": lambda content: b"# not compiled code\n" * 100,
    **{
        f"byte flipped at {share}": functools.partial(flip, share)
        for share in (0.0, 0.01, 0.3, 0.6, 1.0)
    },
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_code_is_reported_removed_and_compiled_again(damage: str, folder: Path) -> None:
    for path in files(folder):
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    out, err = run(folder)
    assert out == COMPILED
    lines = err.splitlines()
    assert len(lines) == len(files(folder)) == 2
    for path in files(folder):
        assert any(str(path) in line and "damaged" in line for line in lines), err
    assert run(folder) == (LOADED, "")


def test_code_that_cannot_be_loaded_is_compiled_again(folder: Path) -> None:
    """The checksum is right, but the content is of another kind."""
    write = "from cylconn_ros.core.kernel_cache import write_checked; from pathlib import Path; "
    for path in files(folder):
        code = f"{write}write_checked(Path({str(path)!r}), b'not a pickle')"
        subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
    out, err = run(folder)
    assert out.split()[2:] == COMPILED.split()[2:]
    assert err.count("damaged") == 2
    assert run(folder) == (LOADED, "")


def test_processes_that_compile_at_once_do_not_disturb_each_other(folder: Path) -> None:
    for path in files(folder):
        path.unlink()
    processes = [start(folder) for _ in range(4)]
    for process in processes:
        out, err = process.communicate()
        assert out.split()[2:] == COMPILED.split()[2:], err
        assert err == ""
    assert len(files(folder)) == 2
    assert not list((folder / "cache").rglob("*.tmp"))
    assert run(folder) == (LOADED, "")


def test_a_directory_that_cannot_be_written_is_reported_once(folder: Path) -> None:
    """The directory vanishes while the process runs: a file is in its place."""
    code = PHYSICS.replace(
        "ready =",
        "import pathlib, shutil\n"
        "from cylconn_ros.core import jit\n"
        "shutil.rmtree(jit.CACHE_DIRECTORY); pathlib.Path(jit.CACHE_DIRECTORY).touch()\n"
        "ready =",
    )
    (folder / "physics.py").write_text(code)
    out, err = run(folder)
    assert out == "False False 3.0 True True True"
    assert len(err.splitlines()) == 1
    assert "cannot be stored" in err
    assert "CYLCONN_CACHE_DIR" in err


def test_no_usable_directory_is_reported_once(folder: Path) -> None:
    code = PHYSICS.replace(
        "from cylconn_ros.core.jit import",
        "import os\n"
        "full = os.statvfs_result((4096, 4096, 1000, 0, 0, 1000, 1000, 1000, 0, 255))\n"
        "os.statvfs = lambda _: full\n"
        "from cylconn_ros.core.jit import",
        1,
    )
    (folder / "physics.py").write_text(code)
    out, err = run(folder)
    assert out == "False False 3.0 True True True"
    assert len(err.splitlines()) == 1
    assert "cannot be stored" in err
