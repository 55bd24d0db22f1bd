"""Independent check of the laws of a step: written from the definitions, without solver code."""
