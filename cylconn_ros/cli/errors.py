"""The one exception of this room."""

from __future__ import annotations


class CommandError(Exception):
    """A command cannot be carried out; the message is one plain sentence for the user."""
