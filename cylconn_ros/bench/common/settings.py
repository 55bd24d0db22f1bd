"""How thoroughly a benchmark measures; printed with every result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cylconn_ros.scene.scene import Scene

SceneLoader = Callable[[str], Scene]
"""Loads a bundled scene by its name."""


@dataclass(frozen=True)
class Settings:
    """Settings of a benchmark run, chosen by the command.

    Attributes
    ----------
        load: loads a bundled scene. quick: the short form, with rough numbers.
        rounds: turns per solver. block: CPU seconds of one turn.
        starts: fresh processes that a start-up time is measured on.
        samples: samples of a soak test; None: the default of its form.
    """

    load: SceneLoader
    quick: bool = False
    rounds: int = 31
    block: float = 0.02
    starts: int = 5
    samples: int | None = None

    @classmethod
    def short(cls, load: SceneLoader) -> Settings:
        """The short form, as run by the tests."""
        return cls(load, quick=True, rounds=3, block=0.001, starts=1)

    def described(self) -> dict[str, float | bool]:
        """The settings that are stored with the results."""
        return {
            "quick": self.quick,
            "rounds": self.rounds,
            "block_seconds": self.block,
            "starts": self.starts,
        }
