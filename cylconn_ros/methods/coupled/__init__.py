"""Connectors that share bodies: their step, solved together."""
