"""Node with two rigid bodies in place of a simulator; see ``plant --help``."""

from __future__ import annotations

import functools
import math
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future

from cylconn_ros.core import plant as physics
from cylconn_ros.errors import SceneError
from cylconn_ros.messages.commands.command_writer import CommandWriter
from cylconn_ros.ros import qos, run_node
from cylconn_ros.ros.arguments import Arguments
from cylconn_ros.ros.connector.parameters import declare, ros_part
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.scene import multiple
from cylconn_ros.scene.inputs import BODIES, WRENCH
from cylconn_ros.scene.parameter_file import scene_part
from cylconn_ros.scene.scene import several
from cylconn_ros.scene.schema import show
from cylconn_ros.simulation.delay import WrenchDelay
from cylconn_ros.simulation.plant import Plant

USAGE = """\
usage: plant [--version] --ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO] ...

Two rigid bodies in place of a simulator: publishes their poses and twists, and integrates their
motion under the wrenches received and loads (plant.body_a.load, plant.body_b.load, sent on
body_a/load, body_b/load). What has an amplitude over time is sent with every sample: loads, and
preload, motion or force on /connector/preload and /connector/command. Takes the same parameter file
as connector; its own parameters begin with plant. With several connectors, the last part of the
namespace names the one to use (-r __ns:=/NAME).
Lock step (plant.lock_step, the default): waits for the wrenches of each sample before the next.
Free running: plant.rate samples per second, each step with the newest wrenches.
Delay (plant.latency, or latency if > 0): a wrench acts that number of periods after its sample.
Exit codes: 0 plant.duration reached or stopped, 1 no connector, no wrench or a motion that is not
finite, 2 invalid arguments or parameters, 130 interrupted while compiling."""

DISCOVERY = 240.0  # s of wall clock for a connector to appear; its first start compiles
_DISCOVERED = 0.25  # s from discovery to the first sample: the connector must discover us, too
_RETRANSMIT = 1.0  # s without a wrench after which a sample is retransmitted
_ACKNOWLEDGE = Duration(nanoseconds=1_000_000_000)  # of wall clock for a load
_CHECK = 0.05  # s between checks of the timeouts, and between progress lines
_PATIENCE = 1.0  # s without a connector before the first message about it
_REMIND = 5.0  # s between such messages


class PlantNode(Node):
    """Simulate two bodies in lock step with a connector, or free running.

    Raises SceneError at construction if the parameters are invalid.
    """

    EXECUTABLE = "plant"
    FIRST_WRENCH = 0.0  # s to wait for the first wrench at least

    def __init__(
        self, parameters: Mapping[str, Any], namespace: str = "/", **node_arguments: Any
    ) -> None:
        """Take dotted parameters; ``node_arguments`` go to the ROS node (namespace, context …).

        With several connectors, the last part of ``namespace`` names the plant's connector.
        """
        scenes = several(scene_part(parameters))
        name = multiple.ONE if multiple.ONE in scenes else namespace.rpartition("/")[2]
        if name not in scenes:
            raise SceneError(
                f"connectors = {show(list(scenes))}: the plant's namespace must end with one of "
                f"these names; it is {namespace} (use -r __ns:=/{next(iter(scenes))})"
            )
        self.scene = scenes[name]
        self.plant = self.make_plant()
        super().__init__(
            self.EXECUTABLE, parameter_overrides=ros_part(parameters), **node_arguments
        )
        declare(self, {multiple.ONE: self.scene})
        self.done = Future()
        self.counts = PlantCounts()
        self._settings = self.scene.plant
        duration = self._settings.duration / self.scene.period
        self._total = max(1, round(duration)) if math.isfinite(duration) else None
        self._steps = 0
        self._exchange = Exchange(self.scene, self.counts, self.varying_loads())
        self._commands = CommandWriter(self.scene)
        self._command_topics = _command_topics(self._commands, namespace, name)
        commands = [(self._command_topics[of], kind) for of, kind in self._commands.topics.items()]
        delay = self.scene.plant_latency
        self._late = self.make_delay(delay) if delay > 0.0 else None
        self._out = {
            name: self.create_publisher(
                message_class(kind), name, qos.samples(), qos_overriding_options=qos.overriding()
            )
            for name, kind in (*self._exchange.outputs.items(), *commands)
        }
        for body in self._exchange.moving:
            self.create_subscription(
                message_class(WRENCH),
                f"{BODIES[body]}/wrench",
                functools.partial(self._receive, body),
                qos.samples(),
                raw=True,
                qos_overriding_options=qos.overriding(),
            )
        self._running = False
        self._seen = math.inf  # when the connector was discovered on all topics
        self._begin = self._sent = self._transmitted = time.monotonic()
        self._remind = self._begin + _PATIENCE
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_CHECK, self._check, clock=self._steady)

    def make_plant(self) -> Plant:
        """Return the plant of ``self.scene``; compiles now, not while a connector waits."""
        run_node.announce_compiling(physics.step, lambda text: print(f"plant: {text}", flush=True))
        Plant(self.scene).step(np.zeros(6), np.zeros(6))
        if self.scene.plant_latency > 0.0:
            WrenchDelay(Plant(self.scene), 0.0).step()
        return Plant(self.scene)

    def varying_loads(self) -> list[int]:
        """Bodies with a load of its own at each sample: none."""
        return []

    def sent_loads(self) -> np.ndarray:
        """(12,) loads on A and B that are sent with a sample, about the body frames' origins."""
        return self.plant.loads

    def make_delay(self, delay: float) -> WrenchDelay:
        """Return the plant with wrenches that act ``delay`` periods late."""
        return WrenchDelay(self.plant, delay)

    # --- samples ---------------------------------------------------------------------------------

    def _receive(self, body: int, data: bytes) -> None:
        stamp = self._exchange.receive(body, data, self.plant.time_ns)
        if self._late is not None and stamp is not None:
            self._late.put(body, stamp, self._exchange.wrenches[body])
        if self._settings.lock_step and self._running and self._exchange.complete:
            self._advance()

    def _advance(self) -> None:
        """Take one step with the wrenches that act now and send the next sample."""
        if self._late is not None:
            self._late.step()
        else:
            self.plant.step(*self._exchange.wrenches)
        self._steps += 1
        if not math.isfinite(float(self.plant.state.sum())):
            self._diverged()
        elif self._steps == self._total:
            self._end(run_node.OK)
        else:
            self._exchange.begin_sample()
            self._sent = self._transmitted = time.monotonic()
            self._send()

    def _send(self, first: bool = False) -> None:
        """Send the sample, and before it commands, and loads that the connector may not have."""
        stamp, changing, last = self.plant.time_ns, self.plant.over_time, ""
        # Commands have no stamp for which a sample could wait: it is sent after them, and the
        # connector takes what has arrived before each sample.
        for name, data in self._commands.write(stamp, self.plant.steps):
            self._out[last := self._command_topics[name]].publish(data)
        vary = changing.loads_change or self._exchange.loads_vary
        if first or vary or not self._settings.lock_step:
            for name, data in self._exchange.loads(stamp, self.sent_loads()):
                self._out[last := name].publish(data)
        if first and last:  # the sample must not arrive before them
            self._out[last].wait_for_all_acked(_ACKNOWLEDGE)
        for name, data in self._exchange.messages(self.plant.time_ns, self.plant.state):
            self._out[name].publish(data)

    def _tick(self) -> None:
        """Take the steps of a free run that are due by the wall clock."""
        rate = self._settings.rate or 1.0 / self.scene.period
        due = int((time.monotonic() - self._begin) * rate)
        while self._running and self._steps < due:
            self.counts.without_wrench += not self._exchange.complete
            self._advance()

    # --- time ------------------------------------------------------------------------------------

    def _check(self) -> None:
        """Start when a connector is there; then check that its wrenches arrive."""
        if self.done.done():
            return
        now = time.monotonic()
        if not self._running:
            self._wait(now)
        elif self._settings.lock_step:
            patience = self._settings.timeout
            if self._steps == 0:
                patience = max(patience, self.FIRST_WRENCH)
                if patience > self._settings.timeout and now > max(self._remind, self._sent + 2.0):
                    self._remind = now + _REMIND
                    self._say(f"waiting for the first wrench on "
                              f"{self._names(self._exchange.missing)}: a connector that was never "
                              "started before compiles for about a minute")  # fmt: skip
            if now - self._sent > patience:
                self._give_up(
                    f"no wrench for the sample at {self.plant.time_ns * 1e-9:.9g} s on "
                    f"{self._names(self._exchange.missing)} within {patience:g} s "
                    "(plant.timeout)"
                )
            elif now - self._transmitted > _RETRANSMIT:
                self._transmitted = now
                self.counts.retransmitted += self._steps > 0  # the connector may still compile
                self._send(first=True)  # the connector may have been restarted
        self._say_progress()

    def _wait(self, now: float) -> None:
        missing = [
            n for n, publisher in self._out.items() if not publisher.get_subscription_count()
        ]
        wrenches = [f"{BODIES[body]}/wrench" for body in self._exchange.moving]
        missing += [n for n in wrenches if not self.count_publishers(self.resolve_topic_name(n))]
        if missing:
            self._seen = math.inf
        elif self._seen == math.inf:
            self._seen = now
        elif now - self._seen > _DISCOVERED:
            self._running = True
            self._begin = self._sent = self._transmitted = now
            self._send(first=True)
            if not self._settings.lock_step:
                rate = self._settings.rate or 1.0 / self.scene.period
                self.create_timer(1.0 / rate, self._tick, clock=self._steady)
        if missing and now - self._begin > DISCOVERY:
            self._give_up(f"no connector on {self._names(missing)} within {DISCOVERY:g} s")
        elif missing and now > self._remind:
            self._remind = now + _REMIND
            self._say(f"waiting for a connector on {self._names(missing)}")

    def _diverged(self) -> None:
        """End: a state that is not finite cannot be sent."""
        a, b = (", ".join(f"{x:.3g}" for x in wrench) for wrench in self._exchange.wrenches)
        self._say(
            f"the motion is not finite at {self.plant.time_ns * 1e-9:.9g} s, after the wrenches "
            f"[{a}] on A and [{b}] on B: the loop is unstable, or a parameter is not realistic"
        )
        self._end(run_node.FAILED)

    def _give_up(self, why: str) -> None:
        self._say(f"{why}; is the connector running and active, in the same ROS_DOMAIN_ID?")
        self._end(run_node.FAILED)

    def _end(self, code: int) -> None:
        self._running = False
        if not self.done.done():
            self.done.set_result(code)

    def handle_error(self, _error: Exception) -> bool:
        """Return False: the plant ends at the first error."""
        return False

    def finish(self) -> None:
        """Print a summary."""
        self._say_progress()
        wall = time.monotonic() - self._begin if self._steps else 0.0
        counts = self.counts
        lost = (
            ""
            if self._settings.lock_step
            else f", {counts.without_wrench} steps without a new wrench"
        )
        print(
            f"{self.get_name()}: {self._steps} steps, {self.plant.time_ns * 1e-9:.9g} s simulated "
            f"in {wall:.3f} s ({1e6 * wall / max(1, self._steps):.0f} us per step){lost}; samples "
            f"retransmitted {counts.retransmitted}; wrenches repeated {counts.repeated}, "
            f"ignored {counts.ignored}, undecodable {counts.undecodable}",
            flush=True,
        )

    def _say_progress(self) -> None:
        if self._settings.progress and self._total is not None:
            print(f"progress {self._steps} {self._total}", flush=True)

    def _say(self, text: str) -> None:
        print(f"{self.get_name()}: {text}", file=sys.stderr, flush=True)

    def _names(self, names: list[str]) -> str:
        return ", ".join(self.resolve_topic_name(name) for name in names)


def _command_topics(commands: CommandWriter, namespace: str, name: str) -> dict[str, str]:
    """Topics of the node ``connector`` beside the plant by their relative names."""
    base = namespace.rstrip("/")
    if name != multiple.ONE:
        base = base.rpartition("/")[0]
    of = "" if name == multiple.ONE else f"{name}/"
    return {topic: f"{base}/connector/{of}{topic[2:]}" for topic in commands.topics}


def _make(arguments: Arguments) -> PlantNode:
    return PlantNode(arguments.parameters, arguments.namespace)


def main(argv: list[str] | None = None) -> int:
    """Run the executable ``plant``; return its exit code."""
    return run_node.run("plant", _make, USAGE, argv)


if __name__ == "__main__":
    raise SystemExit(main())
