"""MuJoCo: a model as the simulator of a connector, and friction in the user's own loop.

MuJoCo is the optional extra ``mujoco``.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from cylconn_ros.mujoco.friction import Friction as Friction

__all__ = ["Friction"]


def __getattr__(name: str) -> object:
    """Import :class:`Friction` at its first use."""
    if name != "Friction":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from cylconn_ros.mujoco.friction import Friction

    return Friction
