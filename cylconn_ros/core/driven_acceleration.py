"""Acceleration of a driven body, from its samples."""

from typing import Final

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.core.vectors import Vector, dot, norm, scale, sub

ROUNDING: Final = 1e-13  # relative


@inline_function
def driven_acceleration(mem: Array, last: int) -> tuple[Vector, Vector]:
    """Linear and angular acceleration of a driven body, world axes; ``last``: LAST_A or LAST_B."""
    at = model.ACCELERATIONS + (12 if last == model.LAST_A else 18)
    return model.vector(mem, at), model.vector(mem, at + 3)


@inline_function
def _lesser(a: Vector, b: Vector) -> Vector:
    """The shorter of two accelerations in succession; zero if they oppose each other."""
    if dot(a, b) <= 0.0:
        return (0.0, 0.0, 0.0)
    return a if dot(a, a) <= dot(b, b) else b


@inline_function
def _rate_of_change(before: Vector, now: Vector, size: float, h: float) -> Vector:
    """Change over h; zero if it is rounding of terms of the magnitude ``size``."""
    change = sub(now, before)
    return scale(1.0 / h, change) if norm(change) > ROUNDING * size else (0.0, 0.0, 0.0)


@device_function
def update_acceleration(mem: Array, m: Motion, k: int, h: float) -> None:
    """Update the acceleration of a driven body from its last three samples.

    A single jump of velocity is not continued: the lesser of the last two accelerations is used. It
    is zero for the first samples, and at a sample whose motion contradicts the twists.
    """
    at, used = model.ACCELERATIONS + 6 * k, model.ACCELERATIONS + 12 + 6 * k
    before = model.vector(mem, model.LAST_VELOCITIES + 3 * k)
    spin = model.vector(mem, (model.LAST_A if k == 0 else model.LAST_B) + 9)
    zero = (0.0, 0.0, 0.0)
    linear, angular, use = zero, zero, (zero, zero)
    known = h > 0.0 and mem[model.JUMPED] == 0.0 and mem[model.CONTRADICTED] == 0.0
    if known:
        turning = norm(m.spin) + norm(spin)
        size = norm(m.velocity) + norm(before) + turning * norm(m.com)
        linear = _rate_of_change(before, m.velocity, size, h)
        angular = _rate_of_change(spin, m.spin, turning, h)
        use = (
            _lesser(linear, model.vector(mem, at)),
            _lesser(angular, model.vector(mem, at + 3)),
        )
    model.write_vector(mem, at, linear)
    model.write_vector(mem, at + 3, angular)
    model.write_vector(mem, used, use[0])
    model.write_vector(mem, used + 3, use[1])
