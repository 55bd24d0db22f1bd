"""MuJoCo's window on a running model."""

from __future__ import annotations

import os
from typing import Any

from cylconn_ros.errors import SceneError

PERIOD = 1.0 / 30.0  # s of wall clock between two pictures


class Viewer:
    """A window that shows a model while it is stepped; MuJoCo's passive viewer."""

    def __init__(self, model: Any, data: Any) -> None:
        """Raises SceneError if there is no display."""
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise SceneError(
                "--view: there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set); "
                "without --view, markers: true and tf: true show the bodies in RViz or Foxglove "
                "on another machine"
            )
        import mujoco.viewer

        self._window = mujoco.viewer.launch_passive(
            model, data, show_left_ui=False, show_right_ui=False
        )

    def show(self) -> bool:
        """Show the present state; False once the window has been closed."""
        if not self._window.is_running():
            return False
        self._window.sync()
        return True

    def close(self) -> None:
        """Close the window."""
        self._window.close()
