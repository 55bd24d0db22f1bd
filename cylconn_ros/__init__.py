"""A cylindrical connector between two rigid bodies: mechanics, ROS 2 node, recordings.

``import cylconn_ros as cr`` is light: a name of the public API, listed in ``__all__``, imports its
module at first use. ROS is imported by the node only.
"""

import importlib
import pkgutil

TYPE_CHECKING = False  # typing.TYPE_CHECKING without the time that importing typing takes
if TYPE_CHECKING:
    from cylconn_ros import mechanism as mechanism
    from cylconn_ros import mujoco as mujoco
    from cylconn_ros.connector.connector import Connector
    from cylconn_ros.connector.feed_forward import feed_forward
    from cylconn_ros.connector.outputs import StepResult
    from cylconn_ros.errors import (
        CylconnError,
        IdentifyError,
        RecordingError,
        SceneError,
        UnknownNameError,
    )
    from cylconn_ros.identification.recording import identify
    from cylconn_ros.recording.run import read_run
    from cylconn_ros.scene.amplitude import Amplitude
    from cylconn_ros.scene.behaviour import (
        Baumgarte,
        Command,
        Damping,
        Elasticity,
        Friction,
        FrictionTable,
        Imposed,
        Lock,
        Penalty,
        Stops,
    )
    from cylconn_ros.scene.bodies import Body, Node, PlantBody, PlantSettings, Reference
    from cylconn_ros.scene.outputs import (
        Access,
        FeedForward,
        JointNames,
        Limits,
        QualityOfService,
        Record,
        Wrench,
    )
    from cylconn_ros.scene.resources import shipped, shipped_scenes
    from cylconn_ros.scene.scene import Scene, load
    from cylconn_ros.scene.tables import (
        DamperTable,
        RotationalDamperTable,
        RotationalSpringTable,
        SpringTable,
    )
    from cylconn_ros.simulation.run import Run
    from cylconn_ros.simulation.simulate import simulate
    from cylconn_ros.study.sweep import sweep

__version__ = "0.1.0"

# The generated messages (cylconn_ros.msg) may be installed apart from this source tree: join both.
__path__ = pkgutil.extend_path(__path__, __name__)

_MODULES = {
    "connector.connector": ("Connector",),
    "connector.feed_forward": ("feed_forward",),
    "connector.outputs": ("StepResult",),
    "errors": ("CylconnError", "IdentifyError", "RecordingError", "SceneError", "UnknownNameError"),
    "identification.recording": ("identify",),
    "recording.run": ("read_run",),
    "scene.amplitude": ("Amplitude",),
    "scene.bodies": (
        "Body",
        "Node",
        "Reference",
        "PlantBody",
        "PlantSettings",
    ),
    "scene.behaviour": (
        "FrictionTable",
        "Friction",
        "Stops",
        "Lock",
        "Elasticity",
        "Damping",
        "Penalty",
        "Baumgarte",
        "Imposed",
        "Command",
    ),
    "scene.outputs": (
        "Access",
        "FeedForward",
        "JointNames",
        "Wrench",
        "Limits",
        "QualityOfService",
        "Record",
    ),
    "scene.resources": ("shipped", "shipped_scenes"),
    "scene.scene": ("Scene", "load"),
    "scene.tables": (
        "SpringTable",
        "RotationalSpringTable",
        "DamperTable",
        "RotationalDamperTable",
    ),
    "simulation.run": ("Run",),
    "simulation.simulate": ("simulate",),
    "study.sweep": ("sweep",),
}
_PACKAGES = ("mechanism", "mujoco")  # cr.mujoco.Friction
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Access",
    "Amplitude",
    "Baumgarte",
    "Body",
    "Command",
    "Connector",
    "CylconnError",
    "DamperTable",
    "Damping",
    "Elasticity",
    "FeedForward",
    "Friction",
    "FrictionTable",
    "IdentifyError",
    "Imposed",
    "JointNames",
    "Limits",
    "Lock",
    "Node",
    "Penalty",
    "PlantBody",
    "PlantSettings",
    "QualityOfService",
    "Record",
    "RecordingError",
    "Reference",
    "RotationalDamperTable",
    "RotationalSpringTable",
    "Run",
    "Scene",
    "SceneError",
    "SpringTable",
    "StepResult",
    "Stops",
    "UnknownNameError",
    "Wrench",
    "feed_forward",
    "identify",
    "load",
    "read_run",
    "shipped",
    "shipped_scenes",
    "simulate",
    "sweep",
]


def __getattr__(name: str) -> object:
    """Import a public name at its first use."""
    if name in _PACKAGES:
        return importlib.import_module(f"{__name__}.{name}")
    try:
        module = _MODULE_OF[name]
    except KeyError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None
    value = getattr(importlib.import_module(f"{__name__}.{module}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return sorted([*__all__, "__version__"])
