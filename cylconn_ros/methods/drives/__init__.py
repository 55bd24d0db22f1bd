"""Drives, which impose a motion with a greatest force: as bounds of a step, and as springs."""
