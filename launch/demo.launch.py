"""Launch plant and connector on one scene file, in lock step; ends with the plant."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

DEMO = PathJoinSubstitution([FindPackageShare("cylconn_ros"), "config", "demo.yaml"])


def generate_launch_description() -> LaunchDescription:
    """Start both nodes in one namespace, with the same parameters file."""
    common = {
        "package": "cylconn_ros",
        "namespace": LaunchConfiguration("namespace"),
        "parameters": [LaunchConfiguration("params_file")],
        "output": "screen",
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=DEMO, description="scene of both nodes (YAML)"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of both nodes"
            ),
            Node(executable="connector", name="connector", **common),
            Node(executable="plant", name="plant", on_exit=Shutdown(), **common),
        ]
    )
