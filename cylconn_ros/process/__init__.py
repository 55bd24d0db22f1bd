"""Child processes and interruption: what commands and benchmarks share."""
