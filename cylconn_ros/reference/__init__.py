"""Independent solutions to hold the connector against; they share nothing with its methods.

The equations are reduced by hand to slide and spin and integrated by SciPy (extra ``demo``).
"""

from cylconn_ros.reference.closed_forms import coast, constant_normal_force
from cylconn_ros.reference.fixed_shaft import Reference, slide_and_spin
from cylconn_ros.reference.free_pair import Pair, free_pair

__all__ = ["Pair", "Reference", "coast", "constant_normal_force", "free_pair", "slide_and_spin"]
