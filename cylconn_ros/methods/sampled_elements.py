"""Springs, tables and compliant stops in methods that take forces from the sample.

The force is that of the position expected in the middle of the step, x + h w/2, on an exact plant,
and that of the sample on a semi-implicit one, whose rates lie between its positions. Both conserve
energy on the mean, up to a stiffness of 4 m/h^2; a force of the sample would add it on an exact
plant.
"""

from cylconn_ros.core import model
from cylconn_ros.core.elements import ElementForces, elements_at
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.relative_state import RelativeState


@inline_function
def elongation(par: Array, mem: Array, o: RelativeState, h: float, k: int) -> tuple[float, float]:
    """Elongation and position, of slide (k = 0) or spin (1), at which springs act in the step."""
    x, w = (o.length, o.twist.v[0]) if k == 0 else (o.angle, o.twist.w[0])
    if not model.output(par).semi_implicit:
        x += 0.5 * h * w
    return x - model.value_or(par[model.REFERENCE + 2 + k], mem[model.LENGTH0 + k]), x


@device_function
def sampled_elements(par: Array, mem: Array, o: RelativeState, h: float, k: int) -> ElementForces:
    """Forces of the elements of slide (k = 0) or spin (1)."""
    if par[model.ELEMENTS + k] == 0.0:
        return ElementForces(0.0, 0.0, 0.0, 0, 0.0)
    u, x = elongation(par, mem, o, h, k)
    w = o.twist.v[0] if k == 0 else o.twist.w[0]
    return elements_at(par, model.ELEMENTS, k, u, x, w)
