"""A MuJoCo model in place of the plant's bodies: the joint removed, or kept without its forces."""

import numpy as np
import pytest
from paths import ROOT

from cylconn_ros.errors import SceneError
from cylconn_ros.importing import from_mujoco
from cylconn_ros.mujoco.plant import MujocoPlant
from cylconn_ros.simulation.plant import Plant

DRAWER = ROOT / "models" / "cabinet_drawer.xml"


def test_without_its_joint_the_body_moves_as_in_the_plant() -> None:
    scene = from_mujoco.draft_of(DRAWER, ["slide"]).scene()
    assert scene is not None
    ours, theirs, none = Plant(scene), MujocoPlant(scene, DRAWER, ["slide"]), np.zeros(6)
    wrench = np.array([1.0, 2.0, 30.0, 0.1, -0.2, 0.3])
    for _ in range(200):
        ours.step(none, wrench)
        theirs.step(none, wrench)
    assert theirs.time_ns == ours.time_ns
    np.testing.assert_allclose(theirs.state, ours.state, atol=1e-6)  # Euler's turn, order 2


def test_with_its_joint_the_body_slides_and_passes_the_models_range() -> None:
    scene = from_mujoco.draft_of(DRAWER, ["slide"]).scene()
    assert scene is not None
    scene = scene.replace({"constraint": "simulator"})
    plant = MujocoPlant(scene, DRAWER, ["slide"])
    for _ in range(1000):
        plant.step(np.zeros(6), np.array([5.0, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(plant.state[13:16], [0.5 * 5.0 / 3.2, 0.0, 0.5], atol=1e-9)


def test_the_frame_must_be_the_joints_body() -> None:
    scene = from_mujoco.draft_of(DRAWER, ["slide"]).scene()
    assert scene is not None
    with pytest.raises(SceneError, match=r"body_b\.frame"):
        MujocoPlant(scene.replace({"body_b.frame": "other"}), DRAWER, ["slide"])
