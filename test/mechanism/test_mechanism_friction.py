"""Friction inside a mechanism, from arrays: examples, against the connector, and MuJoCo's arm."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paths import ROOT

import cylconn_ros as cr
from cylconn_ros.mechanism.reaction import RigidBodies

BEARING = cr.Friction(coefficient=0.2, radius=0.01, overlap=0.1)
G = 9.81


def test_a_block_on_a_level_guide() -> None:
    """The example of the class: mu m g against the motion."""
    friction: Any = cr.mechanism.Friction(BEARING)
    result = friction.step(
        h=0.001, velocity=[1.0], mass_matrix=[[2.0]], free_acceleration=[0.0],
        axes=[[1.0], [0.0]], reaction=([0, 0, 2.0 * G, 0, 0, 0], [[2.0]] + 5 * [[0.0]]),
        length=0.0,
    )  # fmt: skip
    assert result["force_friction"] == pytest.approx(-0.2 * 2.0 * G, rel=1e-12)
    assert friction.generalised_force == pytest.approx([-0.2 * 2.0 * G], rel=1e-12)


@pytest.mark.parametrize("view", [False, True], ids=["copies", "one view"])
def test_a_function_that_returns_a_view_is_read_before_the_next_call(view: bool) -> None:
    """As Pinocchio's does; the mass centre beside the slot makes FN depend on f1."""
    kept = np.zeros(6)

    def reaction(a: np.ndarray) -> np.ndarray:
        found = np.array([2.0 * a[0], 0.0, 2.0 * G, 0.0, 0.0, -0.04 * 2.0 * a[0]])
        if not view:
            return found
        kept[:] = found
        return kept

    friction: Any = cr.mechanism.Friction(BEARING)
    result = friction.step(
        h=0.001, velocity=[1.0], mass_matrix=[[2.0]], free_acceleration=[3.0],
        axes=[[1.0], [0.0]], reaction=reaction, length=0.0,
    )  # fmt: skip
    # f = -mu (N0 + 2/L 0.04 (6 N + f)), with N0 = m g and 6 N the force that drives
    force = -0.2 * (2.0 * G + 0.8 * 6.0) / (1.0 + 0.2 * 0.8)
    assert result["force_friction"] == pytest.approx(force, rel=1e-12)


def test_the_reaction_of_rigid_bodies_is_that_of_newton_and_euler() -> None:
    """A spinning body on a slide whose frame turns: m (x - p) x a and w x I w."""
    inertia, spin = np.diag([0.01, 0.03, 0.02]), np.array([4.0, 0.0, 1.0])
    jacobian = np.zeros((1, 6, 2))
    jacobian[0, 0, 0], jacobian[0, 3, 1] = 1.0, 1.0  # slide along x, spin about it
    bias = np.array([[0.0, 0.5, 0.0, 0.0, 0.0, 0.2]])
    bodies = RigidBodies(
        np.array([2.0]), np.array([[0.1, 0.03, 0.0]]), inertia[None], spin[None], jacobian, bias
    )
    found = bodies.reaction(point=[0.0, 0.0, 0.0], axes=np.eye(3))
    a = np.array([3.0, -2.0])
    force = 2.0 * np.array([3.0, 0.5, G])
    moment = np.cross([0.1, 0.03, 0.0], force) + inertia @ [-2.0, 0.0, 0.2]
    moment += np.cross(spin, inertia @ spin)
    assert found.bias + found.matrix @ a == pytest.approx(np.concatenate([force, moment]))


def test_shapes_are_named() -> None:
    friction: Any = cr.mechanism.Friction(BEARING)
    with pytest.raises(ValueError, match="mass_matrix: has the shape"):
        friction.step(
            h=0.001, velocity=[1.0], mass_matrix=[[2.0, 0.0]], free_acceleration=[0.0],
            axes=[[1.0], [0.0]], reaction=lambda a: np.zeros(6), length=0.0,
        )  # fmt: skip


def test_the_arm_of_the_guide_binds_and_comes_free(tmp_path: Path) -> None:
    """Its text, its picture, and a run that the package reads."""
    script = ROOT / "docs" / "how_to" / "arm_opens_drawer.py"
    picture = tmp_path / "arm.png"
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "run"), str(picture)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    states = [line.split()[-1] for line in done.stdout.splitlines() if " s  " in line]
    assert states == ["sticks", "slides", "sticks", "slides"]
    assert "creep in 1 s: 0.0e+00 m" in done.stdout
    assert picture.stat().st_size > 10_000
    normal = cr.read_run(tmp_path / "run").state.columns["normal_force"]
    assert normal.max() > 5.0 * np.median(normal)
