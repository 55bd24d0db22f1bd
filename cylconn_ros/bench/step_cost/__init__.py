"""Cost of a step, of model features and of start-up."""
