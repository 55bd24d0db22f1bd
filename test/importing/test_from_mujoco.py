"""A joint of an MJCF or URDF model as a scene: lumped inertias, frames, limits, refusals."""

from pathlib import Path

import numpy as np
import pytest

from cylconn_ros.errors import ModelError
from cylconn_ros.importing import from_mujoco

DRAWER = """<robot name="cabinet"><link name="base"/>
<link name="drawer"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial>
<visual><geometry><mesh filename="not_there.stl"/></geometry></visual></link>
<joint name="drawer" type="JOINT"><parent link="base"/><child link="drawer"/>
<origin xyz="0.2 0 0.1"/><axis xyz="0 1 0"/>
<limit lower="-0.1" upper="0.4" effort="9" velocity="1"/>
<dynamics damping="2" friction="1.5"/></joint>
<link name="handle"><inertial><mass value="MASS"/>
<inertia ixx="INERTIA" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
<joint name="weld" type="fixed"><parent link="drawer"/><child link="handle"/>
<origin xyz="0.3 0 0"/></joint></robot>"""


def urdf(folder: Path, joint: str = "prismatic", mass: str = "0.5", inertia: str = "1e-4") -> Path:
    path = folder / "cabinet.urdf"
    text = DRAWER.replace("JOINT", joint).replace("MASS", mass).replace("INERTIA", inertia)
    path.write_text(text)
    return path


def test_a_urdf_drawer_with_a_welded_handle(tmp_path: Path) -> None:
    draft = from_mujoco.draft_of(urdf(tmp_path), ["drawer"])
    scene = draft.scene()
    assert scene is not None
    # 2 kg at 0.1 m and 0.5 kg at 0.3 m: mass centre 0.14 m, parallel axes 0.4 kg * (0.2 m)^2
    assert scene.body_b.mass == pytest.approx(2.5)
    assert scene.body_b.com == pytest.approx((0.14, 0.0, 0.0), abs=1e-12)
    assert scene.body_b.inertia == pytest.approx((0.0201, 0, 0, 0.0461, 0, 0.0461), abs=1e-12)
    assert (scene.body_a.kind, scene.damping.c1) == ("fixed", 2.0)
    assert (scene.stops.l_min, scene.stops.l_max) == (-0.1, 0.4)
    assert scene.command.spin.position == 0.0
    x, y, z, w = scene.node_a.orientation
    e1 = (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w))
    assert e1 == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    assert {"friction.radius", "friction.overlap", "friction.coefficient"} <= set(draft.blanks)
    assert "NOT KNOWN" in draft.text()
    assert any("1.5 N" in what for what in draft.left_out)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joint": "fixed"}, "joint drawer: not in the model"),
        ({"joint": "floating"}, "does not accept the model"),
        ({"inertia": "1.0"}, "link handle: principal moments 0.0001, 0.0001, 1 kg"),
        ({"mass": "-1"}, "none may be negative"),
    ],
)
def test_a_urdf_that_cannot_be_used(tmp_path: Path, change: dict[str, str], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        from_mujoco.draft_of(urdf(tmp_path, **change), ["drawer"])


MJCF = """<mujoco><worldbody><body name="tube"><freejoint/><geom size="0.1" mass="3"/>
<body name="rod"><joint name="slide" type="slide" axis="1 0 0" pos="0 0 0.1" stiffness="50"
 springref="0.1"/><joint name="spin" type="hinge" axis="AXIS" pos="0 OFF 0.1"/>
<geom type="capsule" size="0.05 0.2" mass="2"/></body></body></worldbody></mujoco>"""


def test_a_coaxial_pair_on_a_floating_body(tmp_path: Path) -> None:
    path = tmp_path / "strut.xml"
    path.write_text(MJCF.replace("AXIS", "1 0 0").replace("OFF", "0"))
    scene = from_mujoco.draft_of(path, ["slide"]).scene()
    assert scene is not None
    assert (scene.body_a.kind, scene.body_a.mass) == ("free", 3.0)
    assert np.isnan(scene.command.spin.position)  # the hinge was found
    assert (scene.elasticity.k1, scene.reference.length) == pytest.approx((50.0, 0.1))


@pytest.mark.parametrize(("axis", "off"), [("0 1 0", "0"), ("1 0 0", "0.01")])
def test_a_pair_that_is_not_coaxial(tmp_path: Path, axis: str, off: str) -> None:
    path = tmp_path / "strut.xml"
    path.write_text(MJCF.replace("AXIS", axis).replace("OFF", off))
    with pytest.raises(ModelError, match="not on one axis"):
        from_mujoco.draft_of(path, ["slide", "spin"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<!DOCTYPE a [<!ENTITY x "y"><!ENTITY z "&x;&x;">]><mujoco>&z;</mujoco>', "entity"),
        ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><mujoco/>', "document type"),
        ('<robot name="r"><link name="a"><visual><geometry><mesh filename="http://x/y.stl"/>'
         "</geometry></visual></link></robot>", "only local files"),
        ("<mujoco>", "is not XML"),
        ("<sdf/>", "must be mujoco"),
    ],
)  # fmt: skip
def test_xml_that_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(ModelError, match=said):
        from_mujoco.draft_of(path, ["slide"])
