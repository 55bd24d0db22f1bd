#!/bin/bash
# Environment of the container: ROS 2, the Python packages, cylconn_ros; then the command.
set -e
# shellcheck source=/dev/null
source "/opt/ros/${ROS_DISTRO}/setup.bash"
# shellcheck source=/dev/null
source /opt/cylconn_ros/local_setup.bash
# shellcheck source=/dev/null
source /opt/venv/bin/activate
export PATH="/opt/cylconn_ros/lib/cylconn_ros:${PATH}"
exec "$@"
