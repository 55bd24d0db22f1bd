"""Faults put upon real processes: a node, a plant, and a peer that sends what it should not."""
