"""What the topics of a connector are called: below its name, where it has one."""

from __future__ import annotations


def topic(connector: str, name: str) -> str:
    """A relative or private name, as a connector of that name has it."""
    if not connector:
        return name
    return f"~/{connector}/{name[2:]}" if name.startswith("~/") else f"{connector}/{name}"


def said(connector: str, text: str) -> str:
    """A line about a connector."""
    return f"{connector}: {text}" if connector else text
