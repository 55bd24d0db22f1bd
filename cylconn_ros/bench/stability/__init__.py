"""Stability map: under which hard conditions each solver survives, from the bodies' motion.

``conditions`` defines the hard conditions, ``solvers`` the solvers, ``criteria`` the survival
criteria. ``measure`` runs the grid and ``picture`` prints and draws it.
"""
