"""Reference solutions for the connector; they share no code with its methods.

Closed forms, and equations reduced analytically to few unknowns that SciPy integrates (extra
``demo``).
"""

from cylconn_ros.reference.closed_forms import coast, constant_normal_force
from cylconn_ros.reference.fixed_shaft import Reference, slide_and_spin
from cylconn_ros.reference.free_pair import Pair, free_pair

__all__ = ["Pair", "Reference", "coast", "constant_normal_force", "free_pair", "slide_and_spin"]
