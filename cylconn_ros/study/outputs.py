"""Outputs of a simulation by name: reductions of its columns to one value, block by block.

``FIELD.REDUCTION`` reduces a column of a run (a field of ConnectorState, a published wrench, pose_a
to twist_b, energy): ``displacement.end``, ``normal_force.max``, ``velocity[0].maxabs``. A vector
without a component gives a column a component. Other outputs have a name of their own, such as
``stop_time`` and ``jam``; :data:`NAMED` lists them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector import enums
from cylconn_ros.connector.outputs import COLUMNS, DERIVED, ENUMS, acceleration
from cylconn_ros.connector.summary import FIELDS, Reduction
from cylconn_ros.core import layout
from cylconn_ros.errors import StudyError
from cylconn_ros.simulation.closed_loop import Block
from cylconn_ros.simulation.run import MOTION
from cylconn_ros.study.rows import split

Array = NDArray[np.float64]

NAMED: Final[Mapping[str, str]] = {
    "stop_time": "float64",
    "jam": "bool",
    "jam_time": "float64",
    "flags": "string",
    "stops": "string",
    "refused": "int64",
    "slip_share": "float64",
    "stick_share": "float64",
    "energy_lost": "float64",
    "usable": "bool",
}
"""Outputs with a name of their own and their types: begin of the final rest (s, NaN: none); whether
a sample had the flag ``jammed``, and the time of the first (s); names of all flags and of all stops
that occurred; samples with a zero wrench; shares of the samples in slip and in stick; energy of the
bodies at the start less that at the end (J); whether the motion stayed in the joint."""

DEFAULT: Final = (
    "displacement.end", "rotation.end", "stop_time", "jam", "flags", "usable",
    "normal_force.max", "traction.max", "radial_force.max", "bending_moment.max",
    "slip_rate.max", "energy.end", "energy_lost", "residual.max",
)  # fmt: skip


class _Reduced:
    """A column reduced by one of REDUCTIONS; blocks of (n,) values and times are added."""

    def __init__(self) -> None:
        self.start = self.end = math.nan
        self.min, self.max, self.maxabs = math.inf, -math.inf, -math.inf
        self.sum = self.squares = 0.0
        self.count = 0
        self.time_of_max = math.nan

    def add(self, time: Array, values: Array) -> None:
        if not len(values):
            return
        if not self.count:
            self.start = float(values[0])
        self.end = float(values[-1])
        self.count += len(values)
        self.sum += float(values.sum())
        self.squares += float(values @ values)
        high = float(values.max())  # NaN if a value is
        if not high <= self.max:
            self.time_of_max = float(time[int(np.argmax(values))])
        self.max = float(np.maximum(self.max, high))
        self.min = float(np.minimum(self.min, values.min()))
        self.maxabs = float(np.maximum(self.maxabs, np.abs(values).max()))


REDUCTIONS: Final[Mapping[str, Callable[[_Reduced], float]]] = {
    "start": lambda r: r.start,
    "end": lambda r: r.end,
    "min": lambda r: r.min,
    "max": lambda r: r.max,
    "maxabs": lambda r: r.maxabs,
    "range": lambda r: r.max - r.min,
    "mean": lambda r: r.sum / r.count if r.count else math.nan,
    "rms": lambda r: math.sqrt(r.squares / r.count) if r.count else math.nan,
    "time_of_max": lambda r: r.time_of_max,
}
"""Reductions of a column by name."""


@dataclass(frozen=True)
class _Output:
    """A reduction of one number of a sample: which array, which index, which reduction."""

    source: str
    index: int
    reduction: str


class Outputs:
    """The outputs with the names given.

    Attributes
    ----------
        types: type of each output column by name.

    Raises StudyError for a name that does not exist; it lists those that do.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._named: list[str] = []
        self._reduced: dict[str, _Output] = {}
        self.types: dict[str, str] = {}
        for name in names:
            if name in NAMED:
                self._named.append(name)
                self.types[name] = NAMED[name]
                continue
            for column, output in _columns(name):
                self._reduced[column] = output
                self.types[column] = "float64"

    def reduction(self) -> Blocks:
        """Begin the reduction of a run."""
        return Blocks(self._reduced, self._named, tuple(self.types))

    def reduce(self, blocks: Iterable[Block]) -> dict[str, Any]:
        """Values by column of a run whose blocks (simulation/closed_loop.py) come in order."""
        found = self.reduction()
        for block in blocks:
            found.add(block)
        return found.result()


class Blocks:
    """The blocks of one run so far, reduced."""

    def __init__(
        self, reduced: Mapping[str, _Output], named: Sequence[str], columns: Sequence[str]
    ) -> None:
        self._outputs, self._names, self._columns = reduced, named, columns
        self._reduced = {(o.source, o.index): _Reduced() for o in reduced.values()}
        self._named = _Named() if named else None
        self._before: tuple[float, Array] | None = None  # time and outputs of the last sample

    def add(self, block: Block) -> None:
        """Take in the next block."""
        for (source, index), one in self._reduced.items():
            if source == "rates":
                one.add(*_accelerations(block, index, self._before))
                continue
            values = getattr(block, source)
            one.add(block.time, values if values.ndim == 1 else values[:, index])
        self._before = float(block.time[-1]), block.outs[-1].copy()
        if self._named is not None:
            self._named.add(block)

    def result(self) -> dict[str, Any]:
        """Values by column."""
        found: dict[str, Any] = {
            name: REDUCTIONS[o.reduction](self._reduced[o.source, o.index])
            for name, o in self._outputs.items()
        }
        if self._named is not None:
            values = self._named.result()
            found |= {name: values[name] for name in self._names}
        return {name: found[name] for name in self._columns}


def _accelerations(
    block: Block, index: int, before: tuple[float, Array] | None
) -> tuple[Array, Array]:
    """Times and mean accelerations of the periods that end within a block."""
    time, rate = block.time, block.outs[:, index]
    if before is not None:
        time = np.concatenate(([before[0]], time))
        rate = np.concatenate(([before[1][index]], rate))
    return time[:-1], acceleration(np.diff(time), rate)[:-1]


def _columns(text: str) -> list[tuple[str, _Output]]:
    """Column names and reductions of ``FIELD.REDUCTION``."""
    field, dot, reduction = text.rpartition(".")
    name, component = split(field)
    known = ("energy", *MOTION, *COLUMNS, *DERIVED)
    if not dot or reduction not in REDUCTIONS or name not in known:
        fields = ", ".join(known)
        raise StudyError(
            f"output {text}: must be one of {', '.join(NAMED)}, or FIELD.REDUCTION with a "
            f"reduction {', '.join(REDUCTIONS)} and a field {fields}"
        )
    if name == "energy":
        source, indices = "energy", [0]
    elif name in DERIVED:
        of = COLUMNS[DERIVED[name]]
        source, indices = "rates", [of.start if isinstance(of, slice) else of]
    elif name in MOTION:
        source, indices = "states", list(range(MOTION[name].start, MOTION[name].stop))
    else:
        place = COLUMNS[name]
        source = "outs"
        indices = [place] if isinstance(place, int) else list(range(place.start, place.stop))
    if component is not None:
        if len(indices) == 1 or component >= len(indices):
            raise StudyError(f"output {text}: {name} has no component {component}")
        return [(text, _Output(source, indices[component], reduction))]
    if len(indices) == 1:
        return [(text, _Output(source, indices[0], reduction))]
    return [
        (f"{name}[{k}].{reduction}", _Output(source, index, reduction))
        for k, index in enumerate(indices)
    ]


class _Named:
    """The outputs with a name of their own."""

    def __init__(self) -> None:
        self._summary = Reduction()
        self._jam_time, self._flags, self._stops = math.nan, 0, 0
        self._energy: list[float] = []

    def add(self, block: Block) -> None:
        outs = block.outs
        state: dict[str, Any] = {name: outs[:, COLUMNS[name]] for name in FIELDS}
        state |= {name: state[name].astype(np.int64) for name in ENUMS if name in state}
        self._summary.add(block.time, state)
        flags = state["flags"]
        jammed = np.flatnonzero(flags & layout.JAMMED)
        if len(jammed) and math.isnan(self._jam_time):
            self._jam_time = float(block.time[jammed[0]])
        self._flags |= int(np.bitwise_or.reduce(flags))
        self._stops |= int(np.bitwise_or.reduce(outs[:, layout.STOP].astype(np.int64)))
        self._energy = [*self._energy[:1], float(block.energy[0]), float(block.energy[-1])]

    def result(self) -> dict[str, Any]:
        found = self._summary.result()
        return {
            "stop_time": found.stop_time,
            "jam": bool(self._flags & layout.JAMMED),
            "jam_time": self._jam_time,
            "flags": enums.named(enums.FLAGS, self._flags),
            "stops": enums.named(enums.STOPS, self._stops),
            "refused": found.refused,
            "slip_share": found.regimes.get("slip", 0.0),
            "stick_share": found.regimes.get("stick", 0.0),
            "energy_lost": self._energy[0] - self._energy[-1],
            "usable": not found.problem,
        }
