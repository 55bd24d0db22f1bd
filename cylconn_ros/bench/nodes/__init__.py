"""Benchmarks of nodes: processes that send samples and nodes that answer them."""
