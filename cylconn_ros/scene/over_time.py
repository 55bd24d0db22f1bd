"""What changes over time in a scene: which quantity each amplitude multiplies, and the rules.

The amplitudes belong to the plant: it applies the loads, and commands preload and motion or force
of slide and spin as a machine's controller would, with the messages of ``~/preload`` and
``~/command``. The connector takes them as its inputs; it knows no time.
"""

from __future__ import annotations

import itertools
import math

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.amplitude import Amplitude
from cylconn_ros.scene.behaviour import Imposed
from cylconn_ros.scene.fields import SceneFields
from cylconn_ros.scene.schema import show

LEAST_SAMPLES = 4.0  # of a period of a sine


def loads(scene: SceneFields) -> tuple[Amplitude, Amplitude]:
    """Of the loads on A and B."""
    return scene.plant.body_a.load_amplitude, scene.plant.body_b.load_amplitude


def commands(scene: SceneFields) -> tuple[Amplitude, Amplitude]:
    """Of the imposed motion or force of slide and spin."""
    return scene.plant.slide_amplitude, scene.plant.spin_amplitude


def amplitudes(scene: SceneFields) -> dict[str, Amplitude]:
    """Every amplitude by the name of its group."""
    plant = scene.plant
    return {
        "plant.body_a.load_amplitude": plant.body_a.load_amplitude,
        "plant.body_b.load_amplitude": plant.body_b.load_amplitude,
        "plant.preload_amplitude": plant.preload_amplitude,
        "plant.slide_amplitude": plant.slide_amplitude,
        "plant.spin_amplitude": plant.spin_amplitude,
    }


def changes(scene: SceneFields) -> bool:
    """Whether a quantity of the scene changes over time."""
    return any(each.on for each in amplitudes(scene).values())


def check_over_time(scene: SceneFields) -> None:
    """Raise :class:`SceneError` for amplitudes that cannot be, or that multiply nothing."""
    for name, each in amplitudes(scene).items():
        _check_values(scene, name, each)
    for body, each, load in (
        ("body_a", loads(scene)[0], scene.plant.body_a.load),
        ("body_b", loads(scene)[1], scene.plant.body_b.load),
    ):
        if each.on and not any(load):
            raise SceneError(
                f"plant.{body}.load_amplitude: needs plant.{body}.load, which it multiplies"
            )
    if scene.plant.preload_amplitude.on:
        if not scene.friction.on:
            raise SceneError("plant.preload_amplitude: needs friction, on which the preload acts")
        if scene.friction.preload == 0.0:
            raise SceneError("plant.preload_amplitude: needs friction.preload, which it multiplies")
    for k, component in enumerate(("slide", "spin")):
        if commands(scene)[k].on:
            _check_command(scene, component, commands(scene)[k])


def _check_values(scene: SceneFields, name: str, each: Amplitude) -> None:
    if each.times and not math.isnan(each.frequency):
        raise SceneError(
            f"{name}.frequency = {show(each.frequency)}: must not be given together with "
            f"{name}.times; an amplitude is a table or a sine"
        )
    if len(each.values) != len(each.times):
        raise SceneError(
            f"{name}.values = {show(each.values)}: must be as many numbers as {name}.times "
            f"({len(each.values)} and {len(each.times)} given)"
        )
    if len(each.times) == 1:
        raise SceneError(f"{name}.times = {show(each.times)}: must be at least 2 numbers")
    if any(not low < high for low, high in itertools.pairwise(each.times)):
        raise SceneError(f"{name}.times = {show(each.times)}: must be ascending")
    if not each.times and math.isnan(each.frequency):
        given = {"mean": 0.0, "amplitude": 1.0, "phase": 0.0}
        for key, default in given.items():
            if getattr(each, key) != default:
                raise SceneError(
                    f"{name}.{key} = {show(getattr(each, key))}: needs {name}.frequency"
                )
    if scene.period > 0.0 and each.frequency * scene.period * LEAST_SAMPLES > 1.0:  # False for NaN
        most = 1.0 / (LEAST_SAMPLES * scene.period)
        raise SceneError(
            f"{name}.frequency = {show(each.frequency)}: must be at most {most:g} Hz, so that a "
            f"cycle has {LEAST_SAMPLES:g} periods ({show(scene.period)} s); give a shorter period"
        )


def _check_command(scene: SceneFields, component: str, factor: Amplitude) -> None:
    name, command = f"plant.{component}_amplitude", f"command.{component}"
    imposed: Imposed = getattr(scene.command, component)
    given = [x for x in (imposed.position, imposed.velocity, imposed.force) if not math.isnan(x)]
    if not any(given):
        raise SceneError(
            f"{name}: needs {command}.position, velocity or force, which it multiplies"
        )
    if not math.isnan(imposed.position) and not math.isnan(imposed.velocity):
        raise SceneError(
            f"{command}.velocity = {show(imposed.velocity)}: must not be given with a position and "
            f"{name}: the rate is that of the position over time"
        )
    stops = scene.stops
    low, high = (
        (stops.l_min, stops.l_max) if component == "slide" else (stops.theta_min, stops.theta_max)
    )
    if math.isnan(imposed.position):
        return
    for share in factor.range:
        position = share * imposed.position
        if position < low or position > high:  # False for NaN
            raise SceneError(
                f"{name}: takes the position of {component} to {position:g}, beyond its stop at "
                f"{show(low if position < low else high)}"
            )
