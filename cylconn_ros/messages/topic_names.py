"""Topic names and log prefixes of a connector; both begin with its name, if it has one."""

from __future__ import annotations


def topic(connector: str, name: str) -> str:
    """The relative or private topic name below the name of a connector ("": none)."""
    if not connector:
        return name
    return f"~/{connector}/{name[2:]}" if name.startswith("~/") else f"{connector}/{name}"


def prefix_log(connector: str, text: str) -> str:
    """A log message about a connector ("": the only one)."""
    return f"{connector}: {text}" if connector else text
