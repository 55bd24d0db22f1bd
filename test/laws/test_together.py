"""Laws of connectors that share bodies: they hold for the solver of groups, and see mistakes."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cylconn_ros as cr
from cylconn_ros.cli.main import main
from cylconn_ros.core import layout
from cylconn_ros.laws import together
from cylconn_ros.laws.runs import RunSamples
from cylconn_ros.laws.summary import LawSummary
from cylconn_ros.simulation.group import simulate_group

UPRIGHT, LEVEL = (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)), (0.0, 0.0, 0.0, 1.0)


def _rails(
    load: tuple[float, ...], mu: float = 0.2, axes: tuple[float, ...] = LEVEL, **changes: Any
) -> list[cr.Scene]:
    """Two rails 0.4 m apart; the changes are those of the first."""
    rails = [
        cr.Scene(
            period=1e-3,
            body_a=cr.Body(kind="fixed", frame="cabinet"),
            body_b=cr.Body(kind="free", frame="drawer", mass=4.0, inertia=(0.1, 0, 0, 0.1, 0, 0.2)),
            node_a=cr.Node(position=(0.0, y, 0.0), orientation=axes),
            node_b=cr.Node(position=(0.0, y, 0.0)),
            friction=cr.Friction(coefficient=mu, radius=0.01, overlap=0.1),
            plant=cr.PlantSettings(body_b=cr.PlantBody(load=load)),
        )
        for y in (0.2, -0.2)
    ]
    return [dataclasses.replace(rails[0], **changes), rails[1]]


def _samples(scenes: list[cr.Scene], count: int) -> dict[str, RunSamples]:
    run = simulate_group(scenes, count)
    periods, begins = np.full(count, scenes[0].period), np.arange(count) == 0
    found = {}
    for c, name in enumerate(("left", "right")):
        of = np.ascontiguousarray(run.samples[:count, c])
        out = run.outs[:count, c].copy()
        found[name] = RunSamples("impulse", scenes[c], of, out, periods, periods, begins)
    return found


def _checked(runs: dict[str, RunSamples]) -> LawSummary:
    summary = LawSummary(tolerance=together.TOLERANCE)
    together.check(runs, summary)
    return summary


def _nested() -> list[cr.Scene]:
    """A shaft in a ring in a tube: both slide and spin, with friction by direction of both."""
    ring = cr.Body(frame="ring", kind="free", mass=2.0, inertia=(0.01, 0, 0, 0.02, 0, 0.02))
    shaft = cr.Body(frame="shaft", kind="free", mass=1.0, inertia=(0.004, 0, 0, 0.02, 0, 0.02))
    settings = {
        "ring": cr.PlantBody(twist=(0.5, 0.0, 0.0, 8.0, 0.0, 0.0)),
        "shaft": cr.PlantBody(twist=(-0.6, 0.0, 0.0, -20.0, 0.0, 0.0)),
    }
    node, laws = cr.Node(orientation=LEVEL), []
    for forward, backward, offset in ((0.1, 0.3, 1.0), (0.5, 0.1, -0.5)):
        laws.append(cr.Friction(coefficient_forward=forward, coefficient_backward=backward,
                                offset_force=offset, radius=0.05, overlap=0.2))  # fmt: skip
    outer = cr.Scene(
        period=1e-3, body_a=cr.Body(kind="fixed", frame="tube"), body_b=ring, node_a=node,
        friction=laws[0], plant=cr.PlantSettings(body_b=settings["ring"]),
    )  # fmt: skip
    inner = cr.Scene(
        period=1e-3, body_a=ring, body_b=shaft, node_a=node, friction=laws[1],
        plant=cr.PlantSettings(body_a=settings["ring"], body_b=settings["shaft"]),
    )  # fmt: skip
    return [outer, inner]


CASES = {
    "by direction": (_rails((0.0, 0.0, 0.0, 0.0, 0.0, -2.0), elasticity=cr.Elasticity(k1=300.0),
                            reference=cr.Reference(length=0.15), friction=cr.Friction(
                                coefficient_forward=0.05, coefficient_backward=0.2, radius=0.01,
                                overlap=0.1, offset_force=2.0)), 400),
    "slides": (_rails((40.0, 0.0, 0.0, 0.0, 0.0, -2.0)), 200),
    "overlap that changes": (
        _rails((40.0, 0.0, 0.0, 0.0, 0.0, -2.0), friction=cr.Friction(
            coefficient=0.2, radius=0.01, overlap=0.1, overlap_change="decreasing")), 200),
    "stuck": (_rails((40.0, 0.0, 0.0, 0.0, 0.0, -9.2)), 50),
    "spring": (_rails((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.05, elasticity=cr.Elasticity(k1=300.0),
                      reference=cr.Reference(length=0.05)), 300),
    "rests on a stop": (_rails((0.0, 5.0, 0.0, 0.0, 0.0, 0.0), 0.05, UPRIGHT,
                               stops=cr.Stops(l_min=-0.05)), 300),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_group_satisfies_the_laws(name: str) -> None:
    scenes, count = CASES[name]
    summary = _checked(_samples(scenes, count))
    assert {law: one.worst for law, one in summary.laws.items() if not one.holds} == {}
    assert summary.laws["constraint"].samples == 2 * count


def test_friction_by_direction_of_nested_sleeves_satisfies_its_laws() -> None:
    """Both slip and spin, in directions that turn; one of them comes to rest on the way."""
    scenes, count = _nested(), 400
    runs = _samples(scenes, count)
    laws = _checked(runs).laws
    for name in ("friction_limit", "slip_direction", "stick", "dissipation", "balance"):
        assert laws[name].holds, (name, laws[name].worst)
    regimes = {name: set(run.out[:, layout.REGIME]) for name, run in runs.items()}
    assert regimes["left"] == {layout.SLIP, layout.STICK}
    for run in runs.values():
        assert run.out[:, layout.VELOCITY_VIOLATION].max() < 1e-14
        assert run.out[:, layout.RESIDUAL].max() < 1e-13


def _halved(out: np.ndarray) -> None:
    out[100:, [layout.FORCE_FRICTION, layout.TRACTION]] *= 0.5


def _pushed(out: np.ndarray) -> None:
    out[100:, layout.FORCE_B] += 1.0


@pytest.mark.parametrize(("change", "law"), [(_halved, "friction_limit"), (_pushed, "balance")])
def test_a_mistake_of_one_connector_is_seen(change: Callable[[np.ndarray], None], law: str) -> None:
    runs = _samples(*CASES["slides"])
    change(runs["left"].out)
    assert _checked(runs).laws[law].worst > 1e3 * together.TOLERANCE


def test_the_wrench_of_another_connector_belongs_to_the_constraint() -> None:
    """Without the others' wrenches the constraint of each does not hold."""
    runs = _samples(*CASES["slides"])
    runs["right"].out[:, layout.FORCE_B : layout.FORCE_B + 6] = 0.0
    assert _checked(runs).laws["constraint"].worst > 1e-3


def test_a_recorded_group_is_replayed_and_checked_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "rails.yaml"
    scene.write_text(
        "/**:\n  ros__parameters:\n    connectors: [left, right]\n    period: 0.001\n"
        "    body_a: {frame: cabinet, kind: fixed}\n"
        "    body_b: {frame: drawer, mass: 4.0, inertia: [0.1, 0.0, 0.0, 0.1, 0.0, 0.15]}\n"
        "    friction: {coefficient: 0.2, radius: 0.01, overlap: 0.1}\n"
        "    plant: {duration: 0.1, body_b: {load: [40.0, 0.0, 0.0, 0.0, 0.0, -2.0]}}\n"
        "    left: {node_a: {position: [0.0, 0.2, 0.0], orientation: [0.0, 0.0, 0.0, 1.0]}, "
        "node_b: {position: [0.0, 0.2, 0.0]}}\n"
        "    right: {node_a: {position: [0.0, -0.2, 0.0], orientation: [0.0, 0.0, 0.0, 1.0]}, "
        "node_b: {position: [0.0, -0.2, 0.0]}}\n"
    )
    run = str(tmp_path / "run")
    assert main(["simulate", str(scene), "-o", run]) == 0
    capsys.readouterr()
    assert main(["replay", run, "--compare"]) == 0
    assert "outputs identical" in capsys.readouterr().out
    assert main(["laws", "--run", run]) == 0
    assert "all laws hold" in capsys.readouterr().out
    kept = str(tmp_path / "other")
    assert main(["replay", run, "--set", "friction.coefficient=0.3", "-o", kept]) == 0
    assert main(["replay", run, "--compare", "--set", "friction.coefficient=0.3"]) == 1
    assert main(["replay", run, "--closed-loop"]) == 2
