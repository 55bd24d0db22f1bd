"""The load messages that a new recording needs: those in force, and those that wait.

Which load acts on a sample is decided in connector/load_history.py.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from cylconn_ros.connector.load_history import CAPACITY
from cylconn_ros.messages.templates import STAMP


class LoadMessages:
    """Load messages by relative topic name."""

    def __init__(self) -> None:
        self._found: dict[str, list[tuple[int, bytes]]] = {}  # stamps (ns) and messages

    def add(self, name: str, stamp: int, data: bytes, last: int | None) -> None:
        """Add a message; ``last``: stamp of the last sample in ns, or None."""
        found = [*self._found.get(name, ()), (stamp or last or 0, data)]
        past = [] if last is None else [k for k, (at, _) in enumerate(found) if at <= last]
        newest = max(past, key=lambda k: (found[k][0], k), default=-1)
        kept = [one for k, one in enumerate(found) if k == newest or k not in past]
        self._found[name] = kept[-CAPACITY:]

    def restore_from(self, other: LoadMessages, names: Collection[str]) -> None:
        """Adopt the messages of ``names``."""
        self._found = {name: found for name, found in other._found.items() if name in names}

    def current(self, last: int | None) -> Iterator[tuple[str, bytes]]:
        """Yield name and message of each; ``last``: stamp of the last sample in ns, or None.

        A load in force has no stamp: it acts from the first sample of a recording on.
        """
        for name, found in self._found.items():
            for stamp, data in found:
                in_force = last is not None and stamp <= last
                yield name, data[:STAMP] + bytes(8) + data[STAMP + 8 :] if in_force else data
