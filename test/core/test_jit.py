"""Compiled code and plain Python compute the same; compiled code is cached."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from scenes import about_y, bundled, pair, sleeve

from cylconn_ros.connector import batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import jit, layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

SAMPLES = 120
FRICTION = {"coefficient": 0.3, "radius": 0.02, "overlap": 0.05, "preload": 5.0}
TABLE = {"rates": [0.0, 0.1, 1.0], "forces": [0.0, 50.0], "values": [0.4, 0.3, 0.3, 0.2, 0.2, 0.1]}
PENALTY = {"stiffness": 2e4, "damping": 40.0}


def scenes() -> dict[str, Scene]:
    """Methods, friction laws, forms of the held wrench, one and two free bodies."""
    decaying = {**FRICTION, "static_coefficient": 0.5, "decay": 10.0}
    tabled = {"radius": 0.02, "overlap": 0.05, "preload": 5.0, "table": TABLE}
    moving: dict[str, Any] = {
        "v": 0.5,
        "spin": 20.0,
        "shaft": about_y(0.2),
        "com": (0.0, 0.02, 0.0),
    }
    return {
        "demo": bundled("demo"),
        "two bodies": pair(friction=FRICTION),
        "springs": pair(elasticity={"k1": 500.0}, damping={"cr1": 0.01}, friction=FRICTION),
        "held in body axes": pair(wrench={"hold": "body", "point": "com"}, friction=FRICTION),
        "semi-implicit": pair(plant_integration="semi_implicit", friction=FRICTION),
        "limited": pair(limits={"force": 2.0, "torque": 0.5}, friction=FRICTION),
        "frictionless": sleeve(**moving),
        "decaying coefficient": sleeve(**moving, friction=decaying),
        "table": sleeve(**moving, friction=tabled),
        "comes to rest": sleeve(v=0.05, spin=1.0, friction={**FRICTION, "coefficient": 0.5}),
        "penalty": sleeve(**moving, method="penalty", friction=FRICTION, penalty=PENALTY),
    }


def outputs(scene: Scene) -> tuple[Any, Any, Any]:
    """(N, NOUT) outputs, (N, 26) states and (N,) energies of the closed loop of ``scene``."""
    run = simulate(scene, samples=SAMPLES)
    samples = np.zeros((SAMPLES, layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    samples[40, 3] = np.nan  # refused
    return Connector(scene).run(samples), run.states, run.energy


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Outputs of the same source as plain Python, computed in a separate process."""
    path = tmp_path_factory.mktemp("plain") / "outputs.npz"
    child(f"import test_jit; test_jit.save({str(path)!r})", CYLCONN_NO_COMPILER="1")
    with np.load(path) as saved:
        yield saved


def save(path: str) -> None:
    """Write the outputs for all scenes."""
    assert not jit.COMPILED
    arrays = {}
    for name, scene in scenes().items():
        for part, array in zip(("outs", "states", "energy"), outputs(scene), strict=True):
            arrays[f"{name} {part}"] = array
    np.savez(path, **arrays)


def child(code: str, **environment: str) -> str:
    """The output of ``code`` in a separate process."""
    tests = Path(__file__).resolve().parent
    paths = os.pathsep.join([str(tests.parent), str(tests), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_tests_run_compiled() -> None:
    assert jit.COMPILED


@pytest.mark.parametrize("name", list(scenes()))
def test_plain_python_computes_the_same(name: str, plain: Any) -> None:
    for part, got in zip(("outs", "states", "energy"), outputs(scenes()[name]), strict=True):
        want = plain[f"{name} {part}"]
        scale = np.abs(want).max(axis=0)
        if part == "outs":
            scale[layout.RESIDUAL] = 1.0  # itself a rounding error
        assert np.all(np.abs(got - want) <= 1e-11 * scale + 1e-15), part
        if part == "outs":
            assert want[40, layout.STATUS] == layout.NOT_FINITE


def test_compiled_code_is_loaded_by_the_next_process() -> None:
    connector = Connector(bundled("demo"))
    connector.step(np.zeros(layout.NSAMPLE))
    code = (
        "import numpy as np; from scenes import bundled;"
        "from cylconn_ros.connector.connector import Connector;"
        "from cylconn_ros.core import layout; from cylconn_ros.connector import batch;"
        "Connector(bundled('demo')).step(np.zeros(layout.NSAMPLE));"
        "print(sum(batch.step.stats.cache_hits.values()), len(batch.step.stats.cache_misses))"
    )
    assert child(code).split() == ["1", "0"]


def test_a_kernel_is_compiled_for_one_signature() -> None:
    samples, outs = np.zeros((2, layout.NSAMPLE)), np.zeros((2, layout.NOUT))
    connector = Connector(bundled("demo"))
    connector.step(samples[0])
    connector.step(samples[1], out=outs[1])
    connector.step(np.zeros(layout.NSAMPLE), h=1e-3)
    assert len(batch.step.signatures) == 1  # type: ignore[attr-defined]


def test_a_change_of_device_functions_changes_the_digest(tmp_path: Path) -> None:
    device = "from cylconn_ros.core.jit import device_function\n"
    sources = {
        "core/constants.py": "x = 1\n",  # imported by a module with device functions
        "methods/a.py": device + "from cylconn_ros.core import constants\n",
        "recording/kernels.py": device,
        "scene/other.py": "x = 1\n",  # no device functions
    }
    for name, text in sources.items():
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
    before = jit.digest(tmp_path)
    assert jit.digest(tmp_path) == before
    for name, text in sources.items():  # also if the kernel's own file is the same
        (tmp_path / name).write_text(f"{text}y = 2\n")
        assert (jit.digest(tmp_path) == before) == (name == "scene/other.py"), name
        (tmp_path / name).write_text(text)
    (tmp_path / "core" / "b.py").write_text(device)
    assert jit.digest(tmp_path) != before


@pytest.mark.parametrize("variable", ["CYLCONN_CACHE_DIR", "XDG_CACHE_HOME"])
def test_the_environment_sets_the_cache_directory(
    variable: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CYLCONN_CACHE_DIR", raising=False)
    monkeypatch.setenv(variable, str(tmp_path))
    assert Path(jit.cache_directory()).is_relative_to(tmp_path)
    assert Path(jit.cache_directory()).is_dir()


def test_the_cache_falls_back_to_the_temporary_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "file"
    file.write_text("a file: no directory can be created below it")
    monkeypatch.setenv("CYLCONN_CACHE_DIR", str(file))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert Path(jit.cache_directory()).parent.parent == tmp_path
    monkeypatch.setattr(tempfile, "tempdir", str(file))
    monkeypatch.setattr(jit, "_SHARED_MEMORY", str(tmp_path / "shm"))
    assert Path(jit.cache_directory()).parent.parent == tmp_path / "shm"
    monkeypatch.setattr(jit, "_SHARED_MEMORY", str(file))
    assert jit.cache_directory() == ""


def test_other_packages_keep_their_cache() -> None:
    theirs: str = numba.config.CACHE_DIR
    assert theirs == os.environ.get("NUMBA_CACHE_DIR", "")
