"""Recorded runs: rosbag2 directories (metadata.yaml, MCAP), written and read without a graph."""
