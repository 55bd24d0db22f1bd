"""The table of method traits and the compiled step that uses its numbers."""

import math

import numpy as np
import pytest
from scenes import sleeve

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model
from cylconn_ros.methods import dispatch
from cylconn_ros.methods.traits import LIVE, SOLVERS, TRAITS
from cylconn_ros.simulation.plant import Plant


def test_method_numbers_are_unique() -> None:
    numbers = [traits.number for traits in TRAITS.values()]
    assert len(set(numbers)) == len(numbers)
    assert set(SOLVERS) < set(LIVE) < set(TRAITS)


@pytest.mark.parametrize("name", TRAITS)
def test_a_step_exists_for_live_methods_only(name: str) -> None:
    """A number of the table without a branch in dispatch.step must not run another method."""
    gains = {"stiffness": 1e5, "damping": 1e2, "rotational_stiffness": 1e3}
    scene = sleeve(method=name, penalty=gains if TRAITS[name].uses_gains else {})
    out = step(TRAITS[name].number, Connector(scene).par if name in LIVE else sleeve_par())
    assert (out[layout.STATUS] == layout.OK) == (name in LIVE)


@pytest.mark.parametrize("number", [-1, TRAITS["minimal"].number, 6, 99])
def test_an_unknown_method_number_is_an_error(number: int) -> None:
    out = step(number, sleeve_par())
    assert out[layout.STATUS] == layout.UNKNOWN_METHOD
    assert np.all(out[: layout.STATUS] == 0.0)


def sleeve_par() -> np.ndarray:
    return Connector(sleeve()).par


def step(number: int, par: np.ndarray) -> np.ndarray:
    """The outputs for the initial state of a sleeve on a fixed shaft."""
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = Plant(sleeve()).state
    out = np.full(layout.NOUT, math.nan)
    status = dispatch.step(number, par, np.zeros(model.NMEM), sample, 1e-3, out)
    assert status == out[layout.STATUS]
    return out
