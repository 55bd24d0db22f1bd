"""Solvers that compute the whole motion of a scene, one file each; ``solver`` is the interface.

A solver imports its package when a problem is prepared, so that all solvers can be listed if only
some packages are installed.
"""
