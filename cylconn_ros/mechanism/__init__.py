"""Friction of a cylindrical joint inside a mechanism, from the mechanism's own equations of motion.

:class:`Friction` takes mass matrix, Jacobians and free acceleration as arrays, from any simulator.
It imports none.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from cylconn_ros.mechanism.friction import Friction as Friction
    from cylconn_ros.mechanism.reaction import RigidBodies as RigidBodies

_MODULE_OF = {"Friction": "friction", "RigidBodies": "reaction"}
__all__ = ["Friction", "RigidBodies"]


def __getattr__(name: str) -> object:
    """Import a name at its first use."""
    import importlib

    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
