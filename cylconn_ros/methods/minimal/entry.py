"""The compiled step of ``minimal``, with the signature of methods/dispatch.py.

An entry of its own: an integrator makes arrays and takes long to compile, which the users of the
other methods are not to wait for.
"""

from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_kernel
from cylconn_ros.core.latency import is_late
from cylconn_ros.methods.dispatch import AHEAD, begun, ended
from cylconn_ros.methods.minimal import live


@allocating_kernel
def step(_method: int, par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Answer one sample: see :func:`cylconn_ros.methods.dispatch.step`."""
    status = begun(par, mem, sample, h, out)
    if status != 0:
        return status
    now = mem[AHEAD] if is_late(par) else sample
    flags = live.step(par, mem, now, h, out)
    return ended(par, mem, sample, h, flags, out)


@allocating_kernel
def run(method: int, par: Array, mem: Array, samples: Array, h: float, outs: Array) -> None:
    """Answer (N, NSAMPLE) samples in order into (N, NOUT)."""
    for k in range(samples.shape[0]):
        step(method, par, mem, samples[k], h, outs[k])
