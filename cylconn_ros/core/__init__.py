"""The physics of the connector: NumPy and the compiler only, no ROS, no files, no clock."""
