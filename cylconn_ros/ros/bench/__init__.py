"""Nodes that the benchmark of nodes starts: who asks, and who answers in other ways than ours."""
