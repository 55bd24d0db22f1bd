"""Loads, preload and imposed motion or force over time: order, minimal, recording and replay."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cylconn_ros.cli import main
from cylconn_ros.cli import simulate as command
from cylconn_ros.core import layout
from cylconn_ros.laws.runs import check_recording
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.recording.run import read_run
from cylconn_ros.reference import over_time_answers
from cylconn_ros.scene.scene import Scene, load, shipped
from cylconn_ros.simulation.group import simulate_group
from cylconn_ros.simulation.minimal import solve
from cylconn_ros.simulation.simulate import simulate

RAMP = {"times": [0.05, 0.25, 0.5], "values": [0.0, 1.5, 0.7]}
SINE = {"frequency": 2.3, "mean": 0.4, "amplitude": 1.0, "phase": 0.3}
START = 0.4 + math.sin(0.3)
RATE = 2.0 * math.pi * 2.3 * math.cos(0.3)
LOAD = [30.0, 5.0, -20.0, 0.0, 0.2, 0.0]
END = 0.6


def scene(**changes: Any) -> Scene:
    """A body with its mass centre off the slot, whose friction depends on its load."""
    return Scene.from_parameters(
        {
            "period": 1e-3,
            "body_a": {"kind": "fixed"},
            "body_b": {"mass": 2.0, "inertia": [0.01, 0, 0, 0.02, 0, 0.02], "com": [0.03, 0.01, 0]},
            "node_a.orientation": [0, 0, 0, 1],
            "friction": {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1},
            **changes,
        }
    )


CASES: dict[str, dict[str, Any]] = {
    "load": {"plant.body_b": {"load": LOAD, "load_amplitude": RAMP}},
    "preload": {
        "friction.preload": 20.0, "plant.preload_amplitude": RAMP,
        "plant.body_b.twist": [3.0, 0, 0, 10, 0, 0],
    },
    "force": {"command.slide.force": 20.0, "plant.slide_amplitude": RAMP},
    "moment": {
        "command.spin.force": 0.1, "plant.spin_amplitude": RAMP,
        "plant.body_b.twist": [3.0, 0, 0, 30, 0, 0],
    },
    "position": {
        "command.slide": {"position": 0.1, "approach_speed": 5.0}, "plant.slide_amplitude": SINE,
        "plant.body_b": {
            "twist": [0.1 * RATE, 0, 0, 10, 0, 0], "pose": [0.1 * START, 0, 0, 0, 0, 0, 1],
        },
    },
    "velocity": {
        "command.slide.velocity": 0.5, "plant.slide_amplitude": SINE,
        "plant.body_b.twist": [0.5 * START, 0, 0, 10, 0, 0],
    },
}  # fmt: skip


def errors(given: Scene, period: float) -> np.ndarray:
    """Errors of slide and rotation at the end, beside method minimal."""
    exact = solve(dataclasses.replace(given, method="minimal", latency=0), END)
    run = simulate(dataclasses.replace(given, period=period), END)
    found = np.array([run["length"][-1] - exact.length[-1], run["angle"][-1] - exact.angle[-1]])
    return np.abs(found)


@pytest.mark.parametrize("name", CASES)
def test_runs_converge_to_the_continuous_motion_in_second_order(name: str) -> None:
    given = scene(**CASES[name])
    coarse, fine = errors(given, 2e-3), errors(given, 5e-4)
    assert np.all(fine < 2e-5)
    assert np.all(fine <= coarse / 4.0**1.7 + 1e-12)


@pytest.mark.parametrize("latency", [1, 2])
@pytest.mark.parametrize("name", ["load", "force"])
def test_what_changes_is_that_of_the_time_of_action(name: str, latency: int) -> None:
    """Without a load at the start: the first wrenches act late whatever they are."""
    given = scene(**CASES[name], gravity=[0.0, 0.0, 0.0], latency=latency)
    coarse, fine = errors(given, 2e-3), errors(given, 5e-4)
    assert np.all(fine < 2e-5)
    assert np.all(fine <= coarse / 4.0**1.7 + 1e-12)


def test_a_preload_acts_with_its_wrench() -> None:
    parameters = {**CASES["preload"], "body_b.com": [0.0, 0.0, 0.0], "gravity": [0.0, 0.0, 0.0]}
    parameters |= {"plant.body_b.twist": [3.0, 0, 0, 0, 0, 0], "latency": 2}
    body = {"mass": 2.0, "inertia": [0.01, 0, 0, 0.02, 0, 0.02]}
    given = scene(**{k: v for k, v in parameters.items() if k != "body_b.com"}, body_b=body)
    assert errors(given, 2e-3)[0] < 1e-6
    assert errors(given, 5e-4)[0] < 4e-8


def test_minimal_meets_the_closed_forms_of_den_hartog_and_of_a_brake() -> None:
    given = load(shipped("forced_oscillator"))
    found = solve(dataclasses.replace(given, method="minimal"), 4.0)
    assert found.length[-1] == pytest.approx(
        over_time_answers.forced_oscillator(given, 4.0)[1].value, abs=1e-11
    )
    given = load(shipped("linear_bearing"))
    found = solve(dataclasses.replace(given, method="minimal"), 1.5)
    stopped, moved, _ = over_time_answers.linear_bearing(given, 1.5)
    assert found.length[-1] == pytest.approx(moved.value, abs=1e-12)
    assert [e.kind for e in found.events] == ["rests", "breaks away"]
    assert found.events[0].time == pytest.approx(stopped.value, abs=1e-12)


ALL: dict[str, Any] = {
    "friction.preload": 20.0,
    "command.spin.force": 0.02,
    "plant": {
        "body_b": {"load": LOAD, "load_amplitude": SINE, "twist": [3.0, 0, 0, 10, 0, 0]},
        "preload_amplitude": RAMP,
        "spin_amplitude": SINE,
        "duration": 0.4,
    },
}


@pytest.mark.parametrize("parameters", [ALL, CASES["position"]], ids=["loads", "position"])
def test_a_run_is_recorded_with_its_commands_and_replays_identically(
    parameters: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = scene(**parameters)
    kept = tmp_path / "run"
    command.keep(simulate(given, 0.4), given, kept)
    run = read_run(kept)
    sent = {t for t in run.types if t.endswith(("/load", "/command", "/preload"))}
    assert sent
    assert {run.counts[t] for t in sent} == {401}
    assert main.main(["replay", str(kept), "--compare"]) == 0
    assert "outputs identical" in capsys.readouterr().out
    _, found = check_recording(kept, lambda *_: None)
    assert {name for name, law in found.laws.items() if not law.holds} == set()
    assert main.main(["replay", str(kept), "--closed-loop"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "none" in next(line for line in lines if line.startswith("greatest normal force"))


@pytest.mark.parametrize("method", [x for x in TRAITS if TRAITS[x].sends_wrench and TRAITS[x].live])
def test_every_method_follows_a_force_over_time(method: str) -> None:
    """M v = the impulse of the force, which every step holds in its mean."""
    given = scene(
        friction={}, gravity=[0, 0, 0],
        body_b={"mass": 2.0, "inertia": [0.01, 0, 0, 0.02, 0, 0.02]},
        method=method, penalty={"stiffness": 1e5, "damping": 300.0, "rotational_stiffness": 1e3},
        **{"command.slide.force": 20.0, "plant.slide_amplitude": RAMP},
    )  # fmt: skip
    run = simulate(given, END)
    impulse = 20.0 * given.plant.slide_amplitude.average(0.0, END) * END
    assert run["velocity"][-1, 0] == pytest.approx(impulse / 2.0, rel=1e-9)


def test_connectors_of_a_group_follow_too() -> None:
    """A carriage on a rail and another one on it, each with its own force over time."""
    body = {"kind": "free", "mass": 2.0, "inertia": [0.01, 0, 0, 0.02, 0, 0.02]}
    rail = {"kind": "fixed", "frame": "rail"}
    scenes = [
        Scene.from_parameters(
            {
                "period": 1e-3,
                "gravity": [0, 0, 0],
                "node_a.orientation": [0, 0, 0, 1],
                "body_a": below,
                "body_b": {**body, "frame": frame},
                "command.slide.force": force,
                "plant.slide_amplitude": RAMP,
            }
        )
        for below, frame, force in (
            (rail, "one", 20.0),
            ({**body, "frame": "one"}, "two", -10.0),
        )
    ]
    run = simulate_group(scenes, 601)
    impulse = scenes[0].plant.slide_amplitude.average(0.0, END) * END
    speeds = run.samples[-1, :, layout.B_TWIST]
    assert speeds == pytest.approx([(20.0 + 10.0) * impulse / 2.0, -10.0 * impulse / 2.0])
