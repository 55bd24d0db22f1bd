"""The closed loop of a method and the exact plant in one compiled call."""

from typing import Any

from cylconn_ros.core import layout, plant
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import kernel
from cylconn_ros.methods import dispatch as methods


@kernel
def closed(
    handle: Any, par: Array, plant_par: Array, mem: Array, sample: Array, loads: Array,
    state: Array, a: Array, b: Array, h: float, steps: int, out: Array,
) -> int:  # fmt: skip
    """Advance ``state`` (26,) by ``steps`` periods of length h (s).

    Args:
        handle: of the step function of the method (dispatch.STEPS).
        par, plant_par: parameter arrays of the connector and of the plant.
        mem: memory of the connector, advanced. loads (12,): as in a sample.
        sample (38,), a (6,), b (6,), out: work arrays.

    Returns the number of steps with status OK.
    """
    good = 0
    for _ in range(steps):
        for k in range(26):
            sample[k] = state[k]
        for k in range(12):
            sample[26 + k] = loads[k]
        if methods.step(handle, par, mem, sample, h, out) == 0:
            good += 1
        for k in range(6):
            a[k] = out[layout.FORCE_A + k]
            b[k] = out[layout.FORCE_B + k]
        plant.step(plant_par, state, a, b, loads, h)
    return good
