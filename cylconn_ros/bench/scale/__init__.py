"""Cost of sweeps and archives, and where what runs them saturates."""
