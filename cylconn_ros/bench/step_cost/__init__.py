"""Cost of a step, of each model feature, and of the start-up."""
