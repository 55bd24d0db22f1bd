"""Why something is not in the results."""

from __future__ import annotations


class AbsentError(Exception):
    """A peer is not installed, or a method is not written yet; the message says which."""


class LeftOutError(Exception):
    """A method does not go with a scene; the message says why."""
