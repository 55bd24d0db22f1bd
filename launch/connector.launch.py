"""Launch a connector on your topics: ros2 launch cylconn_ros connector.launch.py params_file:=…."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

EXAMPLE = PathJoinSubstitution([FindPackageShare("cylconn_ros"), "config", "connector.yaml"])


def generate_launch_description() -> LaunchDescription:
    """Start the node; it activates itself unless the parameter autostart is false."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file", default_value=EXAMPLE, description="scene and parameters (YAML)"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of the node and its topics"
            ),
            DeclareLaunchArgument("name", default_value="connector", description="node name"),
            DeclareLaunchArgument(
                "log_level", default_value="info", description="debug, info, warn, error or fatal"
            ),
            Node(
                package="cylconn_ros",
                executable="connector",
                name=LaunchConfiguration("name"),
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
                output="screen",
            ),
        ]
    )
