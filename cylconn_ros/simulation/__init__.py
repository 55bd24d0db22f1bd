"""Closed loop of plant and connector in process, and whole motions in joint coordinates."""
