"""Launch a MuJoCo model and a recording connector on one scene; ends with the model."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

MODEL = PathJoinSubstitution([FindPackageShare("cylconn_ros"), "models", "cabinet_drawer.xml"])


def generate_launch_description() -> LaunchDescription:
    """Start both nodes with the same parameters file; the connector records the run."""
    parameters = LaunchConfiguration("params_file")
    record = {"record.enabled": LaunchConfiguration("record")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", description="scene, of `cylconn import` (YAML)"),
            DeclareLaunchArgument("model", default_value=MODEL, description="MJCF or URDF"),
            DeclareLaunchArgument("joint", default_value="slide", description="joint of the model"),
            DeclareLaunchArgument("record", default_value="true", description="record the run"),
            Node(
                package="cylconn_ros",
                executable="connector",
                name="connector",
                parameters=[parameters, record],
                output="screen",
            ),
            Node(
                package="cylconn_ros",
                executable="mujoco_plant",
                name="mujoco_plant",
                arguments=[LaunchConfiguration("model"), "--joint", LaunchConfiguration("joint")],
                parameters=[parameters],
                on_exit=Shutdown(),
                output="screen",
            ),
        ]
    )
