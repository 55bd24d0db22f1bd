"""Child processes, and interruption of this one: used by commands and benchmarks."""
