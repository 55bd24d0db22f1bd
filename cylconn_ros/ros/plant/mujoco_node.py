"""Node with a MuJoCo model in place of the plant's two bodies; see ``mujoco_plant --help``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from cylconn_ros.errors import ModelError, SceneError
from cylconn_ros.importing.model_file import find_model
from cylconn_ros.mujoco.motion import Motion
from cylconn_ros.mujoco.plant import MujocoPlant
from cylconn_ros.ros import run_node
from cylconn_ros.ros.arguments import Arguments, UsageError, split
from cylconn_ros.ros.plant.node import DISCOVERY, PlantNode
from cylconn_ros.ros.plant.viewer import PERIOD, Viewer

USAGE = """\
usage: mujoco_plant MODEL --joint NAME [--joint NAME] [--motion CSV] [--real-time-factor X]
                    [--pace X] [--view]
                    --ros-args --params-file FILE [-p NAME:=VALUE] [-r FROM:=TO] ...

An MJCF or URDF model in MuJoCo as the simulator of a connector. NAME is a slide or a hinge (its
partner on the same axis and body goes with it); body_b.frame in FILE is the name of its body,
body_a.frame that of the other one. FILE is the connector's, as `cylconn import` writes it.
constraint: simulator keeps the joint and applies only what the connector sends along and about it;
constraint: connector removes the joint from a copy of the model.
plant.lock_step (default true), plant.rate, plant.duration, plant.timeout as for the executable
plant; --real-time-factor sets plant.rate and free running. The time goes out on /clock; actuators
of the model take sensor_msgs/JointState on ~/joint_command, by the names of actuators or joints.
--motion: commands of actuators over simulated time; a CSV file with the columns time (s) and one
per actuator, linear in between. --pace: lock step at most X times as fast as the wall clock.
--view: MuJoCo's window; closing it ends the run.
What else acts on the bodies (contacts, further joints, drives) is sent with each sample on
body_a/load, body_b/load, since the reactions depend on it. The command `cylconn mujoco` starts
model, connector and recording together. Exit codes as for plant."""

_BURST = 3  # steps that a free run takes at once at most
_LONGEST_PAUSE = 0.05  # s


class MujocoPlantNode(PlantNode):
    """Step a MuJoCo model in lock step with a connector, or free running.

    Raises SceneError at construction if parameters, model or joint are not usable.
    """

    EXECUTABLE = "mujoco_plant"
    FIRST_WRENCH = DISCOVERY  # nothing was compiled here, so that the connector may have to

    def __init__(
        self, model: Path, joints: Sequence[str], parameters: Mapping[str, Any],
        namespace: str = "/", motion: Motion | None = None, view: bool = False, pace: float = 0.0,
        **node_arguments: Any,
    ) -> None:  # fmt: skip
        self._model, self._joints, self._motion = model, joints, motion
        self._unknown: set[str] = set()
        self._pace = pace
        super().__init__(parameters, namespace, **node_arguments)
        if motion is not None and (wrong := self._simulator.command(motion.at(0.0))):
            raise SceneError(f"--motion: {', '.join(wrong)}: is not an actuator of the model")
        self._clock_out = self.create_publisher(Clock, "/clock", 10)
        self.create_subscription(JointState, "~/joint_command", self._command, 10)
        self._viewer = Viewer(self._simulator.model, self._simulator.data) if view else None
        if self._viewer is not None:
            self.create_timer(PERIOD, self._show, clock=self._steady)

    def make_plant(self) -> Any:
        """Return the model as the plant."""
        if self.scene.plant_latency > 0.0:
            raise SceneError(
                f"plant.latency = {self.scene.plant_latency:g}: must be 0; mujoco_plant delays "
                "no wrench"
            )
        try:
            self._simulator = MujocoPlant(self.scene, self._model, self._joints)
        except ModelError as error:
            raise SceneError(str(error)) from None
        for note in self._simulator.notes:
            print(f"{self.EXECUTABLE}: {note}", file=sys.stderr, flush=True)
        return self._simulator

    def varying_loads(self) -> list[int]:
        """Bodies on which other parts of the model act."""
        return [k for k in self._simulator.varying if self.scene.bodies[k].kind != "fixed"]

    def sent_loads(self) -> np.ndarray:
        """Loads of the scene, and what other parts of the model do."""
        return np.concatenate([self._simulator.load(k) for k in range(2)])

    def _tick(self) -> None:
        """Take the steps that are due; time that is lost is not made up for.

        A burst of steps would go without wrenches: the clock begins with the first wrench, and a
        model that is late lets the real-time factor sink.
        """
        now, rate = time.monotonic(), self._settings.rate or 1.0 / self.scene.period
        if self._steps == 0 and not self._exchange.complete:
            self._begin = now
        self._begin = max(self._begin, now - (self._steps + _BURST) / rate)
        super()._tick()

    def _advance(self) -> None:
        if self._pace > 0.0:  # lock step: let the wall clock reach the sample
            ahead = self._steps * self.scene.period / self._pace + self._begin - time.monotonic()
            if ahead > 0.0:
                time.sleep(min(ahead, _LONGEST_PAUSE))
        if self._motion is not None:
            self._simulator.command(self._motion.at(self.plant.time_ns * 1e-9))
        super()._advance()

    def _send(self, first: bool = False) -> None:
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(self.plant.time_ns, 10**9)
        self._clock_out.publish(clock)
        super()._send(first)

    def _say_progress(self) -> None:
        super()._say_progress()
        if self._settings.progress:
            values = {"time": self.plant.time_ns * 1e-9}
            values |= self._simulator.along_axis(self._exchange.wrenches[1])
            print(f"motion {json.dumps(values)}", flush=True)

    def _show(self) -> None:
        """Show the state; the run ends when the window is closed."""
        if self._viewer is not None and not self._viewer.show():
            self._viewer = None
            self._end(run_node.OK)

    def finish(self) -> None:
        """Close the window and print a summary."""
        if self._viewer is not None:
            self._viewer.close()
        super().finish()

    def _command(self, message: JointState) -> None:
        """Set actuators: the effort where it is given, else the position, else the velocity."""
        values = message.effort or message.position or message.velocity
        unknown = self._simulator.command(dict(zip(message.name, values, strict=False)))
        for name in sorted(set(unknown) - self._unknown):
            self._unknown.add(name)
            self._say(
                f"{self.resolve_topic_name('~/joint_command')}: {name} is not an actuator or an "
                "actuated joint of the model, or its value is not finite; ignored"
            )


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def main(argv: list[str] | None = None) -> int:
    """Run the executable ``mujoco_plant``; return its exit code."""
    own, ros = split(sys.argv[1:] if argv is None else argv)
    if {"-h", "--help", "--version"} & set(own):
        return run_node.run("mujoco_plant", _nothing, USAGE, own)
    parser = _Parser(add_help=False)
    parser.add_argument("model", type=Path)
    parser.add_argument("--joint", action="append", required=True)
    parser.add_argument("--real-time-factor", type=float)
    parser.add_argument("--motion", type=Path)
    parser.add_argument("--pace", type=float, default=0.0)
    parser.add_argument("--view", action="store_true")
    try:
        options = parser.parse_args(own)
        if options.real_time_factor is not None and not 0.0 < options.real_time_factor < 1e6:
            raise UsageError(f"--real-time-factor {options.real_time_factor:g}: must be > 0")
        if not 0.0 <= options.pace < 1e6 or (options.pace and options.real_time_factor):
            raise UsageError(f"--pace {options.pace:g}: must be > 0, and is for lock step only")
    except UsageError as error:
        print(f"mujoco_plant: {error}", file=sys.stderr)
        return run_node.WRONG_USE

    def make(arguments: Arguments) -> MujocoPlantNode:
        parameters = dict(arguments.parameters)
        if options.real_time_factor is not None:
            period = float(parameters.get("period", 0.001))
            rate = options.real_time_factor / period if period > 0.0 else 0.0
            parameters |= {"plant.lock_step": False, "plant.rate": rate}
        try:
            model = find_model(options.model)
            motion = None if options.motion is None else Motion(options.motion)
        except ModelError as error:
            raise SceneError(str(error)) from None
        return MujocoPlantNode(
            model,
            options.joint,
            parameters,
            arguments.namespace,
            motion,
            options.view,
            options.pace,
        )

    return run_node.run("mujoco_plant", make, USAGE, ros)


def _nothing(_: Arguments) -> NoReturn:
    raise UsageError("no model")


if __name__ == "__main__":
    raise SystemExit(main())
