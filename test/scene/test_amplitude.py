"""What changes over time: the factor, its means and pieces, and the rules for it."""

import re
from typing import Any

import numpy as np
import pytest
from scenes import sleeve

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.amplitude import Amplitude

TABLE = Amplitude(times=(0.1, 0.3, 0.35), values=(0.5, 2.0, -1.0))
SINE = Amplitude(frequency=3.0, mean=0.4, amplitude=1.5, phase=0.7)
FRICTION = {"coefficient": 0.2, "radius": 0.01}


@pytest.mark.parametrize("factor", [TABLE, SINE])
def test_means_and_pieces_are_those_of_the_factor(factor: Amplitude) -> None:
    for begin, end in ((0.0, 0.05), (0.05, 0.32), (0.2, 0.201), (0.3, 0.4), (0.5, 0.9)):
        points = np.unique(np.r_[np.linspace(begin, end, 20001), 0.1, 0.3, 0.35])
        points = points[(points >= begin) & (points <= end)]
        values = [factor.at(float(t)) for t in points]
        mean = float(np.trapezoid(values, points)) / (end - begin)
        assert factor.average(begin, end) == pytest.approx(mean, abs=1e-7)
    pieces = factor.pieces()
    for t in np.linspace(0.0, 0.5, 101):
        piece = next(p for p in reversed(pieces) if p.start <= t)
        value = piece.value + piece.slope * (t - piece.start)
        value += piece.sine * np.sin(piece.omega * t + piece.phase)
        assert value == pytest.approx(factor.at(float(t)), abs=1e-12)


def test_a_factor_is_held_at_its_ends_and_one_if_absent() -> None:
    assert (TABLE.at(0.0), TABLE.at(9.0)) == (0.5, -1.0)
    assert TABLE.average(0.0, 0.1) == 0.5
    assert (Amplitude().at(3.0), Amplitude().average(0.0, 1.0), Amplitude().on) == (1.0, 1.0, False)


LOADED: dict[str, Any] = {"body_b": {"load": [1.0, 0, 0, 0, 0, 0]}}


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"load_amplitude": {"times": [0.2, 0.1], "values": [0.0, 1.0]}},
         "plant.body_b.load_amplitude.times = [0.2, 0.1]: must be ascending"),
        ({"load_amplitude": {"times": [0.1, 0.2], "values": [0.0]}},
         "plant.body_b.load_amplitude.values = [0.0]: must be as many numbers as "
         "plant.body_b.load_amplitude.times (1 and 2 given)"),
        ({"load_amplitude": {"times": [0.1], "values": [0.0]}}, "must be at least 2 numbers"),
        ({"load_amplitude": {"times": [-0.1, 0.2], "values": [0.0, 1.0]}}, "each >= 0 s"),
        ({"load_amplitude": {"times": [0.1, 0.2], "values": [0.0, float("inf")]}},
         "plant.body_b.load_amplitude.values = [0.0, .inf]: must be numbers, finite"),
        ({"load_amplitude": {"times": [0.1, float("nan")], "values": [0.0, 1.0]}},
         "plant.body_b.load_amplitude.times = [0.1, .nan]"),
        ({"load_amplitude": {"times": [0.1, 0.2], "values": [0.0, 1.0], "frequency": 2.0}},
         "must not be given together with plant.body_b.load_amplitude.times"),
        ({"load_amplitude": {"phase": 2.0}},
         "plant.body_b.load_amplitude.phase = 2.0: needs plant.body_b.load_amplitude.frequency"),
        ({"load_amplitude": {"frequency": 300.0}}, "must be at most 250 Hz"),
        ({"load": [0.0] * 6, "load_amplitude": {"frequency": 3.0}}, "needs plant.body_b.load"),
    ],
)  # fmt: skip
def test_amplitudes_that_cannot_be_are_refused(values: dict[str, Any], text: str) -> None:
    body = {**LOADED["body_b"], **values}
    with pytest.raises(SceneError, match=re.escape(text)):
        sleeve(period=1e-3, plant={"body_b": body})


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"plant": {"preload_amplitude": {"frequency": 1.0}}}, "needs friction, on which"),
        ({"plant": {"preload_amplitude": {"frequency": 1.0}}, "friction": FRICTION},
         "plant.preload_amplitude: needs friction.preload"),
        ({"plant": {"slide_amplitude": {"frequency": 1.0}}},
         "plant.slide_amplitude: needs command.slide.position, velocity or force"),
        ({"plant": {"spin_amplitude": {"frequency": 1.0}},
          "command": {"spin": {"position": 1.0, "velocity": 1.0}}},
         "command.spin.velocity = 1.0: must not be given with a position and plant.spin_amplitude"),
        ({"plant": {"slide_amplitude": {"frequency": 1.0, "mean": 0.5}}, "stops": {"l_max": 0.25},
          "command": {"slide": {"position": 0.2}}},
         "plant.slide_amplitude: takes the position of slide to 0.3, beyond its stop at 0.25"),
    ],
)  # fmt: skip
def test_an_amplitude_needs_what_it_multiplies(parameters: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=re.escape(text)):
        sleeve(period=1e-3, **parameters)
