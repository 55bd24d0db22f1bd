"""Reference values of the bundled scenes of several connectors, and the library of these scenes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

from cylconn_ros.connector.outputs import column
from cylconn_ros.reference.answers import Expected
from cylconn_ros.reference.element_answers import one_slide
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.group import GroupRun

Scenes = Mapping[str, Scene]


@dataclasses.dataclass(frozen=True)
class GroupCase:
    """A scene of several connectors with reference values.

    Attributes
    ----------
        title: what happens in the scene.
        source: of the reference values.
        answer: computes them from the scenes by name, with any period, and the time of the last
            sample (s).
    """

    title: str
    source: str
    answer: Callable[[Scenes, float], Sequence[Expected]]


def _last(scenes: Scenes, name: str, field: str) -> Callable[[GroupRun], float]:
    """Computes the last value of a field of the connector ``name``."""
    place = list(scenes).index(name)
    return lambda run: float(column(run.outs[-1, place], field))


def drawer_on_two_rails(scenes: Scenes, end: float) -> list[Expected]:
    """One slide with the friction of both rails, mu m g, and the elements of one of them.

    The mass centre is between the rails and the rails have no overlap: however they share weight
    and couples, their normal forces add up to the weight.
    """
    right = scenes["right"]
    found = one_slide(right, end)
    moved = found.position - right.initial_pose(1)[0]
    weight = right.body_b.mass * abs(right.gravity[2])
    return [
        Expected("left distance", "m", _last(scenes, "left", "displacement"), moved, 2e-7),
        Expected("right distance", "m", _last(scenes, "right", "displacement"), moved, 2e-7),
        Expected("left load", "N", _last(scenes, "left", "normal_force"), weight / 2.0, 0.0, 0.0),
        Expected("stop", "N", _last(scenes, "right", "force_reaction"), found.reaction, 1e-4),
    ]


def telescope_of_two_stages(scenes: Scenes, _end: float) -> list[Expected]:
    """Work and momentum: the shaft slides to its stop, takes the ring along, and both stop.

    With the contact's middle half the slide u before node b, the weights W = sum of m g at the
    distances x from node b bend a stage of overlap L0 by sum of m g (x + u/2), so that its friction
    is mu (W + 2 (C + W u/2)/(L0 - u)), C = sum of m g x.
    """
    outer, inner = scenes["outer"], scenes["inner"]
    ring, shaft, gravity = outer.body_b, inner.body_b, abs(inner.gravity[2])
    pull = inner.plant.body_b.load[0]
    start = inner.initial_pose(1)[0] - inner.initial_pose(0)[0]
    out = inner.stops.l_max - start

    def friction_work(scene: Scene, weight: float, couple: float, u: float) -> float:
        f = scene.friction
        log = math.log(f.overlap / (f.overlap - u))
        bent = (couple + 0.5 * weight * f.overlap) * log - 0.5 * weight * u
        return f.coefficient * (weight * u + 2.0 * bent)

    weight = shaft.mass * gravity
    energy = 0.5 * shaft.mass * inner.plant.body_b.twist[0] ** 2 + pull * out
    energy -= friction_work(inner, weight, weight * shaft.com[0], out)
    speed = math.sqrt(2.0 * energy / shaft.mass)  # with which the shaft meets its stop
    both = ring.mass + shaft.mass
    left = 0.5 * (shaft.mass * speed) ** 2 / both
    couple = gravity * (ring.mass * ring.com[0] + shaft.mass * (start + out + shaft.com[0]))
    low, high = 0.0, outer.friction.overlap * (1.0 - 1e-12)
    for _ in range(200):
        u = 0.5 * (low + high)
        spent = friction_work(outer, both * gravity, couple, u) - pull * u
        low, high = (u, high) if spent < left else (low, u)
    return [
        Expected("shaft's slide", "m", _last(scenes, "inner", "displacement"), out, 0.0, 0.0),
        # an impact at which another connector begins to slip is first order
        Expected("ring's slide", "m", _last(scenes, "outer", "displacement"), low, 4e-4, 1.0),
        Expected("stop", "N", _last(scenes, "inner", "force_reaction"), -pull, 0.0, 0.0),
    ]


GROUPS: dict[str, GroupCase] = {
    "drawer_on_two_rails": GroupCase(
        "A drawer on two rails, one of them with soft-close, is pushed shut",
        "one slide with the friction of both, DOP853 (reference/nonlinear_slide.py)",
        drawer_on_two_rails,
    ),
    "telescope_of_two_stages": GroupCase(
        "A telescope of two stages is drawn out: the shaft takes the ring along",
        "closed form: work of the friction of each stage, momentum at the stop",
        telescope_of_two_stages,
    ),
}
"""All scene files of config/ with several connectors."""
