"""Orders of convergence against independent reference solutions."""
