"""Many recordings: one task a recording, its results in a dataset, what changed since."""
