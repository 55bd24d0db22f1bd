"""The one exception of this room."""

from __future__ import annotations


class RecordingError(Exception):
    """A run could not be written or read; the message names the file or topic and the reason."""
