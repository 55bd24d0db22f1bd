"""The free step of a body: its motion over a period without the connector's wrench."""

from typing import NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.driven_acceleration import driven_acceleration
from cylconn_ros.core.free_gain import is_simulators
from cylconn_ros.core.friction import Array
from cylconn_ros.core.held_step import Load, load_torque
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.rigid_body import Body, Motion, angular_acceleration
from cylconn_ros.core.vectors import (
    Quaternion,
    Vector,
    add,
    add_scaled,
    scale,
    turned,
)


class FreeStep(NamedTuple):
    """A body's free step: the configuration q~ and the end of the free velocity."""

    middle: Motion  # its velocity is not used
    end: Motion  # its configuration is not used
    orientation: Quaternion  # in which a wrench held in body axes has its mean: half of the step


@inline_function
def _driven_step(m: Motion, linear: Vector, angular: Vector, h: float, explicit: bool) -> FreeStep:
    """The free step of a body of infinite inertia, under the acceleration of its samples."""
    if explicit:
        return FreeStep(m, m, m.orientation)
    half_spin = add_scaled(m.spin, 0.25 * h, angular)
    half = turned(m.orientation, scale(0.5 * h, half_spin))
    com = add_scaled(add_scaled(m.com, 0.5 * h, m.velocity), h * h / 6.0, linear)
    velocity, spin = add_scaled(m.velocity, h, linear), add_scaled(m.spin, h, angular)
    return FreeStep(Motion(com, half, velocity, spin), Motion(com, half, velocity, spin), half)


@inline_function
def _free_step(
    par: Array, body: Body, m: Motion, load: Load, to_middle: Vector, h: float, explicit: bool
) -> FreeStep:
    """The free step; ``explicit``: evaluated at its start, as a semi-implicit plant does.

    ``to_middle``: torque that changes the angular velocity until the middle of the step. The torque
    of the load is that in the middle: its point of application turns with the body.
    """
    a = add_scaled(model.vector(par, model.GRAVITY), body.inverse_mass, load.force)
    velocity = add_scaled(m.velocity, h, a)
    half = turned(m.orientation, scale(0.5 * h, m.spin))
    if explicit:
        torque = load_torque(body, m.orientation, load)
        dw = angular_acceleration(body, m.orientation, m.spin, torque)
        end = Motion(m.com, half, velocity, add_scaled(m.spin, h, dw))
        return FreeStep(m, end, m.orientation)
    com = add_scaled(add_scaled(m.com, 0.5 * h, m.velocity), h * h / 6.0, a)
    dw = angular_acceleration(body, m.orientation, m.spin, to_middle)
    torque = load_torque(body, half, load)
    dw = angular_acceleration(body, half, add_scaled(m.spin, 0.5 * h, dw), torque)
    spin = add_scaled(m.spin, h, dw)
    return FreeStep(Motion(com, half, velocity, spin), Motion(com, half, velocity, spin), half)


@inline_function
def free_step(
    par: Array, mem: Array, body: Body, m: Motion, sample: Array, at: int, last: int, h: float,
    explicit: bool,
) -> FreeStep:  # fmt: skip
    """The free step under a load that is given at the origin of the body frame.

    The angular velocity at the middle omits the load's torque, which the connector usually balances
    and whose effect its next step corrects. Where the simulator keeps the constraint, nothing is
    corrected: it includes the load and the wrench of the last step, at ``last`` in ``mem``.
    """
    if not body.free:
        linear, angular = driven_acceleration(mem, last)
        return _driven_step(m, linear, angular, h, explicit)
    load = Load(model.vector(sample, at), model.vector(sample, at + 3), (0.0, 0.0, 0.0))
    to_middle = (0.0, 0.0, 0.0)
    if is_simulators(par):
        torque = load_torque(body, m.orientation, load)
        to_middle = add(torque, model.vector(mem, last + 3))
    return _free_step(par, body, m, load, to_middle, h, explicit)
