"""Identification of a joint's friction from a recorded motion."""
