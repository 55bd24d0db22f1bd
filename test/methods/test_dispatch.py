"""The table of method traits and the compiled step that uses its numbers."""

import math
from importlib import import_module

import numpy as np
import pytest
from scenes import sleeve

from cylconn_ros.connector import batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model
from cylconn_ros.methods import dispatch
from cylconn_ros.methods.traits import LIVE, SOLVERS, TRAITS
from cylconn_ros.simulation.plant import Plant


def test_method_numbers_are_unique() -> None:
    numbers = [traits.number for traits in TRAITS.values()]
    assert len(set(numbers)) == len(numbers)
    assert set(SOLVERS) < set(LIVE) < set(TRAITS)


def test_a_step_exists_for_live_methods_only() -> None:
    assert set(dispatch.STEPS) == set(LIVE)


@pytest.mark.parametrize("name", LIVE)
def test_the_step_of_a_method_is_its_own(name: str) -> None:
    """The step function of a method computes what the method's own function computes."""
    gains = {"stiffness": 1e5, "damping": 1e2, "rotational_stiffness": 1e3}
    scene = sleeve(method=name, penalty=gains if TRAITS[name].uses_gains else {})
    par = Connector(scene).par
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = Plant(sleeve(v=0.1)).state
    sample[layout.B_POSE + 1] += 1e-4  # not on the axis: each method sends another wrench
    outs, step = np.full((2, layout.NOUT), math.nan), dispatch.STEPS[name]
    batch.step(step.handle, par, np.zeros(model.NMEM), sample, 1e-3, 1e-3, outs[0])
    mem = np.zeros(model.NMEM)
    assert dispatch.begin(par, mem, sample, 1e-3, outs[1]) == layout.OK
    flags = import_module(f"cylconn_ros.methods.{name}").step(par, mem, sample, 1e-3, outs[1])
    assert dispatch.finish(par, mem, sample, 1e-3, flags, outs[1]) == layout.OK
    scale = np.abs(outs[1]) + 1e-9
    assert np.all(np.abs(outs[0] - outs[1])[: layout.RESIDUAL] < 1e-9 * scale[: layout.RESIDUAL])
