"""The plant node: two rigid bodies that stand in for a simulator."""
