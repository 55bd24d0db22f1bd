"""Recorded runs as rosbag2 directories (metadata.yaml, MCAP): writer, reader, recovery, samples."""
