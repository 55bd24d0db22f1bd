"""The ROS rooms: conversions, nodes and diagnostics; the only place that knows ROS."""
