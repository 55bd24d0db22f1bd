"""The closed loop of a method and the exact plant in one compiled call."""

from typing import Any

from cylconn_ros.core import layout, model, plant
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import kernel
from cylconn_ros.methods import dispatch as methods

CHANGING = model.OUTPUT - model.FRICTION
"""Number of parameters that may depend on the preload."""


@kernel
def closed(
    handle: Any, par: Array, plant_par: Array, mem: Array, sample: Array, loads: Array,
    changing: Array, state: Array, a: Array, b: Array, h: float, steps: int, out: Array,
) -> int:  # fmt: skip
    """Advance ``state`` (26,) by ``steps`` periods of length h (s).

    Args:
        handle: of the step function of the method (dispatch.STEPS).
        par, plant_par: parameter arrays of the connector and of the plant.
        mem: memory of the connector, advanced. loads: (12,) as in a sample, or 12 a step.
        changing: (0,), or CHANGING numbers a step: ``par`` from model.FRICTION on, as the preload
            of the step makes them.
        sample (38,), a (6,), b (6,), out: work arrays.

    Returns the number of steps with status OK.
    """
    good = 0
    for step in range(steps):
        for k in range(26):
            sample[k] = state[k]
        at = 12 * step if loads.shape[0] > 12 else 0
        for k in range(12):
            sample[26 + k] = loads[at + k]
        if changing.shape[0] > 0:
            for k in range(CHANGING):
                par[model.FRICTION + k] = changing[CHANGING * step + k]
        if methods.step(handle, par, mem, sample, h, out) == 0:
            good += 1
        for k in range(6):
            a[k] = out[layout.FORCE_A + k]
            b[k] = out[layout.FORCE_B + k]
        plant.step(plant_par, state, a, b, loads[at : at + 12], h)
    return good
