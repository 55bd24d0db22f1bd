"""The worked examples for Pinocchio and Drake against the mechanism that is reduced by hand."""

import runpy
from typing import Any

import numpy as np
import planar_slider
import pytest
from paths import ROOT


@pytest.mark.parametrize("name", ["pinocchio_friction", "drake_friction"])
def test_a_worked_example_converges_at_first_order(name: str) -> None:
    """Semi-implicit steps of 1 and 0.5 ms against SciPy's integration with events, after 1 s."""
    expected, _ = planar_slider.reference(1.0)
    simulate: Any = runpy.run_path(str(ROOT / "docs" / "how_to" / f"{name}.py"))["simulate"]
    found = []
    for h in (1e-3, 5e-4):
        simulate.__globals__["H"] = h
        found.append(simulate() + [0.0, planar_slider.START[1], 0.0, 0.0])
    ratios = (found[0] - expected) / (found[1] - expected)
    assert ((ratios > 1.8) & (ratios < 2.2)).all()
    assert np.abs(2.0 * found[1] - found[0] - expected).max() < 1e-3
