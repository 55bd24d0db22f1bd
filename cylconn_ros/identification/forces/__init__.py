"""Motion and forces of a recorded joint: intervals, segments, windows, known drives."""
