"""A free-running simulator: a drawer as a free rigid body, semi-implicit Euler at 500 Hz."""

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node

DT, MASS, INERTIA = 0.002, 2.0, np.array([0.01, 0.02, 0.02])  # s, kg, kg.m^2
GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s^2


class Drawer(Node):
    """Publishes pose and twist in every period and applies the newest wrench."""

    def __init__(self) -> None:
        super().__init__("drawer_simulator")
        self.x, self.q = np.array([0.1, 0.0, 1.0]), np.array([0.0, 0.0, 0.0, 1.0])
        self.v, self.w, self.t = np.zeros(3), np.zeros(3), 0.0
        self.force, self.torque, self.age = None, np.zeros(3), 0  # at rest until one arrives
        self.stamp = self.get_clock().now().to_msg()
        self.pose = self.create_publisher(PoseStamped, "drawer/pose", 10)
        self.twist = self.create_publisher(TwistStamped, "drawer/twist", 10)
        self.create_subscription(WrenchStamped, "drawer/external_wrench", self.on_wrench, 10)
        self.create_timer(DT, self.step)

    def rotation(self) -> np.ndarray:
        """(3, 3) axes of the drawer in the world."""
        (x, y, z), w = self.q[:3], self.q[3]
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.eye(3) + 2 * w * k + 2 * k @ k

    def on_wrench(self, message: WrenchStamped) -> None:
        """Take the newest wrench: body axes, turned into the world's once."""
        f, t = message.wrench.force, message.wrench.torque
        self.force = self.rotation() @ (f.x, f.y, f.z)
        self.torque, self.age = self.rotation() @ (t.x, t.y, t.z), 0

    def step(self) -> None:
        """Move by a period unless wrenches fail to come; publish the state at its time."""
        self.age += 1
        if self.force is not None and self.age <= 5:  # else stand still until one comes
            self.move()
            self.stamp = self.get_clock().now().to_msg()
        pose, twist = PoseStamped(), TwistStamped()
        pose.header.stamp = twist.header.stamp = self.stamp
        pose.header.frame_id = twist.header.frame_id = "world"
        p, o = pose.pose.position, pose.pose.orientation
        (p.x, p.y, p.z), (o.x, o.y, o.z, o.w) = self.x.tolist(), self.q.tolist()
        linear, angular = twist.twist.linear, twist.twist.angular
        (linear.x, linear.y, linear.z) = self.v.tolist()
        (angular.x, angular.y, angular.z) = self.w.tolist()
        self.pose.publish(pose)
        self.twist.publish(twist)

    def move(self) -> None:
        """Integrate one period under wrench, gravity and a hand's push."""
        push = np.array([8.0 * np.sin(1.5 * self.t), 0.0, 0.0])  # pulled out and pushed in
        axes = self.rotation()
        self.v += DT * ((self.force + push) / MASS + GRAVITY)
        self.w += DT * axes @ ((axes.T @ self.torque) / INERTIA)
        self.x += DT * self.v
        (a, b, c), d = 0.5 * DT * self.w, self.q
        self.q += (a * d[3] + b * d[2] - c * d[1], b * d[3] + c * d[0] - a * d[2],
                   c * d[3] + a * d[1] - b * d[0], -a * d[0] - b * d[1] - c * d[2])  # fmt: skip
        self.q /= np.linalg.norm(self.q)
        self.t += DT


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(Drawer())
