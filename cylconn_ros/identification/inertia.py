"""Mass and inertia about the slot from the same recording as friction, by its known forces.

A motion alone does not determine the mass: with mass and inertia s times larger, and FCint, c1, cr1
and offset s times larger too, all forces of the inverse dynamics are s times larger and friction
still opposes the slip with the same mu, L and R. Known forces L along the slot (recorded loads,
commands, the effort of a drive) are not scaled, so that a wrong mass leaves a part of L in the
residuals. Mass and inertia are those for which it vanishes,

    z^T V^-1 e = 0,    z: L of each window, without what the parameters of friction can imitate.

L carries no noise of the twists: an instrument. The accelerations, which do, would bias the mass.
If the mass centre is off the slot, the weight's moment about the slot belongs to z of the inertia:
L less the moment that carries the weight is what accelerates the spin.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.errors import IdentifyError, IndeterminateError, SceneError
from cylconn_ros.identification.estimates import SIGNIFICANCE, Estimate
from cylconn_ros.identification.forces.correlation import Correlation
from cylconn_ros.identification.forces.intervals import Intervals, measure_intervals
from cylconn_ros.identification.likelihood import sandwich
from cylconn_ros.identification.likelihood.kinetic import (
    KineticFit,
    factors,
    fit_law,
    slopes_of,
    weighted_residuals,
)
from cylconn_ros.identification.likelihood.law import FrictionLaw
from cylconn_ros.identification.likelihood.selection import choose, fit_excited
from cylconn_ros.identification.slips import prepare
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

UNKNOWN = ("mass", "inertia")
"""Names that can be estimated: of the free body, and about the slot."""
UNITS = {"mass": "kg", "inertia": "kg.m^2"}
COMPONENT = {"mass": 0, "inertia": 1}  # of (f1, m1), whose known force determines it
STEP = 0.02  # relative, of numerical derivatives
ROUNDS = 4  # choices of the model
ITERATIONS = 12
LARGEST_STEP = 0.5  # relative
CLOSE = 0.02  # standard deviations of a last step
MAX_HALF_WIDTH = 0.5  # of a value
LEAST_FORCE = 1e-3  # of the forces along the slot: known forces that count


class Evaluation(NamedTuple):
    """A fit at given mass and inertia, with the part of the known forces in its residuals."""

    part: Array  # (k,) of the known forces, by unknown
    vector: Array  # (n,) parameters of friction beside this part
    covariance: Array  # (n + k, n + k) of vector and part
    freedom: float  # degrees of freedom of the variances of the part, the least
    fitted: KineticFit


class InertiaProblem:
    """The forces of a recording as functions of mass and inertia about the slot.

    Attributes
    ----------
        names: the unknowns. given: (k,) their values in the scene.
    """

    def __init__(
        self,
        scene: Scene,
        samples: SampleArrays,
        drive: Array | None,
        start: FrictionLaw,
        free: Sequence[int],
        names: Sequence[str],
    ) -> None:
        """Compute the forces.

        Args:
            scene: with start values of the unknowns.
            samples: complete samples of a motion with known loads.
            drive: (n, 2) known force and moment of a drive, or None.
            start: friction law at which the search begins; free: its parameters to be estimated.
            names: the unknowns, of UNKNOWN.

        Raises IndeterminateError if no known force acts along the slot, IdentifyError if both
        bodies or none are free.
        """
        self.names = tuple(name for name in UNKNOWN if name in names)
        self._scene, self._start, self._free = scene, start, list(free)
        self._body = _free_body(scene)
        self._axis, self._distance = _slot(scene, samples, self._body)
        self.given = np.array([self._value(name) for name in self.names])
        self._measured = measure_intervals(scene, samples, drive)
        self._noise: tuple[int, Correlation] | None = None  # of the last model
        self._slopes = []
        for k in range(len(self.names)):
            changed = self.given.copy()
            changed[k] *= 1.0 + STEP
            other = measure_intervals(self.scene(changed), samples, drive)
            slope = (other.wrench - self._measured.wrench) / (STEP * self.given[k])
            self._slopes.append(np.nan_to_num(slope))
        unloaded = samples.samples.copy()
        unloaded[:, layout.LOADS] = 0.0
        alone = SampleArrays(samples.stamps, samples.h, samples.restarted, unloaded)
        bare = measure_intervals(scene, alone, np.zeros((len(samples), 2)))
        self._known = (bare.wrench - self._measured.wrench)[:, [0, 3]]
        self._weight = _weight_moment(scene, samples, self._body)
        self._refuse_without_forces(bare.wrench[:, [0, 3]])

    def _value(self, name: str) -> float:
        body = getattr(self._scene, self._body)
        return float(body.mass) if name == "mass" else _about(body.inertia, self._axis)

    def _refuse_without_forces(self, whole: Array) -> None:
        use = self._measured.usable
        for name in self.names:
            k = COMPONENT[name]
            size, other = np.std(self._known[use, k]), np.std(whole[use, k])
            if not size > LEAST_FORCE * other:
                kind = ("force along the slot", "moment about the slot")[k]
                raise IndeterminateError(
                    f"{name}: no known {kind} acts that changes, so the motion does not determine "
                    f"it: with it and FCint, c1, cr1 and offset all s times larger, the motion is "
                    "the same; record a load or the effort of the drive (drive), or weigh the body"
                )

    def scene(self, values: Array) -> Scene:
        """Return the scene with these values.

        Raises IdentifyError if no body can have this inertia with the others of the scene.
        """
        body = getattr(self._scene, self._body)
        changes: dict[str, object] = {}
        for name, value in zip(self.names, values, strict=True):
            if name == "mass":
                changes[f"{self._body}.mass"] = float(value)
                continue
            more = (float(value) - _about(body.inertia, self._axis)) * np.outer(
                self._axis, self._axis
            )
            inertia = np.array(body.inertia) + more[np.triu_indices(3)]
            changes[f"{self._body}.inertia"] = inertia.tolist()
        try:
            return self._scene.replace(changes)
        except SceneError as error:
            raise IdentifyError(
                f"{', '.join(f'{n} = {v:.4g}' for n, v in zip(self.names, values, strict=True))} "
                f"does not go with the other parameters of {self._body}: {error}"
            ) from None

    def _at(self, values: Array) -> Intervals:
        wrench = self._measured.wrench.copy()
        for slope, value, given in zip(self._slopes, values, self.given, strict=True):
            wrench += (value - given) * slope
        return dataclasses.replace(self._measured, wrench=wrench)

    def model(self, values: Array, coulomb: bool = False) -> KineticFit:
        """Choose and fit the model at these values, or Coulomb friction alone."""
        prepared = prepare(self._at(values), self._start.radius)
        self._noise = (prepared.taken, prepared.noise)
        if coulomb:
            return fit_excited(prepared.data, prepared.loads, self._start, self._free)[0]
        return choose(prepared.data, prepared.loads, self._start, self._free).fitted

    def evaluate(self, values: Array, model: KineticFit) -> Evaluation:
        """Fit the parameters of ``model`` at these values."""
        data = prepare(self._at(values), self._start.radius, self._noise).data
        fitted = fit_law(data, model.law, model.free)
        inverse, _ = factors(data, fitted.law)
        r = weighted_residuals(data, fitted.law, inverse)
        free = list(fitted.free)
        known = np.zeros((len(data), 2, len(self.names)))
        middle = self._measured.time - 0.5 * self._measured.dt
        for k, name in enumerate(self.names):
            at = COMPONENT[name]
            force = self._known[:, at]
            if name == "inertia":
                mass = values[0] if "mass" in self.names else self._value("mass")
                force = force - mass * self._weight
            known[:, at, k] = np.interp(data.windows.time, middle, force)
        columns = np.concatenate([slopes_of(data, fitted.law, free), known], axis=2)
        j = -np.einsum("nij,njk->nik", inverse, columns)
        scale = np.maximum(np.sqrt(np.square(j).sum(axis=(0, 1))), 1e-300)
        j /= scale
        step = np.linalg.lstsq(j.reshape(-1, j.shape[2]), -r.ravel(), rcond=1e-10)[0]
        bread = np.linalg.pinv(np.einsum("nia,nib->ab", j, j), rcond=1e-12)
        after = r + j @ step
        covariance = sandwich.covariance(j, after, bread) / np.outer(scale, scale)
        step = step / scale
        n = len(free)
        freedom = float(sandwich.degrees_of_freedom(j, bread)[n:].min())
        vector = fitted.law.vector[free] + step[:n]
        return Evaluation(step[n:], vector, covariance, freedom, fitted)

    def derivatives(self, values: Array, model: KineticFit) -> tuple[Evaluation, Array, Array]:
        """Return the fit and the derivatives of its part (k, k) and vector (n, k) by the values."""
        at = self.evaluate(values, model)
        parts, vectors = [], []
        for k in range(len(values)):
            changed = values.copy()
            changed[k] *= 1.0 + STEP
            other = self.evaluate(changed, model)
            parts.append((other.part - at.part) / (STEP * values[k]))
            vectors.append((other.vector - at.vector) / (STEP * values[k]))
        return at, np.stack(parts, axis=1), np.stack(vectors, axis=1)

    def estimates(self, values: Array, covariance: Array, freedom: float) -> list[Estimate]:
        """Return the estimates; the inertia is that about the slot, with the mass's share.

        Raises IndeterminateError if one is known worse than to MAX_HALF_WIDTH of it.
        """
        from scipy.stats import t

        spread = float(t.isf(SIGNIFICANCE / 2.0, freedom))
        found = []
        mass = self._value("mass") if "mass" not in self.names else float(values[0])
        for k, name in enumerate(self.names):
            row = np.eye(len(values))[k]
            value = float(values[k])
            if name == "inertia":
                value += mass * self._distance**2
                if "mass" in self.names:
                    row[0] = self._distance**2
            half = spread * float(np.sqrt(row @ covariance @ row))
            if half > MAX_HALF_WIDTH * abs(value):
                raise IndeterminateError(
                    f"{name}: {value:.3g} ± {half:.2g} {UNITS[name]}: the known forces of this "
                    "motion hardly determine it; record larger ones, in both directions"
                )
            note = "about the slot" if name == "inertia" else f"of {self._body}"
            found.append(Estimate(name, value, value - half, value + half, UNITS[name], note))
        return found


class InertiaFit(NamedTuple):
    """Estimated mass and inertia.

    Attributes
    ----------
        problem: the forces as functions of them.
        values: (k,) estimates. scene: with them.
    """

    problem: InertiaProblem
    values: Array
    scene: Scene

    def widened(self, fitted: KineticFit) -> tuple[KineticFit, list[Estimate]]:
        """Return a fit at the estimates whose covariance includes their errors, and the estimates.

        Of the estimating equations, linear near the solution: errors of the parts move the values,
        and these the parameters of friction.
        """
        at, parts, vectors = self.problem.derivatives(self.values, fitted)
        solve = np.linalg.pinv(parts)
        n = len(at.vector)
        full = np.hstack([np.eye(n), -vectors @ solve])
        covariance = full @ at.covariance @ full.T
        own = solve @ at.covariance[n:, n:] @ solve.T
        # The error cannot be smaller than with known mass and inertia.
        wider = np.maximum(
            np.diag(fitted.covariance) / np.maximum(np.diag(covariance), 1e-300), 1.0
        )
        covariance *= np.sqrt(np.outer(wider, wider))
        estimates = self.problem.estimates(self.values, own, at.freedom)
        return dataclasses.replace(fitted, covariance=covariance), estimates


def estimate_inertia(problem: InertiaProblem) -> InertiaFit:
    """Estimate mass and inertia about the slot of the free body, from the values of the scene on.

    Raises IndeterminateError if the search does not converge.
    """
    values = problem.given.copy()
    model = problem.model(values, coulomb=True)  # at wrong values the data demand wrong terms
    for _ in range(ROUNDS):
        for _ in range(ITERATIONS):
            at, parts, _ = problem.derivatives(values, model)
            solve = np.linalg.pinv(parts)
            n = len(at.vector)
            step = -solve @ at.part
            size = np.sqrt(np.diag(solve @ at.covariance[n:, n:] @ solve.T))
            share = float(np.abs(step / values).max())
            values = values + step * min(1.0, LARGEST_STEP / max(share, 1e-300))
            if not np.isfinite(values).all() or (values <= 0.0).any():
                raise IndeterminateError(
                    f"{' and '.join(problem.names)}: the known forces of this motion do not "
                    "determine them; record larger ones, in both directions"
                )
            if (np.abs(step) < CLOSE * size).all() or share < 1e-9:
                break
        again = problem.model(values)
        same = again.free == model.free
        model = again
        if same:
            break
    return InertiaFit(problem, values, problem.scene(values))


def _free_body(scene: Scene) -> str:
    free = [name for name in ("body_a", "body_b") if getattr(scene, name).kind == "free"]
    if len(free) != 1:
        raise IdentifyError(
            "mass and inertia can be estimated of one free body beside a fixed or driven one; "
            f"free are: {' and '.join(free) or 'none'}"
        )
    return free[0]


def _about(inertia: Sequence[float], axis: Array) -> float:
    upper = np.zeros((3, 3))
    upper[np.triu_indices(3)] = inertia
    return float(axis @ (upper + np.triu(upper, 1).T) @ axis)


def _slot(scene: Scene, samples: SampleArrays, body: str) -> tuple[Array, float]:
    """Return the slot's direction (3,) in the body's frame, and the mass centre's distance, m."""
    turns, axes = _orientations(scene, samples, body)
    axis = turns[0].inv().apply(axes[0])
    arm = _arm(scene, body)
    return np.asarray(axis), float(np.linalg.norm(arm - axis * (axis @ arm)))


def _weight_moment(scene: Scene, samples: SampleArrays, body: str) -> Array:
    """Return the moment (n,) about the slot that carries the weight, per unit of mass, m^2/s^2."""
    turns, axes = _orientations(scene, samples, body)
    moment = np.cross(turns.apply(_arm(scene, body)), -np.array(scene.gravity))
    return np.asarray(np.einsum("ni,ni->n", moment, axes))


def _arm(scene: Scene, body: str) -> Array:
    node = scene.node_a if body == "body_a" else scene.node_b
    return np.array(getattr(scene, body).com) - np.array(node.position)


def _orientations(scene: Scene, samples: SampleArrays, body: str) -> tuple[Any, Array]:
    """Return the rotations of the body (n), and the slot's direction (n, 3) in the world."""
    from scipy.spatial.transform import Rotation

    a, b = (
        Rotation.from_quat(samples.samples[:, at + 3 : at + 7])
        for at in (layout.A_POSE, layout.B_POSE)
    )
    turned = Rotation.from_quat(scene.node_a.orientation or (0.0, 0.0, 0.0, 1.0))
    return (a if body == "body_a" else b), (a * turned).apply([1.0, 0.0, 0.0])
