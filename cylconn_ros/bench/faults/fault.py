"""One fault: what was expected, what was seen, and whether the one is the other."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.bench.faults.peer import Array, Bodies, Peer
from cylconn_ros.scene.scene import Scene

OFFSET, ANGLE = 1e-3, 1e-2  # m, rad: a violation that is none
_PATIENCE = 10.0  # s for an answer before a sample counts as lost

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
    """A sleeve off its balance on a fixed level shaft along x; parameters by ``a__b`` for a.b."""
    values = Scene.from_parameters(SLEEVE).parameters()
    values |= {name.replace("__", "."): value for name, value in more.items()}
    return Scene.from_parameters(values)


@dataclasses.dataclass
class Row:
    """What came of a fault.

    Attributes
    ----------
        seen: in words. wrong: expectations that were not met.
        numbers: the same as data: ``not finite`` wrenches published, ``lost`` samples, ``offset``
            (m) and ``angle`` (rad) at worst, ``recovery`` (s) to the next answer …
    """

    fault: str
    expected: str
    seen: list[str] = dataclasses.field(default_factory=list)
    wrong: list[str] = dataclasses.field(default_factory=list)
    numbers: dict[str, float] = dataclasses.field(default_factory=dict)

    def say(self, text: str, **numbers: float) -> None:
        """Put down what was seen."""
        self.seen.append(text)
        self.numbers |= {name.replace("_", " "): float(value) for name, value in numbers.items()}

    def check(self, holds: object, otherwise: str) -> None:
        """Put down what was not as expected."""
        if not holds:
            self.wrong.append(otherwise)

    def data(self) -> dict[str, Any]:
        """For JSON."""
        return dataclasses.asdict(self)


def violation(state: Array) -> tuple[float, float]:
    """Offset (m) and angle (rad) of the sleeve from its shaft, the x axis, of a (26,) state."""
    x, y, z, w = state[16:20]
    along = 1.0 - 2.0 * (y * y + z * z)
    across = np.hypot(2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
    return float(np.hypot(state[14], state[15])), float(np.arctan2(across, along))


class Exchange:
    """Lock step between the peer's bodies and a node: what comes of it.

    Attributes
    ----------
        offset, angle: worst violation so far. energy: of the bodies, sample by sample, J.
        unanswered: samples that were sent and waited for in vain.
        force, torque: greatest published, N, N.m. speed: at which the offset changed, m/s.
    """

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.bodies = Bodies(peer.scene)
        self.period = round(peer.scene.period * 1e9)
        self.stamp = 0
        self.offset = self.angle = self.force = self.torque = self.speed = 0.0
        self.energy: list[float] = []
        self.sent = self.unanswered = 0
        self._last: float | None = None  # offset
        self._wrench: Array = np.zeros(6)

    @property
    def wrench(self) -> Array:
        """(6,) the newest wrench on the sleeve."""
        newest = self.peer.wrenches[self.peer.moving[-1]]
        if newest is not None:
            self._wrench = np.array(newest.values)
        return self._wrench

    def ask(self, wait: bool = True, patience: float = _PATIENCE) -> bool:
        """Send the sample of now; whether it was answered, if that is waited for."""
        self.peer.send(self.peer.sample(self.stamp, self.bodies.state))
        self.sent += 1
        return self.wait(self.stamp, patience) if wait else True

    def wait(self, stamp: int, patience: float = _PATIENCE) -> bool:
        """Wait for the answer to a stamp."""
        if self.peer.until(lambda: self.peer.answered(stamp), patience):
            return True
        self.unanswered += 1
        return False

    def move(self, wrench: Array | None = None, stretch: float = 1.0) -> None:
        """Move the bodies for a period under the newest wrench, or another."""
        acts = self.wrench if wrench is None else wrench
        self.force = max(self.force, float(np.linalg.norm(acts[:3])))
        self.torque = max(self.torque, float(np.linalg.norm(acts[3:])))
        h = self.period * stretch * 1e-9
        with np.errstate(all="ignore"):
            self.bodies.step((np.zeros(6), acts), h)
        self.stamp += round(h * 1e9)
        offset, angle = violation(self.bodies.state)
        if self._last is not None:
            self.speed = max(self.speed, abs(offset - self._last) / h)
        self._last = offset
        self.offset, self.angle = max(self.offset, offset), max(self.angle, angle)
        self.energy.append(self.bodies.energy())

    def run(self, steps: int) -> None:
        """Exchange so many samples as they should be."""
        for _ in range(steps):
            self.ask()
            self.move()

    def anew(self) -> None:
        """Begin again at stamp 0, as a simulator that was started anew; the worst is forgotten."""
        self.bodies.state[:], self.stamp = self.bodies.start, 0
        self.settle()

    def settle(self) -> None:
        """Forget the worst so far."""
        self.offset = self.angle = self.force = self.torque = self.speed = 0.0
        self.energy.clear()
        self._last = None

    def recovered(self) -> float:
        """Seconds from now until a sample is answered again; infinite where none is."""
        begin = time.monotonic()
        if not self.ask():
            return float("inf")
        took = time.monotonic() - begin
        self.move()
        return took

    def judge(self, row: Row) -> None:
        """Violation, energy, losses: into a row."""
        gained = max(self.energy) - self.energy[0] if self.energy else 0.0
        most = max(abs(self.energy[0]), 1e-9) if self.energy else 1.0
        row.say(
            f"offset ≤ {1e3 * self.offset:.2g} mm, angle ≤ {1e3 * self.angle:.2g} mrad, "
            f"energy +{100 * max(gained, 0.0) / most:.2g} %, unanswered {self.unanswered}",
            offset=self.offset, angle=self.angle, energy=gained / most, unanswered=self.unanswered,
        )  # fmt: skip
        row.check(self.offset <= OFFSET, "offset")
        row.check(self.angle <= ANGLE, "angle")
        row.check(gained <= 0.01 * most, "energy")
        row.check(not self.unanswered, "samples without an answer")


Fault = Callable[[], Row]
