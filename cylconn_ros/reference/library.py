"""Library of the bundled scenes: motion, reference values and their source for each scene file.

``cylconn simulate`` prints the comparison with it, tests and benchmarks use its values, and it
writes docs/reference/scenes.md (``python -m cylconn_ros.reference.library >
docs/reference/scenes.md``).
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence

from cylconn_ros.reference import answers, element_answers, over_time_answers, sleeve_answers
from cylconn_ros.reference.answers import Expected
from cylconn_ros.reference.group_answers import GROUPS
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.group import GroupRun
from cylconn_ros.simulation.simulate import Run


@dataclasses.dataclass(frozen=True)
class Case:
    """A scene with reference values.

    Attributes
    ----------
        title: what happens in the scene.
        source: of the reference values.
        answer: computes them from the scene, with any period, and the time of the last sample (s).
    """

    title: str
    source: str
    answer: Callable[[Scene, float], Sequence[Expected]]


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Comparison of one quantity of a run with its reference value."""

    name: str
    unit: str
    value: float
    expected: float
    allowed: float

    @property
    def error(self) -> float:
        """Absolute error; NaN if the value is NaN."""
        return abs(self.value - self.expected)

    @property
    def ok(self) -> bool:
        """Whether the error is allowed; False for NaN."""
        return self.error <= self.allowed


CLOSED = "closed form"
INTEGRATED = "sleeve on a fixed shaft, DOP853 with events (reference/moving_contact.py)"
EVENTS = "m x'' = F(x, x') from kink to kink, DOP853 (reference/nonlinear_slide.py)"

LIBRARY: dict[str, Case] = {
    "demo": Case(
        "An unbalanced sleeve slides and spins down an incline until friction stops it",
        "reduced equations, DOP853 (reference/fixed_shaft.py)",
        answers.reduced_to_rest,
    ),
    "coast": Case("Coast on a loaded sleeve", f"{CLOSED}: a = mu (g + FCint/m)", answers.coast),
    "press_fit": Case(
        "Negative preload relieves the contact", f"{CLOSED}: a = mu |g + FCint/m|", answers.coast
    ),
    "stick_ellipse": Case(
        "Just below the onset of slip, f1^2 + (m1/R)^2 = (mu FN)^2",
        f"{CLOSED}: statics",
        answers.stick_ellipse,
    ),
    "slide_and_spin": Case(
        "Slide and spin share one friction disc, k = m R^2/I = 2",
        f"{CLOSED}: R w/(R w0) = (v/v0)^k",
        answers.slide_and_spin,
    ),
    "binding_below": Case(
        "An eccentric push just below the binding ratio",
        f"{CLOSED}: a = F (1 - 2 mu e/L)/m",
        answers.pushed,
    ),
    "binding_above": Case(
        "An eccentric push just above the binding ratio",
        f"{CLOSED}: binds for e/L >= 1/(2 mu)",
        answers.stays,
    ),
    "drawer_slide": Case(
        "A drawer pushed eccentrically to its rail",
        f"{CLOSED}: a = (F - mu (m g + 2 F e/L))/m",
        answers.pushed,
    ),
    "journal_verge": Case(
        "A body hanging in its journal just below the angle of static equilibrium",
        f"{CLOSED}: sin(angle) <= mu R/l holds",
        answers.stays,
    ),
    "journal_pendulum": Case(
        "A body hanging in its journal swings once and sticks",
        "reduced equations, DOP853 (reference/fixed_shaft.py)",
        answers.reduced_to_rest,
    ),
    "incline": Case(
        "Slider on an incline",
        f"{CLOSED}: a = g (sin b - mu cos b)",
        answers.incline,
    ),
    "free_slide": Case(
        "Down a slope without friction, spinning",
        f"{CLOSED}: v0 t + g sin b t^2/2, w0 t",
        answers.free_slide,
    ),
    "incline_stick": Case(
        "Slider on an incline below the friction angle", f"{CLOSED}: statics", answers.stays
    ),
    "between_stops": Case(
        "Motion between two stops",
        f"{CLOSED}: the n-th crossing takes w/(v0 eps^n)",
        answers.between_stops,
    ),
    "end_stop": Case(
        "Down a slope onto a stop without restitution", f"{CLOSED}: statics", answers.end_stop
    ),
    "dry_friction_oscillator": Case(
        "A spring against dry friction",
        f"{CLOSED}: turning points shrink by 2 F/k",
        answers.dry_friction_oscillator,
    ),
    "free_flight": Case(
        "Two free bodies, mass ratio 1000, tumbling without friction",
        "conservation of momentum and energy",
        answers.conserved,
    ),
    "hub_and_rotor": Case(
        "Two free bodies, mass ratio 1000, turning together with friction",
        "Newton-Euler with multipliers, DOP853 (reference/free_pair.py)",
        answers.turning_pair,
    ),
    "twenty_turns": Case(
        "The angle accumulates to 40 pi", f"{CLOSED}: constant spin", answers.twenty_turns
    ),
    "three_answers": Case(
        "Three solutions: a sliding sleeve takes the least friction force",
        f"{CLOSED}: |f1| = mu (FCint + 2 |M - d |f1||/L)",
        answers.three_answers,
    ),
    "eccentric_rotor": Case(
        "A rotor braked by friction of its own centrifugal load",
        f"{CLOSED}: w0/(1 + q w0 t)",
        answers.eccentric_rotor,
    ),
    "near_jam": Case(
        "Coupling c = 0.95: friction twenty times mu m g",
        f"{CLOSED}: a = mu g/(1 - c), c = 2 mu d/L",
        answers.near_jam,
    ),
    "jam": Case(
        "Coupling c = 1.05: no finite sliding force",
        "impulsive stop (Painleve): immediate rest",
        answers.jam,
    ),
    "stuck_pair": Case(
        "Stick between two tumbling bodies",
        "statics of the turning pair; conservation of momentum and energy",
        answers.stuck_pair,
    ),
    "bead_on_rod": Case("A bead on a rotating rod", f"{CLOSED}: l0 cosh(w t)", answers.bead_on_rod),
    "telescopic_strut": Case(
        "Weight on spring and damper",
        f"{CLOSED}: damped oscillation",
        answers.telescopic_strut,
    ),
    "stribeck_coast": Case(
        "Coast with mu = mu_k + (mu_s - mu_k) exp(-dc |s|)",
        f"{CLOSED}: separation of variables",
        answers.stribeck_coast,
    ),
    "table_coast": Case(
        "Coast with mu from a table, mu = mu0 + b |s|",
        f"{CLOSED}: exponential",
        answers.table_coast,
    ),
    "torque_limiter": Case(
        "Spin braked at the cap of the friction force",
        f"{CLOSED}: constant moment",
        answers.torque_limiter,
    ),
    "gap_spring": Case(
        "A slider between two springs with a gap",
        f"{CLOSED}: flights and half oscillations of pi sqrt(m/k)",
        element_answers.gap_spring,
    ),
    "gas_strut": Case(
        "A gas strut lifts a hatch onto a rubber end stop", EVENTS, element_answers.gas_strut
    ),
    "soft_close": Case(
        "A drawer pulled shut against a soft-close damper", EVENTS, element_answers.soft_close
    ),
    "bump_and_rebound": Case(
        "A suspension with bump stop and a damper firm in rebound", EVENTS, element_answers.moving
    ),
    "rubber_stops": Case("A piston between two rubber stops", EVENTS, element_answers.moving),
    "door_closer": Case(
        "A door closer turns a door shut, into its seal and its latch",
        "I w' = M(angle, w) from kink to kink, DOP853 (reference/nonlinear_slide.py)",
        element_answers.door_closer,
    ),
    "window_balance": Case(
        "A sash on its spring balances stays where it comes to rest",
        EVENTS,
        element_answers.window_balance,
    ),
    "camera_slider": Case(
        "A camera, most of it on a counterweight, creeps down a tilted slider onto a rubber stop",
        EVENTS,
        element_answers.camera_slider,
    ),
    "brake": Case(
        "A brake stops a mass (Modelica's example Brake)",
        f"{CLOSED}: a = mu FCint/m from 0.1 s on",
        over_time_answers.brake,
    ),
    "forced_oscillator": Case(
        "Steady motion of an oscillator with dry friction under a harmonic force (Den Hartog)",
        f"{CLOSED}: x0 = sqrt((a V)^2 - (f H)^2)",
        over_time_answers.forced_oscillator,
    ),
    "stick_slip": Case(
        "A mass pulled by a spring at constant speed sticks and slips",
        "first jump F_s/(k v); then m x'' = k (v t - x) - c x' - F(x'), DOP853",
        over_time_answers.stick_slip,
    ),
    "linear_bearing": Case(
        "A carriage on a linear bearing whose brake closes, holds a pull and opens",
        f"{CLOSED}: cubics between the kinks of load and brake",
        over_time_answers.linear_bearing,
    ),
    "latch": Case(
        "The slide locks when it passes the lock position",
        f"{CLOSED}: constant speed",
        answers.latch,
    ),
    "drawer_binds": Case(
        "A drawer pulled beside its rail binds as its overlap shrinks",
        INTEGRATED,
        sleeve_answers.slides_to_rest,
    ),
    "telescope_binds": Case(
        "A telescope with an eccentric mass stops nearly out, where it is about to jam",
        f"{CLOSED}: v0^2/2 = mu g (u + Lj ln((L0 - Lj)/(L - Lj))), Lj = 2 mu d",
        sleeve_answers.telescope_binds,
    ),
    "telescope_pushed_in": Case(
        "The telescope nearly out is pushed in and frees", INTEGRATED, sleeve_answers.slides_on
    ),
    "piston_rod": Case(
        "A piston rod whose weight moves away from its gland",
        f"{CLOSED}: harmonic, m l'' = F - mu m g (1 + 2 l/L)",
        sleeve_answers.piston_rod,
    ),
    "sledge": Case(
        "A sledge up and down a slope, its friction by direction",
        f"{CLOSED}: a = g (sin b + mu cos b) up, g (sin b - mu cos b) down",
        sleeve_answers.sledge,
    ),
    "hydraulic_ram": Case(
        "A ram against seals: friction by direction that ignores the load, and an offset force",
        f"{CLOSED}: a = (F - offset - mu FCint)/m",
        sleeve_answers.hydraulic_ram,
    ),
}
"""All scene files of config/ but those of several connectors (reference/group_answers.py), and
connector.yaml, which is an example of all parameters."""


def expected(name: str, scene: Scene, end: float) -> Sequence[Expected]:
    """Reference values of the scene ``name`` at its last sample, at the time ``end`` (s).

    ``scene`` is that of the file, with any period. Raises KeyError for an unknown name, and
    ImportError if the solution needs SciPy and it is not installed.
    """
    return LIBRARY[name].answer(scene, end)


def compare(name: str, run: Run) -> list[Comparison]:
    """Compare a run of the scene ``name`` with its reference values.

    Errors allowed are those of ``impulse``. Raises KeyError and ImportError as :func:`expected`.
    """
    scene = run.scene
    return [
        Comparison(
            each.name, each.unit, float(each.of(run)), each.value, each.allowed(scene.period)
        )
        for each in expected(name, scene, float(run.time[-1]))
    ]


def compare_group(name: str, scenes: Mapping[str, Scene], run: GroupRun) -> list[Comparison]:
    """Compare a run of the scene ``name`` of several connectors with its reference values.

    Raises KeyError and ImportError as :func:`expected`.
    """
    period = next(iter(scenes.values())).period
    return [
        Comparison(each.name, each.unit, float(each.of(run)), each.value, each.allowed(period))
        for each in GROUPS[name].answer(scenes, float(run.time[-1]))
    ]


HEAD = """\
# Scenes

Every scene is a parameter file in `config/` for `connector`, `plant` and `cylconn simulate NAME`.
`simulate` prints the error against the reference value below, and `test/reference/test_library.py`
runs all scenes. *Allowed error* is that of the method `impulse` at the period of the file. It is
proportional to the period raised to *order*; order 0 means exact at any period. This page is
written from `cylconn_ros/reference/library.py`:
`python -m cylconn_ros.reference.library > docs/reference/scenes.md`.

| scene | motion | quantity | reference value | allowed error | order | source |
|---|---|---|---|---|---|---|
"""


GROUP_HEAD = """

## Of several connectors

Scenes of connectors that share a body ([Several connectors](../how_to/connectors.md)), for
`connector` and `cylconn simulate NAME`. `plant` does not move them.

| scene | motion | quantity | reference value | allowed error | order | source |
|---|---|---|---|---|---|---|
"""


def lines(scenes: Mapping[str, Scene]) -> list[str]:
    """Rows of the table for the named scenes, one per quantity."""
    rows = []
    for name, scene in scenes.items():
        case, values = LIBRARY[name], expected(name, scene, scene.plant.duration)
        rows += _rows(name, case.title, case.source, values, scene.period)
    return rows


def group_lines(groups: Mapping[str, Mapping[str, Scene]]) -> list[str]:
    """The same for scenes of several connectors."""
    rows = []
    for name, scenes in groups.items():
        case, one = GROUPS[name], next(iter(scenes.values()))
        values = case.answer(scenes, one.plant.duration)
        rows += _rows(name, case.title, case.source, values, one.period)
    return rows


def _rows(
    name: str, title: str, source: str, values: Sequence[Expected], period: float
) -> list[str]:
    rows = []
    for k, each in enumerate(values):
        cells = (
            *((f"`{name}`", title) if k == 0 else ("", "")),
            each.name,
            f"{each.value:.6g} {each.unit}".strip(),
            f"{each.allowed(period):.1g}",
            f"{each.order:g}",
            source if k == 0 else "",
        )
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return rows


def table(scenes: Mapping[str, Scene], groups: Mapping[str, Mapping[str, Scene]]) -> str:
    """The page docs/reference/scenes.md, for the scenes by name."""
    return HEAD + "\n".join(lines(scenes)) + GROUP_HEAD + "\n".join(group_lines(groups)) + "\n"


def main() -> int:
    """Print docs/reference/scenes.md; to be run in the root of the repository."""
    from cylconn_ros.scene.scene import load, load_all

    one = {name: load(f"config/{name}.yaml") for name in LIBRARY}
    print(table(one, {name: load_all(f"config/{name}.yaml") for name in GROUPS}), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
