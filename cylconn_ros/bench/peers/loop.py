"""Our closed loop in one compiled call: a step of the connector, a step of the plant, n times."""

from cylconn_ros.core import layout, plant
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import kernel
from cylconn_ros.methods import dispatch as methods


@kernel
def closed(
    method: int, par: Array, of_plant: Array, mem: Array, sample: Array, loads: Array, state: Array,
    a: Array, b: Array, h: float, steps: int, out: Array,
) -> int:  # fmt: skip
    """Move ``state`` (26,) by ``steps`` periods h; the connector's memory in ``mem``.

    Args:
        par, of_plant: the scene in numbers, for the connector and for the plant.
        sample (38,), a (6,), b (6,), out: room to work in. loads (12,): as in a sample.

    Returns the number of steps that were answered with OK.
    """
    good = 0
    for _ in range(steps):
        for k in range(26):
            sample[k] = state[k]
        for k in range(12):
            sample[26 + k] = loads[k]
        if methods.step(method, par, mem, sample, h, out) == 0:
            good += 1
        for k in range(6):
            a[k] = out[layout.FORCE_A + k]
            b[k] = out[layout.FORCE_B + k]
        plant.step(of_plant, state, a, b, loads, h)
    return good
