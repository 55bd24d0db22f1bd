"""Lock step with all shapes of inputs: every sample must be answered without a further message.

The client publishes each message once and waits for the wrenches with the sample's stamp. Messages
of a sample come in random order, loads with their samples or at other rates, commands in between,
for one moving body or two, and for several connectors of a node. Each load is another one; where
the wrench has to balance it, the balance is checked.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import math
import random
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from cylconn_ros.bench.faults.fault import FaultCase, node, sleeve
from cylconn_ros.bench.faults.simulator import Array, Messages, Simulator
from cylconn_ros.errors import ProcessError
from cylconn_ros.messages.cdr_encoder import JointStateWriter, StampedWriter
from cylconn_ros.messages.pipeline import COMMAND, JOINT_STATE
from cylconn_ros.scene.inputs import BODIES, LOAD
from cylconn_ros.scene.scene import Scene

SAMPLES, QUICK = 1_000_000, 3000
"""Samples of all shapes together."""
_COMMAND = COMMAND.replace("~", "connector")
_TIMEOUT = 5.0  # s until a sample counts as unanswered
_COMPILING = 300.0  # s for the first response
_AGAIN = 10.0  # s for which a late answer is waited for; then the client goes on
_SLOW = 0.1  # s, a response that is counted as slow
_BALANCE = 1e-6  # N, greatest difference of load and wrench


@dataclasses.dataclass(frozen=True)
class Shape:
    """What the client sends."""

    name: str
    orders: tuple[str, ...] = ("random",)  # of a sample's messages, by turns
    load_every: int = 1  # samples between loads; 0: none
    command_every: int = 0
    connectors: int = 1
    changes: dict[str, Any] = dataclasses.field(default_factory=dict)


_INERTIA = [0.03, 0.0, 0.0, 0.03, 0.0, 0.03]
_FREE = {"body_a__kind": "free", "body_a__mass": 3.0, "body_a__inertia": _INERTIA}
SHAPES: Final = (
    Shape("no load", load_every=0),
    Shape("load first", ("load first",)),
    Shape("load last", ("load last",)),
    Shape("load anywhere"),
    Shape("order changes after 50 samples", ("load first",) * 50 + ("load last",) * 50),
    Shape("loads at a tenth of the rate, commands", load_every=10, command_every=7),
    Shape("odometry and loads", changes={"input": "odometry"}),
    Shape("two moving bodies, loads on both", changes=_FREE),
    Shape("two moving bodies, odometry", changes={**_FREE, "input": "odometry"}),
    Shape("three connectors", connectors=3),
)


def cases(folder: Path, samples: int) -> Iterator[tuple[FaultCase, Simulator]]:
    """Run every shape, ``samples`` in all; yield its case and the simulator."""
    for shape in SHAPES:
        scene = sleeve(
            timeout=60.0, latency=0, friction__coefficient=0.0, body_b__com=[0.0, 0.0, 0.0],
            plant__body_b__twist=[0.0] * 6, **shape.changes,
        )  # fmt: skip
        names = [f"c{k}" for k in range(shape.connectors)] if shape.connectors > 1 else [""]
        with _clients(folder, scene, names) as clients:
            yield _run(shape, clients, samples // len(SHAPES)), clients[0].simulator


@contextlib.contextmanager
def _clients(folder: Path, scene: Scene, names: Sequence[str]) -> Iterator[list[_Client]]:
    """A connector node with its clients."""
    scenes = {  # a frame of its own for each: bodies with one frame are shared
        name: scene.replace({"body_a.frame": f"a{name}", "body_b.frame": f"b{name}"})
        for name in names
    }
    with node("connector", scenes, folder) as child:
        clients: list[_Client] = []
        try:
            for name in names:
                clients.append(_Client(scenes[name], f"/{name}" if name else ""))
                clients[-1].simulator.connect(lambda: child.running)
            yield clients
        except Exception as error:
            raise ProcessError(f"{error}; {child.last_words()}") from error
        finally:
            for client in clients:
                client.simulator.close()


class _Client:
    """The client of one connector.

    Attributes
    ----------
        stamp: of the last sample, ns. load: (6,) the load in force on B.
    """

    def __init__(self, scene: Scene, namespace: str) -> None:
        self.simulator = Simulator(scene, namespace)
        if not namespace:
            self.simulator.advertise(_COMMAND, JOINT_STATE)
        self._period = round(scene.period * 1e9)
        self._loads = [f"{BODIES[k]}/{LOAD.topic}" for k in self.simulator.moving]
        self._load_writer = StampedWriter(scene.world_frame)
        self._command_writer = JointStateWriter("", ("slide",))
        self._state = np.zeros(26)
        self._state[[6, 19]] = 1.0
        self.stamp = 0
        self.load: Array = np.zeros(6)

    def send(self, k: int, shape: Shape, rng: random.Random) -> None:
        """Send sample ``k``, each message once."""
        self.stamp += self._period
        messages = self.simulator.sample(self.stamp, self._state)
        rng.shuffle(messages)
        if shape.load_every and k % shape.load_every == 0:
            self.load = np.array([0.0, rng.uniform(-9.0, 9.0), 0.0, 0.0, 0.0, 0.0])
            messages = self._with_loads(messages, shape.orders[k % len(shape.orders)], rng)
        if shape.command_every and k % shape.command_every == 0:
            data = self._command_writer.write(
                self.stamp, [math.nan], [math.nan], [rng.uniform(-1.0, 1.0)]
            )
            messages.insert(rng.randint(0, len(messages)), (_COMMAND, data))
        self.simulator.send(messages)

    def _with_loads(self, messages: Messages, order: str, rng: random.Random) -> Messages:
        data = self._load_writer.write(self.stamp, self.load)
        for name in self._loads:
            places = {"load first": 0, "load last": len(messages)}
            messages.insert(places.get(order, rng.randint(0, len(messages))), (name, data))
        return messages

    @property
    def imbalance(self) -> float:
        """Difference of wrench and load along y, N."""
        wrench = self.simulator.wrenches[1]
        return math.inf if wrench is None else abs(wrench.values[1] + self.load[1])


def _run(shape: Shape, clients: Sequence[_Client], samples: int) -> FaultCase:
    case = FaultCase(f"lock step: {shape.name}", "every sample is answered, no message sent twice")
    rng, delays = random.Random(1), list[float]()
    unanswered = unbalanced = 0
    for client in clients:  # the first start of a node compiles
        client.send(0, shape, rng)
        answered = functools.partial(client.simulator.has_response, client.stamp)
        if not client.simulator.spin_until(answered, _COMPILING):
            raise ProcessError(f"no response to the first sample within {_COMPILING:g} s")
    for k in itertools.count(1):
        if len(delays) >= samples:
            break
        due = clients if k % 3 == 0 else [rng.choice(clients)]  # connectors at rates of their own
        for client in due:
            client.send(k, shape, rng)
        for client in due:
            begin = time.monotonic()
            answered = functools.partial(client.simulator.has_response, client.stamp)
            if not client.simulator.spin_until(answered, _TIMEOUT):
                unanswered += 1
                client.simulator.spin_until(answered, _AGAIN)
            delays.append(time.monotonic() - begin)
            unbalanced += len(client.simulator.moving) == 1 and client.imbalance > _BALANCE
    late = sum(client.simulator.counts().get("loads later than their sample", 0)
               for client in clients[:1])  # fmt: skip
    slow = sum(delay > _SLOW for delay in delays)
    case.observe(
        f"{len(delays)} samples; unanswered {unanswered}; slowest {1e3 * max(delays):.1f} ms, "
        f"median {1e3 * float(np.median(delays)):.2f} ms; loads later than their sample {late}; "
        f"wrenches that do not balance their load {unbalanced}",
        samples=len(delays), unanswered=unanswered, slowest=max(delays), slow=slow,
        late_loads=late, unbalanced=unbalanced,
    )  # fmt: skip
    case.check(not unanswered, "unanswered samples")
    # Loads at other rates are not awaited: one that arrives last acts on a later sample.
    expected = shape.load_every == 1
    case.check(not expected or unbalanced <= late, "a load did not act on its sample")
    return case
