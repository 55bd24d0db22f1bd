"""MJCF and URDF files as compiled MuJoCo models; MuJoCo is the optional extra ``mujoco``."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from cylconn_ros.errors import ModelError
from cylconn_ros.importing import safe_xml, urdf_inertia
from cylconn_ros.scene.resources import shipped_models

_INCLUDES = 100  # files that a model may include


def mujoco_module() -> Any:
    """The module mujoco. Raises ModelError that says how to install it."""
    try:
        import mujoco
    except ImportError:
        raise ModelError(
            "MuJoCo is not installed; it reads MJCF and URDF: pip install 'cylconn_ros[mujoco]'"
        ) from None
    return mujoco


def find_model(name: str | Path) -> Path:
    """The file of a model, by path or by the name of a bundled one. Raises ModelError."""
    path, known = Path(name), shipped_models()
    if path.is_file() or path.suffix:
        return path
    if str(name) not in known:
        raise ModelError(
            f"{name} is neither a file nor a bundled model ({', '.join(known) or 'none'})"
        )
    return known[str(name)]


def is_urdf(path: Path) -> bool:
    """Whether a file is a URDF, by its root element. Raises ModelError."""
    return safe_xml.read(path).tag == "robot"


def load_spec(path: Path, shapes: bool = True, repaired: dict[str, str] | None = None) -> Any:
    """The file as an editable model (``MjSpec``), checked by :mod:`.safe_xml` before.

    ``shapes`` false leaves out what a URDF shows and collides with, which its inertias do not
    depend on, so that its meshes need not be there. ``repaired`` gets the links of a URDF whose
    inertia is impossible (urdf_inertia.py), with the reason. Raises ModelError.
    """
    mujoco = mujoco_module()
    root = safe_xml.read(path)
    try:
        if root.tag == "robot":
            text, found = _urdf(root, path, shapes)
            if repaired is not None:
                repaired.update(found)
            return _named(mujoco.MjSpec.from_string(text))
        if root.tag != "mujoco":
            raise ModelError(
                f"{path}: the root element is {root.tag}; must be mujoco (MJCF) or robot (URDF)"
            )
        _check_includes(root, path, set())
        return _named(mujoco.MjSpec.from_file(str(path)))
    except ValueError as error:
        raise _refused(path, error) from None


def compile_spec(spec: Any, path: Path) -> Any:
    """The compiled model of a spec. Raises ModelError with MuJoCo's reason."""
    try:
        with warnings.catch_warnings():  # about saving a model with an attached body
            warnings.simplefilter("ignore", UserWarning)
            return spec.compile()
    except ValueError as error:
        raise _refused(path, error) from None


def control_addresses(model: Any) -> list[int]:
    """Index of the first control of each actuator; some actuators of MuJoCo 4 have several."""
    count = len(model.actuator_trntype)
    return [int(k) for k in getattr(model, "actuator_ctrladr", range(count))]


def _named(spec: Any) -> Any:
    """Give joints without a name one by which they can be chosen: # and their number."""
    taken = {joint.name for joint in spec.joints}
    for number, joint in enumerate(spec.joints):
        if not joint.name and f"#{number}" not in taken:
            joint.name = f"#{number}"
    return spec


def _refused(path: Path, error: ValueError) -> ModelError:
    if isinstance(error, ModelError):
        return error
    reason = " ".join(str(error).split())
    return ModelError(f"{path}: MuJoCo does not accept the model: {reason}")


def _urdf(root: ElementTree.Element, path: Path, shapes: bool) -> tuple[str, dict[str, str]]:
    """The URDF for MuJoCo, and links with repaired inertias: links keep their names."""
    for child in list(root):
        if "xacro" in child.tag:
            raise ModelError(f"{path}: contains xacro; expand it first: xacro {path} > robot.urdf")
        mass = child.find("inertial/mass")
        if mass is not None and mass.get("value", "").strip().startswith("-"):
            raise ModelError(
                f"{path}: link {child.get('name')}: mass = {mass.get('value')}: "
                "none may be negative"
            )  # MuJoCo would ignore it
        if not shapes and child.tag == "link":
            for part in [*child.findall("visual"), *child.findall("collision")]:
                child.remove(part)
    try:
        repaired = urdf_inertia.repair(root)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    extension = root.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    compiler.set("fusestatic", "false")
    for name, value in (("strippath", "false"), ("meshdir", str(path.parent.resolve()))):
        if shapes and name not in compiler.attrib:
            compiler.set(name, value)
    return ElementTree.tostring(root, encoding="unicode"), repaired


def _check_includes(root: ElementTree.Element, path: Path, seen: set[Path]) -> None:
    for include in root.iter("include"):
        other = path.parent / include.get("file", "")
        if other.resolve() in seen:
            continue
        seen.add(other.resolve())
        if len(seen) > _INCLUDES:
            raise ModelError(f"{path}: includes more than {_INCLUDES} files")
        _check_includes(safe_xml.read(other), path, seen)
