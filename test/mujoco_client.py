"""A free-running simulator with its own joint, as a program: MuJoCo's slide and hinge over topics.

Arguments: scene name, period (s), additional lag (samples), greatest simulated time (s). It sends a
sample per period of the wall clock, or later if the machine is busy, and applies the newest wrench.
At the end it prints one line of JSON: whether the body rests, the distance, the start and greatest
energy (J), and the greatest age of an applied wrench (samples).
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from numpy.typing import NDArray
from ros_processes import stamp_of, wrench_of
from scenes import bundled

from cylconn_ros.bench.peers.mujoco_scene import MujocoScene

REST = 5e-3  # m/s
SETTLED = 50  # samples at rest
PATIENCE = 180.0  # s of wall clock without a wrench


class Client:
    """The simulator's node: samples out, wrenches in."""

    def __init__(self, simulator: MujocoScene, period_ns: int) -> None:
        self.node, self.simulator, self.period_ns = (
            rclpy.create_node("simulator"),
            simulator,
            period_ns,
        )
        self.wrenches: list[tuple[int, NDArray[np.float64]]] = []  # number of the sample
        self.pose = self.node.create_publisher(PoseStamped, "body_b/pose", 10)
        self.twist = self.node.create_publisher(TwistStamped, "body_b/twist", 10)
        self.node.create_subscription(WrenchStamped, "body_b/wrench", self._receive, 10)

    def _receive(self, message: WrenchStamped) -> None:
        number = round(stamp_of(message) / self.period_ns)
        self.wrenches.append((number, np.array(wrench_of(message))))

    def spin(self) -> None:
        """Take what has arrived."""
        for _ in range(20):
            rclpy.spin_once(self.node, timeout_sec=0.0)

    def send(self, number: int) -> None:
        """Publish the sample with this number."""
        state = self.simulator.state()[13:]
        pose, twist = PoseStamped(), TwistStamped()
        for header in (pose.header, twist.header):
            header.frame_id = "world"
            header.stamp.sec, header.stamp.nanosec = divmod(number * self.period_ns, 10**9)
        p, q, v, w = (
            pose.pose.position,
            pose.pose.orientation,
            twist.twist.linear,
            twist.twist.angular,
        )
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = map(float, state[:7])
        v.x, v.y, v.z, w.x, w.y, w.z = map(float, state[7:])
        self.pose.publish(pose)
        self.twist.publish(twist)


def main() -> None:
    """Run until the body rests, or to the greatest time."""
    name, period, lag, greatest = sys.argv[1], *map(float, sys.argv[2:5])
    simulator = MujocoScene(dataclasses.replace(bundled(name), period=period), 0.0, "RK4")
    mujoco, model, data = simulator.mujoco, simulator.model, simulator.data
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    rclpy.init()
    client = Client(simulator, round(period * 1e9))
    begin = time.monotonic()
    while not client.wrenches:  # the connector starts: it gets the first sample again
        client.send(0)
        time.sleep(0.05)
        client.spin()
        assert time.monotonic() - begin < PATIENCE, "no wrench"
    body, energy, oldest, rests = model.body("b").id, [], 0, 0
    begin, radius, number = time.monotonic(), simulator.scene.friction.radius, 0
    while rests < SETTLED and number * period < greatest:
        client.send(number)
        while time.monotonic() < begin + (number + 1) * period:
            client.spin()
        client.spin()
        due = [one for one in client.wrenches if one[0] + lag <= number]
        data.xfrc_applied[body] = due[-1][1] if due else 0.0
        oldest = max(oldest, number - due[-1][0] if due else number + 1)
        mujoco.mj_step(model, data)
        energy.append(float(data.energy.sum()))
        slip = float(np.hypot(data.qvel[-2], radius * data.qvel[-1]))
        number, rests = number + 1, rests + 1 if slip < REST else 0
    found = {
        "rests": rests >= SETTLED,
        "distance": simulator.slide()[0],
        "start": energy[0],
        "most": max(energy),
        "age": oldest,
    }
    print(json.dumps(found), flush=True)
    client.node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
