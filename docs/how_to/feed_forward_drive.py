"""A simulated drive follows a sine over topics, first without and then with the feed-forward.

Needs the connector: ros2 run cylconn_ros connector --ros-args --params-file feed_forward_drive.yaml
"""

import math

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

H, MASS, AMPLITUDE, RATE = 0.001, 2.0, 0.05, 2 * math.pi  # s, kg, m, rad/s
P, D = 800.0, 40.0  # N/m, N.s/m
PASS = 2000  # samples


class Drive(Node):
    """Slide and controller in lock step: a step when wrench and feed-forward have its stamp."""

    def __init__(self) -> None:
        super().__init__("drive")
        self.pose = self.create_publisher(PoseStamped, "body_b/pose", 50)
        self.twist = self.create_publisher(TwistStamped, "body_b/twist", 50)
        self.load = self.create_publisher(WrenchStamped, "body_b/load", 50)
        self.reference = self.create_publisher(JointState, "connector/reference", 50)
        self.create_subscription(WrenchStamped, "body_b/wrench", self.on_wrench, 50)
        self.create_subscription(JointState, "connector/feed_forward", self.on_feed_forward, 50)
        self.create_timer(0.5, self.begin)
        self.k, self.x, self.v, self.effort = 0, 0.0, 0.0, 0.0
        self.wrench = self.feed_forward = None
        self.errors = ([], [])  # without and with the feed-forward, m
        self.done = rclpy.Future()

    def begin(self) -> None:
        """Repeat the first sample until the connector answers it."""
        if self.k == 0:
            self.send()

    def stamp(self, message):
        """Give a message the stamp of the present sample."""
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.k * 1_000_000, 10**9)
        message.header.frame_id = "world"
        return message

    def send(self) -> None:
        """Publish the sample, with the drive's effort as load, and the rate that comes next."""
        pose, twist, load = PoseStamped(), TwistStamped(), WrenchStamped()
        pose.pose.position.x, twist.twist.linear.x = self.x, self.v
        load.wrench.force.x = self.effort
        rate = AMPLITUDE * RATE * math.cos(RATE * (self.k + 1) * H)
        self.reference.publish(JointState(name=["slide"], velocity=[rate]))
        self.load.publish(self.stamp(load))
        self.pose.publish(self.stamp(pose))
        self.twist.publish(self.stamp(twist))

    def on_wrench(self, message: WrenchStamped) -> None:
        """Take the force of the connector along the rail."""
        if message.header.stamp == self.stamp(WrenchStamped()).header.stamp:
            self.wrench = message.wrench.force.x
            self.step()

    def on_feed_forward(self, message: JointState) -> None:
        """Take the effort that friction takes."""
        if message.header.stamp == self.stamp(JointState()).header.stamp:
            self.feed_forward = message.effort[0]
            self.step()

    def step(self) -> None:
        """Move by a period, and compute the effort of the next: motion, errors, friction."""
        if self.wrench is None or self.feed_forward is None:
            return
        self.v += H * (self.wrench + self.effort) / MASS
        self.x += H * self.v
        self.k += 1
        angle = RATE * self.k * H
        error = AMPLITUDE * math.sin(angle) - self.x
        self.effort = -MASS * AMPLITUDE * RATE**2 * math.sin(angle)
        self.effort += P * error + D * (AMPLITUDE * RATE * math.cos(angle) - self.v)
        self.effort += self.feed_forward if self.k >= PASS else 0.0
        self.wrench = self.feed_forward = None
        if self.k % PASS >= PASS // 2:  # the first second of each is left out
            self.errors[self.k // PASS].append(abs(error))
        if self.k == 2 * PASS - 1:
            self.done.set_result(None)
        else:
            self.send()


if __name__ == "__main__":
    rclpy.init()
    drive = Drive()
    rclpy.spin_until_future_complete(drive, drive.done)
    for name, errors in zip(("without", "with"), drive.errors, strict=True):
        print(f"greatest error {name} feed-forward: {1e3 * max(errors):.2f} mm")
    rclpy.shutdown()
