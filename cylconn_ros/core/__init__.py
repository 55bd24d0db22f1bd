"""Physics of the connector. Imports NumPy and the compiler only; no ROS, files or clock."""
