"""Recorded messages through the connector again, and the comparison with what was recorded."""
