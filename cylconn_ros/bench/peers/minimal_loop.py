"""The closed loop of ``minimal``, as ``loop`` is that of the others: it takes long to compile."""

from cylconn_ros.core import layout, plant
from cylconn_ros.core.compiled import entry_that_allocates
from cylconn_ros.core.friction import Array
from cylconn_ros.methods import minimal_step


@entry_that_allocates
def closed(
    method: int, par: Array, of_plant: Array, mem: Array, sample: Array, loads: Array, state: Array,
    a: Array, b: Array, h: float, steps: int, out: Array,
) -> int:  # fmt: skip
    """As :func:`cylconn_ros.bench.peers.loop.closed`."""
    good = 0
    for _ in range(steps):
        for k in range(26):
            sample[k] = state[k]
        for k in range(12):
            sample[26 + k] = loads[k]
        if minimal_step.step(method, par, mem, sample, h, out) == 0:
            good += 1
        for k in range(6):
            a[k] = out[layout.FORCE_A + k]
            b[k] = out[layout.FORCE_B + k]
        plant.step(of_plant, state, a, b, loads, h)
    return good
