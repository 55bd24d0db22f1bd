"""Plant node: two rigid bodies in place of a simulator."""
