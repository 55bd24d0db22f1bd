"""Benchmarks of speed, accuracy and robustness.

Packages: ``common`` (settings, timing, results, report), ``peers`` (solvers to compare with),
``precision`` (error vs. CPU time), ``convergence`` (orders), ``step_cost`` (cost of a step),
``nodes`` (ROS 2 nodes), ``stability`` (difficult conditions), ``faults`` (fault injection).
"""
