"""MuJoCo: a model as the simulator of a connector, and friction in the user's own loop.

MuJoCo is the optional extra ``mujoco``.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from cylconn_ros.mujoco.friction import Friction as Friction
    from cylconn_ros.mujoco.unyielding import bound_unyielding as bound_unyielding

_MODULE_OF = {"Friction": "friction", "bound_unyielding": "unyielding"}
__all__ = ["Friction", "bound_unyielding"]


def __getattr__(name: str) -> object:
    """Import a name at its first use."""
    import importlib

    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
