"""The exceptions of the package: one base, one kind for each part that raises."""

from __future__ import annotations

from collections.abc import Iterable


class CylconnError(Exception):
    """Base of all errors that this package raises; the message is a sentence for the user."""


class SceneError(CylconnError, ValueError):
    """A parameter that cannot be accepted; the text names the parameter, its value and the rule."""


class CommandError(CylconnError):
    """A command cannot be carried out."""


class ModelError(CylconnError, ValueError):
    """A model of another program cannot be imported; the text names the part and the rule."""


class IdentifyError(CylconnError):
    """Friction cannot be identified; the message says what is missing or in the way."""


class IndeterminateError(IdentifyError):
    """A recorded motion does not determine the friction; the message says what it lacks."""


class RecordingError(CylconnError):
    """A run cannot be written or read; the message names the file or topic and the reason."""


class ProcessError(CylconnError, RuntimeError):
    """A child process does not start, ends early or does not respond; the message says which."""


class StudyError(CylconnError):
    """Many runs or recordings cannot be worked through, or their results cannot be written."""


class UnknownNameError(CylconnError, KeyError):
    """A field or topic of this name does not exist; the message lists the names."""

    def __init__(self, name: str, names: Iterable[str]) -> None:
        super().__init__(f"{name}: no such name; there are {', '.join(names) or 'none'}")

    __str__ = Exception.__str__  # KeyError's shows the text in quotes
