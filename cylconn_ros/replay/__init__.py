"""Replay of recordings and comparison of the outputs."""
