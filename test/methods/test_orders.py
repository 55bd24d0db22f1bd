"""Second order of method impulse beside the steady motions: turning loads, stick, reversal.

The reference is the motion in joint coordinates, integrated to 1e-12 (method minimal), whose
equations share nothing with the step.
"""

from typing import Any

import numpy as np
import pytest

import cylconn_ros as cr

SPINNING = (0.2, 0.0, 0.0, 20.0, 0.0, 0.0)
SLIDING = (0.53, 0.0, 0.0, 7.0, 0.0, 0.0)
ECCENTRIC = (0.03, 0.02, -0.01)
CENTRED = (0.0, 0.0, 0.0)
LOAD = (2.0, 3.0, 0.5, 0.0, 0.0, 0.1)


def _scene(
    period: float, method: str, mu: float, twist: tuple[float, ...],
    com: tuple[float, ...] = CENTRED, load: tuple[float, ...] = (0.0,) * 6,
    hold: str = "world", k1: float = 0.0, stop: float = np.nan, turn: float = np.nan,
) -> cr.Scene:  # fmt: skip
    """A sleeve on a horizontal shaft; ``load`` acts at the origin of its frame."""
    friction = cr.Friction(coefficient=mu, radius=0.02, overlap=0.1) if mu > 0.0 else cr.Friction()
    return cr.Scene(
        period=period,
        method=method,
        wrench=cr.Wrench(hold=hold),
        body_a=cr.Body(kind="fixed"),
        body_b=cr.Body(kind="free", mass=2.0, inertia=(0.01, 0, 0, 0.02, 0, 0.02), com=com),
        node_a=cr.Node(orientation=(0.0, 0.0, 0.0, 1.0)),
        friction=friction,
        elasticity=cr.Elasticity(k1=k1),
        stops=cr.Stops(l_max=stop, theta_max=turn, restitution=0.6),
        plant=cr.PlantSettings(body_b=cr.PlantBody(twist=twist, load=load)),
    )


CASES: dict[str, dict[str, Any]] = {
    "load beside the mass centre": {"twist": SPINNING, "com": ECCENTRIC, "load": LOAD, "mu": 0.0},
    "the same with friction": {"twist": SPINNING, "com": ECCENTRIC, "load": LOAD, "mu": 0.1},
    "wrench held in body axes": {
        "twist": SPINNING, "com": ECCENTRIC, "load": LOAD, "mu": 0.1, "hold": "body",
    },
    "slide and spin come to rest": {"twist": SLIDING, "mu": 0.2},
    "the same, eccentric": {"twist": SLIDING, "mu": 0.2, "com": (0.02, 0.03, -0.01)},
    "a spring reverses the slide": {"twist": SLIDING, "mu": 0.02, "k1": 300.0},
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_motions_with_events_and_turning_loads_are_second_order(name: str) -> None:
    case = CASES[name]
    exact = cr.simulate(_scene(1e-3, "minimal", **case), 0.4)
    errors = []
    for period in (2e-3, 1e-3, 5e-4):
        run = cr.simulate(_scene(period, "impulse", **case), 0.4)
        slide = run["displacement"][-1] - exact["displacement"][-1]
        turn = run["rotation"][-1] - exact["rotation"][-1]
        errors.append(np.hypot(slide, 0.05 * turn))
    assert errors[-1] < 1e-5
    assert np.log2(errors[0] / errors[2]) / 2.0 > 1.9, errors


@pytest.mark.parametrize("com", [CENTRED, (0.02, 0.03, -0.01)])
def test_rebounds_with_friction_are_second_order(com: tuple[float, ...]) -> None:
    """A sleeve that slides and spins hits its stop, with friction, at several phases of a step.

    Off the mass centre the impact presses the joint against its shaft: friction has an impulse.
    """
    errors = np.zeros((3, 4, 2))
    for k, stop in enumerate(np.linspace(0.0401, 0.0437, 4)):
        case: dict[str, Any] = {"twist": SLIDING, "mu": 0.2, "com": com, "stop": float(stop)}
        exact = cr.simulate(_scene(1e-3, "minimal", **case), 0.2)
        for row, period in enumerate((2e-3, 1e-3, 5e-4)):
            run = cr.simulate(_scene(period, "impulse", **case), 0.2)
            slide = run["displacement"][-1] - exact["displacement"][-1]
            turn = run["rotation"][-1] - exact["rotation"][-1]
            errors[row, k] = slide, 0.05 * turn
    size = np.sqrt(np.mean(np.sum(errors**2, axis=2), axis=1))
    assert size[-1] < 1e-7
    assert np.log2(size[0] / size[2]) / 2.0 > 1.75, size


@pytest.mark.parametrize("later", [0.0, 0.3, -0.3, 0.8])
def test_impacts_of_slide_and_spin_within_a_step_are_second_order(later: float) -> None:
    """The spin hits its stop ``later`` periods after the slide, at several phases of a step."""
    free = cr.simulate(_scene(1e-4, "minimal", 0.2, SLIDING), 0.12)
    errors = np.zeros((3, 4, 2))
    for k, time in enumerate(0.0803 + 6.25e-4 * np.arange(4)):
        stop = float(np.interp(time, free.time, free["displacement"]))
        for row, period in enumerate((2e-3, 1e-3, 5e-4)):
            turn = float(np.interp(time + later * period, free.time, free["rotation"]))
            case: dict[str, Any] = {"twist": SLIDING, "mu": 0.2, "stop": stop, "turn": turn}
            exact = cr.simulate(_scene(1e-3, "minimal", **case), 0.12)
            run = cr.simulate(_scene(period, "impulse", **case), 0.12)
            slide = run["displacement"][-1] - exact["displacement"][-1]
            errors[row, k] = slide, 0.05 * (run["rotation"][-1] - exact["rotation"][-1])
    size = np.sqrt(np.mean(np.sum(errors**2, axis=2), axis=1))
    assert size[-1] < 2e-8
    assert np.log2(size[0] / size[2]) / 2.0 > 1.75, size
