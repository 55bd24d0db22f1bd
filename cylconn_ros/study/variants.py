"""What the rows of a sweep change: the scene of one connector, or those of several by name.

A column ``friction.coefficient`` changes the parameter of all connectors, ``left.friction.radius``
that of the connector ``left``. Outputs are named in the same way; one without a name of a connector
gives a column for each.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from cylconn_ros.errors import SceneError, StudyError
from cylconn_ros.scene import multiple, parameter_file, shared_bodies
from cylconn_ros.scene.scene import Scene, several
from cylconn_ros.simulation.group import GroupLoop, GroupRun, simulate_group
from cylconn_ros.simulation.run import Run
from cylconn_ros.simulation.simulate import samples_of, simulate, simulate_blocks
from cylconn_ros.study.outputs import Outputs
from cylconn_ros.study.rows import changes, place_of

Scenes = Mapping[str, Scene]
GroupRuns = dict[tuple[str, ...], GroupRun]
"""Runs of connectors that share bodies, by their names."""


@dataclass(frozen=True)
class Variants:
    """The scenes of a sweep.

    Attributes
    ----------
        scenes: by name of the connector; the name is "" if there is one without a name.
    """

    scenes: Scenes

    @classmethod
    def read(cls, text: str) -> Variants:
        """Those that :meth:`text` wrote."""
        return cls(several(parameter_file.parameters_of(text)))

    def text(self) -> str:
        """Return a parameter file."""
        return parameter_file.dump_several(self.scenes)

    @property
    def single(self) -> bool:
        """Whether there is one connector without a name."""
        return multiple.ONE in self.scenes

    def check_names(self, columns: Iterable[str]) -> None:
        """Raise StudyError for a column of a connector that does not exist, or of the node."""
        for column in columns:
            connector, parameter, _ = place_of(column)
            if not connector:
                continue
            if connector not in self.scenes:
                names = ", ".join(name for name in self.scenes if name) or "none has a name"
                raise StudyError(f"{column}: no such connector ({names})")
            if multiple.is_of_the_node(parameter):
                raise StudyError(f"{column}: belongs to the node: vary {parameter}")

    def of(self, row: Mapping[str, Any]) -> Scenes:
        """Scenes of a row. Raises SceneError for values that make none."""
        found = {}
        for name, scene in self.scenes.items():
            try:
                found[name] = scene.replace(changes(scene, _own(name, row)))
            except SceneError as error:
                raise SceneError(f"{name}.{error}" if name else str(error)) from None
        if not self.single:
            shared_bodies.check(found)
        return found

    def outputs(self, names: Sequence[str]) -> VariantOutputs:
        """Outputs by name. Raises StudyError for one that does not exist."""
        return VariantOutputs(tuple(self.scenes), tuple(names))


def _own(name: str, row: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a row for one connector, without its name; those of all are among them."""
    found: dict[str, Any] = {}
    for column, value in row.items():
        connector, _, _ = place_of(column)
        if connector in ("", name):
            found[column.removeprefix(f"{connector}.") if connector else column] = value
    return found


@dataclass(frozen=True)
class VariantOutputs:
    """Outputs of connectors (study/outputs.py), with the connector's name in front if it has one.

    Attributes
    ----------
        connectors: their names. names: of the outputs.
    """

    connectors: tuple[str, ...]
    names: tuple[str, ...]

    @cached_property
    def _of(self) -> dict[str, Outputs]:
        named: dict[str, list[str]] = {name: [] for name in self.connectors}
        for text in self.names:
            first, dot, rest = text.partition(".")
            if dot and first and first in named:
                named[first].append(rest)
                continue
            for one in named.values():
                one.append(text)
        return {name: Outputs(dict.fromkeys(texts)) for name, texts in named.items()}

    @cached_property
    def types(self) -> dict[str, str]:
        """Type of each column by name."""
        parts = self._of.items()
        return {_column(c, name): kind for c, part in parts for name, kind in part.types.items()}

    def reduce(self, scenes: Scenes, duration: float | None) -> dict[str, Any]:
        """Simulate and reduce each connector's samples to its outputs.

        Raises SceneError if the scenes cannot be simulated.
        """
        if multiple.ONE in scenes:
            blocks = simulate_blocks(scenes[multiple.ONE], duration)
            return self._of[multiple.ONE].reduce(blocks)
        found: dict[str, Any] = {}
        for names in shared_bodies.groups(scenes):
            group = [scenes[name] for name in names]
            reductions = [self._of[name].reduction() for name in names]
            for together in GroupLoop(group).blocks(samples_of(group[0], duration)):
                for reduction, block in zip(reductions, together, strict=True):
                    reduction.add(block)
            for name, reduction in zip(names, reductions, strict=True):
                found |= {_column(name, key): v for key, v in reduction.result().items()}
        return {name: found[name] for name in self.types}


def _column(connector: str, name: str) -> str:
    return f"{connector}.{name}" if connector else name


def run_again(scenes: Scenes, duration: float | None) -> Run | GroupRuns:
    """Whole runs of scenes: one, or one of each group of connectors that share bodies."""
    if multiple.ONE in scenes:
        return simulate(scenes[multiple.ONE], duration)
    found: GroupRuns = {}
    for names in shared_bodies.groups(scenes):
        group = [scenes[name] for name in names]
        found[tuple(names)] = simulate_group(group, samples_of(group[0], duration))
    return found
