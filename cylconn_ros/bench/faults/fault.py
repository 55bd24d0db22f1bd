"""One fault case (expectation, observations, failed criteria) and the closed loop it acts on."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cylconn_ros.bench.faults.simulator import Array, Bodies, Simulator
from cylconn_ros.process.child import Child, node_command
from cylconn_ros.scene import multiple
from cylconn_ros.scene.parameter_file import dump_several
from cylconn_ros.scene.scene import Scene

OFFSET, ANGLE = 1e-3, 1e-2  # m, rad: greatest constraint violation allowed
_ENERGY = 0.01  # greatest increase of energy allowed, relative to that at the start
_TIMEOUT = 10.0  # s until a sample counts as unanswered

SLEEVE = {
    "body_a": {"kind": "fixed"},
    "body_b": {
        "mass": 1.0,
        "com": [0.03, 0.02, 0.01],
        "inertia": [0.010, 0.001, 0.0005, 0.020, 0.0008, 0.018],
    },
    "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
    "friction": {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 2.0},
    "plant": {
        "body_b": {
            "pose": [0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            "twist": [3.0, 0.0, 0.0, 30.0, 0.0, 0.0],
        }
    },
}


def sleeve(**more: Any) -> Scene:
    """An unbalanced sleeve on a fixed level shaft along x; ``a__b=value`` sets parameter a.b."""
    values = Scene.from_parameters(SLEEVE).parameters()
    values |= {name.replace("__", "."): value for name, value in more.items()}
    return Scene.from_parameters(values)


@contextlib.contextmanager
def node(
    kind: Literal["connector", "plant"],
    scene: Scene | Mapping[str, Scene],
    folder: Path,
    *parameters: str,
) -> Iterator[Child]:
    """Run a node for a ``with`` block.

    ``scene``: of its connector, or of its connectors by name. ``parameters``: further ones,
    ``name:=value``.
    """
    file = folder / f"scene_{time.monotonic_ns()}.yaml"
    scenes = {multiple.ONE: scene} if isinstance(scene, Scene) else scene
    file.write_text(dump_several(scenes), encoding="utf-8")
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    command = node_command(kind, file, *arguments)
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with Child(kind, command, environment, folder=folder) as child:
        yield child


@dataclasses.dataclass
class FaultCase:
    """A fault with its expected and its observed effect.

    Attributes
    ----------
        observed: sentences. failures: expectations that were not met.
        numbers: observations as data: ``not finite`` wrenches published, ``lost`` samples, worst
            ``offset`` (m) and ``angle`` (rad), ``recovery`` (s) to the next output, and others.
    """

    fault: str
    expected: str
    observed: list[str] = dataclasses.field(default_factory=list)
    failures: list[str] = dataclasses.field(default_factory=list)
    numbers: dict[str, float] = dataclasses.field(default_factory=dict)

    def observe(self, text: str, **numbers: float) -> None:
        """Add an observation."""
        self.observed.append(text)
        self.numbers |= {name.replace("_", " "): float(value) for name, value in numbers.items()}

    def check(self, condition: object, failure: str) -> None:
        """Add a failure if a condition does not hold."""
        if not condition:
            self.failures.append(failure)

    def data(self) -> dict[str, Any]:
        """Everything, for JSON."""
        return dataclasses.asdict(self)


def violation(state: Array) -> tuple[float, float]:
    """Offset (m) and angle (rad) of the sleeve from its shaft, the x axis, of a (26,) state."""
    x, y, z, w = state[16:20]
    along = 1.0 - 2.0 * (y * y + z * z)
    across = np.hypot(2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
    return float(np.hypot(state[14], state[15])), float(np.arctan2(across, along))


class ClosedLoop:
    """Lock step between the bodies of a simulator and a node, with the worst values observed.

    Attributes
    ----------
        offset (m), angle (rad): worst violation. offset_rate: greatest change of the offset, m/s.
        energy: of the bodies, sample by sample, J. force (N), torque (N.m): greatest published.
        sent: number of samples. unanswered: of those without an output in time.
        stamp: of the current sample, ns. period: ns.
    """

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator
        self.bodies = Bodies(simulator.scene)
        self.period = round(simulator.scene.period * 1e9)
        self.stamp = 0
        self.offset = self.angle = self.force = self.torque = self.offset_rate = 0.0
        self.energy: list[float] = []
        self.sent = self.unanswered = 0
        self._last_offset: float | None = None
        self._wrench: Array = np.zeros(6)

    @property
    def wrench(self) -> Array:
        """(6,) the newest wrench on the sleeve."""
        newest = self.simulator.wrenches[self.simulator.moving[-1]]
        if newest is not None:
            self._wrench = np.array(newest.values)
        return self._wrench

    def send(self) -> None:
        """Send the current sample."""
        self.simulator.send(self.simulator.sample(self.stamp, self.bodies.state))
        self.sent += 1

    def exchange(self) -> bool:
        """Send the current sample and wait for its output; False if there is none in time."""
        self.send()
        return self.wait(self.stamp)

    def wait(self, stamp: int) -> bool:
        """Wait for the output with a stamp; False if there is none in time."""
        if self.simulator.spin_until(lambda: self.simulator.has_response(stamp), _TIMEOUT):
            return True
        self.unanswered += 1
        return False

    def move(self, wrench: Array | None = None, period_factor: float = 1.0) -> None:
        """Move the bodies by a period, times a factor, under the newest wrench or another one."""
        acting = self.wrench if wrench is None else wrench
        self.force = max(self.force, float(np.linalg.norm(acting[:3])))
        self.torque = max(self.torque, float(np.linalg.norm(acting[3:])))
        h = self.period * period_factor * 1e-9
        with np.errstate(all="ignore"):
            self.bodies.step((np.zeros(6), acting), h)
        self.stamp += round(h * 1e9)
        offset, angle = violation(self.bodies.state)
        if self._last_offset is not None:
            self.offset_rate = max(self.offset_rate, abs(offset - self._last_offset) / h)
        self._last_offset = offset
        self.offset, self.angle = max(self.offset, offset), max(self.angle, angle)
        self.energy.append(self.bodies.energy())

    def run(self, steps: int) -> None:
        """Exchange samples without a fault."""
        for _ in range(steps):
            self.exchange()
            self.move()

    def restart(self) -> None:
        """Begin again with the initial state at stamp 0, as a restarted simulator does."""
        self.bodies.state[:], self.stamp = self.bodies.start, 0
        self.reset_worst()

    def reset_worst(self) -> None:
        """Reset the worst values and the energies."""
        self.offset = self.angle = self.force = self.torque = self.offset_rate = 0.0
        self.energy.clear()
        self._last_offset = None

    def recovery_time(self) -> float:
        """Time until the next sample has an output, s; infinite if it has none."""
        begin = time.monotonic()
        if not self.exchange():
            return float("inf")
        took = time.monotonic() - begin
        self.move()
        return took

    def check(self, case: FaultCase) -> None:
        """Add violation, energy and losses to a case, with the criteria they have to meet."""
        gained = max(self.energy) - self.energy[0] if self.energy else 0.0
        scale = max(abs(self.energy[0]), 1e-9) if self.energy else 1.0
        case.observe(
            f"offset ≤ {1e3 * self.offset:.2g} mm, angle ≤ {1e3 * self.angle:.2g} mrad, energy "
            f"+{100 * max(gained, 0.0) / scale:.2g} %, unanswered {self.unanswered}",
            offset=self.offset, angle=self.angle, energy=gained / scale, unanswered=self.unanswered,
        )  # fmt: skip
        case.check(self.offset <= OFFSET, "offset")
        case.check(self.angle <= ANGLE, "angle")
        case.check(gained <= _ENERGY * scale, "energy")
        case.check(not self.unanswered, "unanswered samples")
