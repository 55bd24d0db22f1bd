"""Why a solver has no result on a benchmark case."""

from __future__ import annotations

from cylconn_ros.errors import CylconnError


class NotInstalledError(CylconnError):
    """A peer solver cannot be imported; the message names the package."""


class NotApplicableError(CylconnError):
    """A solver does not support a scene; the message says why."""
