"""Coverage of the intervals of identification, and an axis with published parameters."""
