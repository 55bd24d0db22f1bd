"""Parts of ``cylconn bench all``: extent, page and expected duration of each benchmark.

Four benchmarks take from ten minutes to hours. The run of all has a short form of each, in a
place of its own in the page (its mark names the options). Results of the long form stay beside it
until its own command, `cylconn bench NAME`, measures them again; they state their own sources.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Part:
    """One benchmark of the run.

    Attributes
    ----------
        name: of the benchmark. page: below docs. minutes: on two idle cores.
        options: determine the extent; empty: the full form. quick: the extent with --quick.
    """

    name: str
    page: str
    minutes: float
    options: tuple[str, ...] = ()
    quick: tuple[str, ...] = ("--quick",)

    @property
    def command(self) -> str:
        """The command whose results these are; the mark in the page."""
        return " ".join(["cylconn bench", self.name, *self.options])


PARTS = (
    Part("precision", "benchmarks/precision.md", 18.0),
    Part("stability", "benchmarks/stability.md", 6.0),
    Part("kernel", "benchmarks/step_cost.md", 2.0),
    Part("mechanism", "how_to/mechanism.md", 0.5),
    Part("orders", "benchmarks/step_cost.md", 1.0),
    Part("model", "benchmarks/precision.md", 1.0),
    Part("node", "benchmarks/node.md", 1.5),
    Part("connectors", "benchmarks/connectors.md", 1.5),
    Part("scale", "scale/index.md", 1.5),
    Part("replay", "benchmarks/replay.md", 0.5),
    Part("faults", "benchmarks/faults.md", 2.0, ("--quick",)),
    Part("free_running", "benchmarks/faults.md", 0.5, ("--quick",)),
    Part("soak", "benchmarks/faults.md", 1.5, ("--samples", "100000")),
    Part("identification", "benchmarks/identification.md", 2.5, ("--samples", "10")),
)
"""In the order of measurement; together at most 40 minutes."""

LONG = ("faults", "free_running", "soak", "identification")
"""Benchmarks whose long form the run of all does not measure: `cylconn bench NAME`."""
