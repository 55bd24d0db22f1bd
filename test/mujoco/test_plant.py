"""A MuJoCo model in place of the plant's bodies: the joint removed, or kept without its forces."""

from pathlib import Path

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


GRIPPER = """<mujoco><default><joint damping="7" frictionloss="3" armature="2" range="-1 1"/>
</default><worldbody><body><geom size="0.1" mass="5"/><body pos="0 0 0.5"><joint name="slide"
 type="slide" axis="1 0 0"/><geom size="0.1" mass="2"/></body><body name="other"><joint name="hinge"
 axis="0 1 0"/><geom size="0.1" pos="0 0 -0.5"/></body></body></worldbody>
<tendon><fixed name="cord"><joint joint="slide" coef="1"/></fixed></tendon>
<equality><joint name="mimic" joint1="hinge" joint2="slide"/></equality>
<actuator><motor name="motor" joint="hinge"/><motor name="pull" tendon="cord"/>
<motor name="push" joint="slide"/></actuator>
<sensor><jointpos joint="slide"/><actuatorfrc actuator="push"/><jointpos joint="hinge"/></sensor>
<keyframe><key qpos="0 0"/></keyframe></mujoco>"""


def test_what_names_the_removed_joint_goes_with_it(tmp_path: Path) -> None:
    """Defaults of joints do not act on the floating body; bodies need no names."""
    path = tmp_path / "gripper.xml"
    path.write_text(GRIPPER)
    scene = from_mujoco.draft_of(path, ["slide"]).scene()
    assert scene is not None
    plant = MujocoPlant(scene.replace({"gravity": (0.0, 0.0, 0.0)}), path, ["slide"])
    assert [plant.model.actuator(i).name for i in range(plant.model.nu)] == ["motor"]
    assert (plant.model.neq, plant.model.ntendon, plant.model.nsensor) == (0, 0, 1)
    (note,) = plant.notes
    for part in ("tendon cord", "equality mimic", "actuator pull", "actuator push", "sensor"):
        assert part in note
    for _ in range(500):
        plant.step(np.zeros(6), np.array([0.0, 4.0, 0.0, 0.0, 0.0, 0.0]))
    time = plant.time_ns * 1e-9
    assert plant.state[21] == pytest.approx(4.0 / 2.0 * time, rel=1e-6)  # F t/m, without damping


@pytest.mark.parametrize("constraint", ["connector", "simulator"])
def test_joints_without_a_name_have_their_number(tmp_path: Path, constraint: str) -> None:
    path = tmp_path / "gripper.xml"
    path.write_text(GRIPPER.replace('name="slide"', "").split("<tendon>")[0] + "</mujoco>")
    scene = from_mujoco.draft_of(path, ["#0"]).scene()
    assert scene is not None
    plant = MujocoPlant(scene.replace({"constraint": constraint}), path, ["#0"])
    plant.step(np.zeros(6), np.zeros(6))
    assert plant.model.njnt == (5 if constraint == "connector" else 2)
