"""How thoroughly a benchmark measures; printed with every result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cylconn_ros.scene.scene import Scene

SceneLoader = Callable[[str], Scene]
"""Gives a scene that comes with the package by its name."""


@dataclass(frozen=True)
class Settings:
    """Chosen by the command.

    Attributes
    ----------
        load: finds scenes. quick: the short form, whose numbers are rough.
        rounds: how often every contestant has its turn. block: CPU seconds of one turn.
        starts: how many fresh processes a start-up is measured on.
        samples: of a soak; None: as many as its form says.
    """

    load: SceneLoader
    quick: bool = False
    rounds: int = 31
    block: float = 0.02
    starts: int = 5
    samples: int | None = None

    @classmethod
    def short(cls, load: SceneLoader) -> Settings:
        """The form that tests run."""
        return cls(load, quick=True, rounds=3, block=0.001, starts=1)

    def described(self) -> dict[str, float | bool]:
        """What belongs into the results."""
        return {
            "quick": self.quick,
            "rounds": self.rounds,
            "block_seconds": self.block,
            "starts": self.starts,
        }
