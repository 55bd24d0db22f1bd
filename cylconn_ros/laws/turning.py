"""Turn of free bodies under a constant torque and a load, row by row, compiled.

Runge-Kutta-Munthe-Kaas of fourth order, the definition of the exact plant's rotation, written
independently of the solver: quaternions x y z w, vectors and symmetric tensors as scalars. Most
rows need a few steps, some hundreds: arrays would make all rows wait for those.
"""

import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import inline_function, kernel

Array = NDArray[np.float64]
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]


@inline_function
def _plus(a: Three, s: float, b: Three) -> Three:
    """Return a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@inline_function
def _cross(a: Three, b: Three) -> Three:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline_function
def _apply(t: Array, i: int, a: Three) -> Three:
    """The tensor t[i] times a."""
    return (
        t[i, 0, 0] * a[0] + t[i, 0, 1] * a[1] + t[i, 0, 2] * a[2],
        t[i, 1, 0] * a[0] + t[i, 1, 1] * a[1] + t[i, 1, 2] * a[2],
        t[i, 2, 0] * a[0] + t[i, 2, 1] * a[1] + t[i, 2, 2] * a[2],
    )


@inline_function
def _rotated(q: Four, a: Three) -> Three:
    """The vector a of the turned frame in the outer frame; with -q[3]: the inverse."""
    v = (q[0], q[1], q[2])
    across = _cross(v, a)
    return _plus(_plus(a, 2.0 * q[3], across), 2.0, _cross(v, across))


@inline_function
def _into(q: Four, a: Three) -> Three:
    return _rotated((q[0], q[1], q[2], -q[3]), a)


@inline_function
def _turned(q: Four, s: float, u: Three) -> Four:
    """The orientation q after the rotation vector s u."""
    size = 0.5 * s * math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    half = 0.5 * s * (math.sin(size) / size if size != 0.0 else 1.0)
    a, t = (half * u[0], half * u[1], half * u[2]), math.cos(size)
    v = (q[0], q[1], q[2])
    c = _cross(a, v)
    x, y, z = (t * v[0] + q[3] * a[0] + c[0], t * v[1] + q[3] * a[1] + c[1],
               t * v[2] + q[3] * a[2] + c[2])  # fmt: skip
    w = t * q[3] - a[0] * v[0] - a[1] * v[1] - a[2] * v[2]
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


@inline_function
def _spin(inverse: Array, i: int, q: Four, momentum: Three) -> Three:
    return _rotated(q, _apply(inverse, i, _into(q, momentum)))


@inline_function
def _rate(s: float, u: Three, w: Three) -> Three:
    """Rate of the rotation vector s u for the angular velocity w, to fourth order."""
    across = _cross(u, w)
    return _plus(_plus(w, -0.5 * s, across), s * s / 12.0, _cross(u, across))


@inline_function
def _mean(a: Three, b: Three, c: Three, d: Three) -> Three:
    return (
        (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0]) / 6.0,
        (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1]) / 6.0,
        (a[2] + 2.0 * b[2] + 2.0 * c[2] + d[2]) / 6.0,
    )


@inline_function
def _torque(com: Three, q: Four, torque: Three, pull: Three) -> Three:
    """The torque about the mass centre, with that of a force at the origin of the body frame."""
    return _plus(torque, -1.0, _cross(_rotated(q, com), pull))


@kernel
def turn(
    com: Array,
    inertia: Array,
    inverse: Array,
    torque: Array,
    pull: Array,
    step: Array,
    steps: NDArray[np.int64],
    orientation: Array,
    spin: Array,
) -> None:
    """Turn bodies by ``steps`` (n,) steps of ``step`` (n,), s; orientation and spin are updated.

    com: (n, 3) m, inertia and inverse: (n, 3, 3), body axes. torque, pull, spin: (n, 3), world
    axes; orientation: (n, 4).
    """
    for i in range(len(steps)):
        dt = step[i]
        q = (orientation[i, 0], orientation[i, 1], orientation[i, 2], orientation[i, 3])
        at = (com[i, 0], com[i, 1], com[i, 2])
        outer = (torque[i, 0], torque[i, 1], torque[i, 2])
        load = (pull[i, 0], pull[i, 1], pull[i, 2])
        w = _into(q, (spin[i, 0], spin[i, 1], spin[i, 2]))
        momentum = _rotated(q, _apply(inertia, i, w))
        for _ in range(steps[i]):
            t1, k1 = _torque(at, q, outer, load), _spin(inverse, i, q, momentum)
            q2 = _turned(q, 0.5 * dt, k1)
            t2 = _torque(at, q2, outer, load)
            w2 = _spin(inverse, i, q2, _plus(momentum, 0.5 * dt, t1))
            k2 = _rate(0.5 * dt, k1, w2)
            q3 = _turned(q, 0.5 * dt, k2)
            t3 = _torque(at, q3, outer, load)
            w3 = _spin(inverse, i, q3, _plus(momentum, 0.5 * dt, t2))
            k3 = _rate(0.5 * dt, k2, w3)
            q4 = _turned(q, dt, k3)
            t4 = _torque(at, q4, outer, load)
            k4 = _rate(dt, k3, _spin(inverse, i, q4, _plus(momentum, dt, t3)))
            q = _turned(q, dt, _mean(k1, k2, k3, k4))
            momentum = _plus(momentum, dt, _mean(t1, t2, t3, t4))
        w = _spin(inverse, i, q, momentum)
        for j in range(4):
            orientation[i, j] = q[j]
        for j in range(3):
            spin[i, j] = w[j]
