"""The physics of the cylindrical connector: NumPy and the compiler only, no ROS, no files, no clock."""
