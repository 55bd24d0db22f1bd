"""The result of a simulation: columns by name, over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.outputs import COLUMNS, DERIVED, ENUMS, acceleration, column
from cylconn_ros.core import layout
from cylconn_ros.errors import CylconnError, UnknownNameError
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

if TYPE_CHECKING:
    import pandas

Array = NDArray[np.float64]

MOTION = {
    "pose_a": slice(layout.A_POSE, layout.A_POSE + 7),
    "twist_a": slice(layout.A_TWIST, layout.A_TWIST + 6),
    "pose_b": slice(layout.B_POSE, layout.B_POSE + 7),
    "twist_b": slice(layout.B_TWIST, layout.B_TWIST + 6),
}
"""Name of each part of the states of a run and its place in them."""


@dataclass(frozen=True)
class Accuracy:
    """How a motion with a stated tolerance was computed.

    Attributes
    ----------
        method: minimal or impulse. substeps: per period. step_tolerance: of minimal, 0 for impulse.
        estimate: estimated relative error, NaN if not estimated.
    """

    method: str
    substeps: int
    step_tolerance: float
    estimate: float

    def __str__(self) -> str:
        """One line for the terminal."""
        if self.method == "minimal":
            return f"minimal, tolerance of a step {self.step_tolerance:.0e}"
        error = f", estimated error {self.estimate:.0e}" if math.isfinite(self.estimate) else ""
        return f"impulse, {self.substeps} substeps per period{error}"


@dataclass(frozen=True, repr=False)
class Run:
    """A simulated motion: N samples, one period apart.

    ``run["displacement"]`` gives a column by name: a field of ConnectorState, a published wrench
    (``force_b``, ``torque_b``), ``pose_a`` to ``twist_b``, ``energy``, ``acceleration``,
    ``angular_acceleration`` or ``time``. ``run.names`` lists them.

    Attributes
    ----------
        scene: the scene simulated.
        time: (N,) s, stamps of the samples.
        states: (N, 26) poses and twists of both bodies at the stamps (core/layout.py).
        outs: (N, NOUT) the connector's outputs for these samples (core/layout.py).
        energy: (N,) J, kinetic and gravitational energy of both bodies at the stamps.
        connector: the connector, as it is after the last sample.
        plant: the plant, one period after the last sample.
        accuracy: how the motion was computed if the scene states a tolerance, else None.

    Example::

        run = cr.simulate(cr.load(cr.shipped("demo")), duration=5.0)
        print(run["displacement"][-1], run["normal_force"].max())
    """

    scene: Scene
    time: Array
    states: Array
    outs: Array
    energy: Array
    connector: Connector
    plant: Plant
    accuracy: Accuracy | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns."""
        return ("time", *MOTION, *COLUMNS, "energy", *DERIVED)

    def __repr__(self) -> str:
        """Number of samples and their time."""
        return f"Run({len(self)} samples, {self.time[0]:g} to {self.time[-1]:g} s)"

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.time)

    def __getitem__(self, name: str) -> Array:
        """(N,) or (N, k): a column by name. Raises UnknownNameError (a KeyError) with the names."""
        if name in ("time", "energy"):
            found: Array = getattr(self, name)
            return found
        if name in MOTION:
            return self.states[:, MOTION[name]]
        if name in DERIVED:
            return acceleration(np.diff(self.time), column(self.outs, DERIVED[name])[:, 0])
        if name not in COLUMNS:
            raise UnknownNameError(name, self.names)
        found = column(self.outs, name)
        return found

    def to_dataframe(self) -> pandas.DataFrame:
        """All columns as a pandas DataFrame with ``time`` as the index.

        A vector becomes columns ``offset[0]``, ``offset[1]``; enums are integers. Raises
        CylconnError if pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise CylconnError("pandas is not installed: pip install pandas") from None
        columns: dict[str, Any] = {}
        for name in self.names[1:]:
            values = self[name]
            if values.ndim == 2:
                columns |= {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
            else:
                columns[name] = values.astype(np.int64) if name in ENUMS else values
        return pandas.DataFrame(columns, index=pandas.Index(self.time, name="time"))
