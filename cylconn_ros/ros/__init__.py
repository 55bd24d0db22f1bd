"""ROS 2 nodes: connector and plant, with executor, QoS, parameters and diagnostics."""
