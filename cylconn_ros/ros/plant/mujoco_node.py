"""Node with a MuJoCo model in place of the plant's two bodies; see ``mujoco_plant --help``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from cylconn_ros.errors import ModelError, SceneError
from cylconn_ros.mujoco.plant import MujocoPlant
from cylconn_ros.ros import run_node
from cylconn_ros.ros.arguments import Arguments, UsageError, split
from cylconn_ros.ros.plant.node import PlantNode

USAGE = """\
usage: mujoco_plant MODEL --joint NAME [--joint NAME] [--real-time-factor X]
                    --ros-args --params-file FILE [-p NAME:=VALUE] [-r FROM:=TO] ...

An MJCF or URDF model in MuJoCo as the simulator of a connector. NAME is a slide or a hinge (its
partner on the same axis and body goes with it); body_b.frame in FILE is the name of its body,
body_a.frame that of the other one. FILE is the connector's, as `cylconn import` writes it.
constraint: simulator keeps the joint and applies only what the connector sends along and about it;
constraint: connector removes the joint from a copy of the model.
plant.lock_step (default true), plant.rate, plant.duration, plant.timeout as for the executable
plant; --real-time-factor sets plant.rate and free running. The time goes out on /clock; actuators
of the model take sensor_msgs/JointState on ~/joint_command, by the names of actuators or joints.
Exit codes as for plant."""


class MujocoPlantNode(PlantNode):
    """Step a MuJoCo model in lock step with a connector, or free running.

    Raises SceneError at construction if parameters, model or joint are not usable.
    """

    EXECUTABLE = "mujoco_plant"

    def __init__(
        self, model: Path, joints: Sequence[str], parameters: Mapping[str, Any],
        namespace: str = "/", **node_arguments: Any,
    ) -> None:  # fmt: skip
        self._model, self._joints = model, joints
        self._unknown: set[str] = set()
        super().__init__(parameters, namespace, **node_arguments)
        self._clock_out = self.create_publisher(Clock, "/clock", 10)
        self.create_subscription(JointState, "~/joint_command", self._command, 10)

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
        return self._simulator

    def _send(self, first: bool = False) -> None:
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(self.plant.time_ns, 10**9)
        self._clock_out.publish(clock)
        super()._send(first)

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
    try:
        options = parser.parse_args(own)
        if options.real_time_factor is not None and not 0.0 < options.real_time_factor < 1e6:
            raise UsageError(f"--real-time-factor {options.real_time_factor:g}: must be > 0")
    except UsageError as error:
        print(f"mujoco_plant: {error}", file=sys.stderr)
        return run_node.WRONG_USE

    def make(arguments: Arguments) -> MujocoPlantNode:
        parameters = dict(arguments.parameters)
        if options.real_time_factor is not None:
            period = float(parameters.get("period", 0.001))
            rate = options.real_time_factor / period if period > 0.0 else 0.0
            parameters |= {"plant.lock_step": False, "plant.rate": rate}
        return MujocoPlantNode(options.model, options.joint, parameters, arguments.namespace)

    return run_node.run("mujoco_plant", make, USAGE, ros)


def _nothing(_: Arguments) -> NoReturn:
    raise UsageError("no model")


if __name__ == "__main__":
    raise SystemExit(main())
