"""Orders of convergence against independent answers."""
