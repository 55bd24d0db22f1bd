"""Serialized ROS messages to samples and back, without rclpy."""
