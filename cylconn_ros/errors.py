"""The exceptions of the package: one base, one kind for each part that raises."""

from __future__ import annotations


class CylconnError(Exception):
    """Base of all errors that this package raises; the message is a sentence for the user."""


class SceneError(CylconnError, ValueError):
    """A parameter that cannot be accepted; the text names the parameter, its value and the rule."""


class CommandError(CylconnError):
    """A command cannot be carried out."""


class IdentifyError(CylconnError):
    """A recording does not determine what was asked; the message says what it lacks."""


class RecordingError(CylconnError):
    """A run cannot be written or read; the message names the file or topic and the reason."""
