"""Benchmarks of nodes: processes that send samples and nodes that process them."""
