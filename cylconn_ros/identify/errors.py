"""The one exception of this room."""

from __future__ import annotations


class IdentifyError(Exception):
    """A recording does not tell what was asked; the message says what it lacks."""
