"""Coupled connectors: connectors that share bodies, solved together for the same stamp.

Let Lambda_c be the wrench of connector c and w_c+ the relative twist at its node b at the end of
the step. The wrenches of all connectors move the bodies:

    v+ = vf + h M^-1 sum_d J~_d^T Lambda_d        w_c+ = J~_c vf + h sum_d G_cd Lambda_d
    G_cd = J~_c M^-1 J~_d^T                       the Delassus operator

The constrained rows of all connectors (y, z and both misalignments of each) have the targets of a
single connector:

    R = P (b - G_ra phi)        R: f2 f3 m2 m3 of all; phi: f1 m1 of all; b = (target - J~ vf)/h

P gives the minimum-norm solution (core/least_norm.py) in the metric sum f^2 + (m / arm)^2: if
connectors constrain a body redundantly, the reactions are the smallest that satisfy the
constraints. What remains for each connector is its step on the free axes
(methods/free_axes/step.py), with the phi of the others on the right-hand side:

1. With fixed friction limits, the radii of the discs, the connectors are solved one after the other
   until the forces no longer change (block Gauss-Seidel on a convex problem).
2. The limits are updated with the reactions found, and 1 is repeated until limits and reactions
   agree.

Both iterations use Anderson acceleration (core/anderson.py). The limits of all connectors are
updated together: with an update after each connector, the first slide of a drawer would jam before
the second slide carries its part.

If several connectors stick, the distribution of friction between them can be undetermined. The
solution is then the one of minimum norm, with friction counted as f1^2 + (m1 / R)^2, if every disc
admits it; else the result of the iteration.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model
from cylconn_ros.core.anderson import AndersonAcceleration
from cylconn_ros.core.friction import SIZE, coefficient, contact, limit, pack, with_limit
from cylconn_ros.core.least_norm import minimum_norm, minimum_norm_operator, range_and_null_space
from cylconn_ros.errors import SceneError
from cylconn_ros.methods import coupled
from cylconn_ros.scene import shared_bodies
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

MAX_ITERATIONS, MAX_LIMIT_UPDATES, MAX_SWEEPS = 300, 60, 50
CONVERGED = 1e-13  # change of forces in an iteration relative to their size
_SAME_MOTION = 1e-9  # the same for a trial distribution of friction
_MOVABLE = 1e-9  # relative mobility of a component; below it the other connectors hold it
_CONSTRAINED, _AVAILABLE = (1, 2, 4, 5), (0, 3)  # rows of a relative twist


class Group:
    """Coupled connectors that process one sample each per stamp.

    Attributes
    ----------
        connectors: in the order of the scenes; their memories are the group's.
        iterations: number of Gauss-Seidel iterations for the last sample. change: relative change
        of the forces in the last of them, which is part of every ``residual``.

    A single connector is processed by :meth:`Connector.step`. Raises SceneError if scenes disagree
    about a shared body or cannot be coupled.
    """

    def __init__(
        self, scenes: Sequence[Scene], connectors: Sequence[Connector] | None = None
    ) -> None:
        """``connectors``: of the scenes, with their memories; by default new ones."""
        named = {f"connectors[{k}]": scene for k, scene in enumerate(scenes)}
        shared_bodies.check(named)
        if len(shared_bodies.groups(named)) > 1:
            raise SceneError("connectors of a group must have bodies in common")
        self.connectors = list(connectors or [Connector(scene) for scene in scenes])
        self.iterations, self.change = 0, 0.0
        n = len(scenes)
        self._rows = np.array([6 * c + k for c in range(n) for k in _CONSTRAINED])
        self._columns = np.array([6 * c + k for c in range(n) for k in _AVAILABLE])
        frames = [body.frame for scene in scenes for body in scene.bodies if body.kind == "free"]
        self._bodies = list(dict.fromkeys(frames))
        self._places = [
            [self._bodies.index(b.frame) if b.kind == "free" else -1 for b in scene.bodies]
            for scene in scenes
        ]
        self._arms = np.array([a for s in scenes for a in (1.0, 1.0, *[arm(s)] * 2)])
        for connector in self.connectors:  # solved together: without delay compensation
            connector.par[model.LATENCY] = 0.0
        self._laws = [model.law(connector.par) for connector in self.connectors]
        self._radii = np.array([a for s in scenes for a in (1.0, _radius(s))])
        self._masses = {b.frame: b.mass for s in scenes for b in s.bodies if b.kind == "free"}
        self._prepared = np.zeros((n, coupled.NPREPARED))
        self._reduced = np.zeros((n, coupled.NREDUCED))
        self._trial = np.zeros((n, layout.NOUT))
        self._phi: Array = np.zeros(2 * n)  # f1, m1 of all

    def reset(self) -> None:
        """Forget the reference configuration and all history."""
        for connector in self.connectors:
            connector.reset()
        self._phi[:] = 0.0

    def step(self, samples: Array, h: float = 0.0, outs: Array | None = None) -> Array:
        """Process one sample of each connector: (N, NSAMPLE) of one stamp into (N, NOUT).

        Samples must agree about a shared body. If a sample cannot be used, all wrenches are zero
        and every ``STATUS`` is that of the first such sample. ``h`` as for Connector.step.
        """
        if outs is None:
            outs = np.empty((len(self.connectors), layout.NOUT))
        if len(self.connectors) == 1:
            self.connectors[0].step(samples[0], h, outs[0])
            return outs
        h = min(connector.step_period(h) for connector in self.connectors)  # the same for all
        for k, connector in enumerate(self.connectors):
            status = coupled.prepare_coupled(
                connector.par, connector.memory, samples[k], h, outs[k], self._prepared[k]
            )
            if status != layout.OK:
                outs[:] = 0.0
                outs[:, layout.STATUS] = status
                return outs
        step = _Step(self, samples, h)
        phi = step.solve(self._phi.copy() if self.change <= _SAME_MOTION else 0.0 * self._phi)
        phi = step.distribute(phi)
        statuses = step.write(phi, outs)
        self.iterations, self.change = step.iterations, step.change
        self._phi = phi
        if any(statuses):
            self.reset()
            outs[:] = 0.0
            outs[:, layout.STATUS] = layout.NOT_FINITE
        return outs


def arm(scene: Scene) -> float:
    """The arm (m) that relates moments to forces: half the overlap, else the radius.

    If neither is given, the radius of gyration of the lightest free body.
    """
    if scene.friction.overlap > 0.0:
        return 0.5 * scene.friction.overlap
    if scene.friction.radius > 0.0:
        return scene.friction.radius
    free = min((b for b in scene.bodies if b.kind == "free"), key=lambda b: b.mass, default=None)
    if free is None:
        return 1.0
    ixx, _, _, iyy, _, izz = free.inertia
    return float(np.sqrt((ixx + iyy + izz) / (3.0 * free.mass)))


def _radius(scene: Scene) -> float:
    return scene.friction.radius if scene.friction.radius > 0.0 else arm(scene)


class _Step:
    """One step of a group: its equations, and the state of the iteration."""

    def __init__(self, group: Group, samples: Array, h: float) -> None:
        self._group, self._samples, self._h = group, samples, h
        self._memory = [connector.memory for connector in group.connectors]
        self._scratch = np.empty(model.NMEM)
        self.iterations, self.change, self._size = 0, 0.0, 0.0
        self._limits: Array = np.zeros(len(samples))
        self._fixed = [connector.par.copy() for connector in group.connectors]
        prepared, rows, columns = group._prepared, group._rows, group._columns
        self.g, self._unit_mass = _delassus(group)
        free = prepared[:, coupled.FREE : coupled.FREE + 6].ravel()
        turning = prepared[:, coupled.JACOBIAN_CHANGE : coupled.JACOBIAN_CHANGE + 6].ravel()
        target = prepared[:, coupled.TARGET : coupled.TARGET + 4].ravel()
        at = np.ix_(rows, rows)
        solve = minimum_norm_operator(self.g[at], self._unit_mass[at], group._arms)
        self._free, self._target = free, target
        self._before = prepared[:, coupled.MEASURED : coupled.MEASURED + 2]
        self._constant = solve @ ((target - free[rows]) / h)
        across = self.g[np.ix_(rows, columns)]
        self._by = -solve @ across
        self._slip = (free + turning)[columns] + h * across.T @ self._constant
        own = self.g[np.ix_(columns, columns)]
        self._a = h * (own + across.T @ self._by)
        least_own = h * _MOVABLE * np.diag(own)
        k = np.arange(len(columns))
        self._a[k, k] = np.maximum(np.diag(self._a), least_own)

    def reactions(self, phi: Array) -> Array:
        """R for the forces on slide and spin, (4 N,)."""
        found: Array = self._constant + self._by @ phi
        return found

    def _reduce(self, c: int, phi: Array) -> Array:
        """The reduced step of connector c, with the forces of the others fixed."""
        reduced = self._group._reduced[c]
        r, s = slice(4 * c, 4 * c + 4), slice(2 * c, 2 * c + 2)
        own_by, own_a = self._by[r, s], self._a[s, s]
        reduced[coupled.BASE : coupled.BY_F1] = self.reactions(phi)[r] - own_by @ phi[s]
        reduced[coupled.BY_F1 : coupled.BY_M1] = own_by[:, 0]
        reduced[coupled.BY_M1 : coupled.FREE_SLIP] = own_by[:, 1]
        reduced[coupled.FREE_SLIP : coupled.A] = self._slip[s] + self._a[s] @ phi - own_a @ phi[s]
        reduced[coupled.A : coupled.NREDUCED] = own_a[0, 0], own_a[0, 1], own_a[1, 1]
        return reduced

    def _solve_one(self, c: int, phi: Array) -> None:
        """Solve for connector c and write its forces into ``phi``."""
        scratch = self._scratch
        scratch[:] = self._memory[c]
        par, sample = self._fixed[c], self._samples[c]
        coupled.complete_coupled(
            par, scratch, sample, self._h, self._reduce(c, phi), self._group._trial[c]
        )
        phi[2 * c : 2 * c + 2] = scratch[model.LAST_FREE_FORCES : model.LAST_FREE_FORCES + 2]

    def solve(self, phi: Array) -> Array:
        """Iterate from ``phi`` until friction limits and reactions agree; returns phi (2 N,)."""
        limits, acceleration = self.limits(phi), AndersonAcceleration()
        for _ in range(MAX_LIMIT_UPDATES):
            phi = self.gauss_seidel(phi, limits)
            found = self.limits(phi)
            change = found - limits
            change[self._group._trial[:, layout.REGIME] != layout.SLIP] = 0.0  # not at its limit
            trial = self._group._trial
            sticks = trial[:, layout.REGIME] == layout.STICK
            beyond = sticks & (trial[:, layout.TRACTION] > found * (1.0 + _SAME_MOTION))
            size = max(float(np.abs(limits).max(initial=0.0)), self._size)
            self.change = max(self.change, float(np.abs(change).max()) / size) if size else 0.0
            if not (beyond.any() or self.change > CONVERGED) or self.iterations > MAX_ITERATIONS:
                break
            limits = np.maximum(acceleration.next(found, found - limits), 0.0)
        return phi

    def gauss_seidel(self, phi: Array, limits: Array, most: int = MAX_SWEEPS) -> Array:
        """Solve with fixed friction limits (N,) by block Gauss-Seidel; returns phi (2 N,)."""
        group, radii = self._group, self._group._radii
        self._set_limits(phi, limits)
        acceleration = AndersonAcceleration()
        for iteration in range(most):
            before = phi.copy()
            for c in range(len(group.connectors)):
                self._solve_one(c, phi)
            self.iterations += 1
            reactions = self.reactions(phi) / group._arms
            self._size = float(max(np.abs(phi / radii).max(), np.abs(reactions).max()))
            change = (phi - before) / radii
            self.change = float(np.abs(change).max()) / self._size if self._size > 0.0 else 0.0
            if not self.change > CONVERGED:
                break
            if iteration + 1 < most:
                phi = acceleration.next(phi / radii, change) * radii
        return phi

    def limits(self, phi: Array) -> Array:
        """(N,) the friction limits for the forces ``phi`` and their reactions."""
        return np.array([f[0] for f in self._contacts(phi)])

    def _contacts(self, phi: Array) -> list[tuple[float, float, float]]:
        """Friction limit, normal force and coefficient of each connector."""
        reactions = self.reactions(phi)
        end = (self._slip + self._a @ phi).reshape(-1, 2)
        found = []
        for c, connector in enumerate(self._group.connectors):
            law, par = self._group._laws[c], connector.par
            if not law.on:
                found.append((0.0, 0.0, 0.0))
                continue
            f2, f3, m2, m3 = reactions[4 * c : 4 * c + 4].tolist()
            normal = contact(law, (f2, f3, m2, m3)).normal
            slips = self._group._trial[c, layout.REGIME] == layout.SLIP
            rate = _rate(self._before[c], end[c], law.radius) if slips else 0.0
            found.append(
                (limit(law, par, rate, normal), normal, coefficient(law, par, rate, normal))
            )
        return found

    def _set_limits(self, phi: Array, limits: Array) -> None:
        """Fix the radii of the discs (core/friction.with_limit), independent of the reactions."""
        self._limits = limits
        reactions = self.reactions(phi)
        for c, par in enumerate(self._fixed):
            law = self._group._laws[c]
            if not law.on:
                continue
            f2, f3, m2, m3 = reactions[4 * c : 4 * c + 4].tolist()
            fixed = with_limit(law, limits[c], contact(law, (f2, f3, m2, m3)))
            par[model.FRICTION : model.FRICTION + SIZE] = pack(fixed)

    def _at_rest(self, phi: Array) -> list[int]:
        """Indices of connectors that stick, or are at rest at the friction limit."""
        trial, radii = self._group._trial, self._group._radii
        end = np.abs((self._slip + self._a @ phi) * radii).reshape(-1, 2).max(axis=1)
        small = _SAME_MOTION * np.abs(self._slip * radii).max(initial=0.0)
        at_limit = (trial[:, layout.REGIME] == layout.SLIP) & (end <= small)
        return [c for c, out in enumerate(trial) if at_limit[c] or _sticks(out)]

    def distribute(self, phi: Array) -> Array:
        """Forces of the same motion with the minimum-norm distribution of the sticking friction."""
        group, trial = self._group, self._group._trial
        sticking = self._at_rest(phi)
        if not sticking:
            return phi
        at = np.array([2 * c + k for c in sticking for k in (0, 1)])
        rows = np.concatenate([group._rows, group._columns[at]])
        _, z = range_and_null_space(self._unit_mass[np.ix_(rows, rows)])
        if not z.shape[1]:
            return phi
        friction = trial[sticking][:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]].ravel()
        x = np.concatenate([self.reactions(phi), friction])
        shared = minimum_norm(x, z, np.concatenate([group._arms, group._radii[at]]))
        tried = phi.copy()
        tried[at] += shared[len(group._rows) :] - friction
        change, limits, kept = self.change, self._limits, trial.copy()
        found = self.gauss_seidel(tried.copy(), self.limits(tried), 1)
        if self.change <= _SAME_MOTION and all(_sticks(trial[c]) for c in sticking):
            return found
        self.change = change
        trial[:] = kept
        self._set_limits(phi, limits)
        return phi

    def write(self, phi: Array, outs: Array) -> list[int]:
        """Write the outputs of all connectors for the forces ``phi``; returns their statuses."""
        group, h = self._group, self._h
        wrenches = np.empty(len(self._free))
        wrenches[group._rows], wrenches[group._columns] = self.reactions(phi), phi
        residual, contacts = self._constraint_residual(wrenches), self._contacts(phi)
        statuses = []
        for c, connector in enumerate(group.connectors):
            reduced = self._reduce(c, phi)
            memory, sample = self._memory[c], self._samples[c]
            statuses.append(
                coupled.complete_coupled(self._fixed[c], memory, sample, h, reduced, outs[c])
            )
            connector.memory = memory
            if group._laws[c].on and statuses[-1] == layout.OK:
                _write_contact(outs[c], *contacts[c])
            outs[c, layout.RESIDUAL] = max(outs[c, layout.RESIDUAL], self.change, residual)
        return statuses

    def _constraint_residual(self, wrenches: Array) -> float:
        """Residual of the constrained rows relative to the size of their terms."""
        rows, h = self._group._rows, self._h
        across, scale = self.g[rows], self._group._arms
        off = self._free[rows] - self._target + h * across @ wrenches
        size = np.abs(self._free[rows]) + np.abs(self._target)
        size += h * np.abs(across) @ np.abs(wrenches)
        greatest = float((size * scale).max())
        return float(np.abs(off * scale).max()) / greatest if greatest > 0.0 else 0.0


def _rate(before: Array, end: Array, radius: float) -> float:
    """The slip rate of a step from the slip at its ends (core/friction_disc.py)."""
    s, t = before * (1.0, radius), end * (1.0, radius)
    mean = 0.5 * (s + t) if s @ t > 0.25 * (s @ s) else t
    return float(np.hypot(*mean))


def _write_contact(out: Array, limit_: float, normal: float, mu: float) -> None:
    """Write normal force, limit and coefficient of the friction law, for the true reactions."""
    slips = out[layout.REGIME] == layout.SLIP
    out[layout.NORMAL_FORCE] = normal
    out[layout.FRICTION_LIMIT] = out[layout.TRACTION] if slips else limit_
    out[layout.FRICTION_COEFFICIENT] = mu


def _sticks(out: Array) -> bool:
    """Whether friction alone holds both components."""
    free = out[layout.STOP] == 0.0 and out[layout.LOCK] == 0.0
    held = out[layout.FORCE_REACTION] != 0.0 or out[layout.MOMENT_REACTION] != 0.0
    return bool(out[layout.REGIME] == layout.STICK and free and not held)


def _delassus(group: Group) -> tuple[Array, Array]:
    """G (6 N, 6 N), the Delassus operator, and J J^T with unit masses.

    For the latter every body has unit mass and the moment of inertia of its radius of gyration.
    """
    prepared = group._prepared
    n, bodies = len(prepared), len(group._bodies)
    jacobian = np.zeros((6 * n, 6 * bodies))
    inverse, unit = np.zeros((6 * bodies, 6 * bodies)), np.zeros(6 * bodies)
    parts = ((coupled.JACOBIAN_A, coupled.INVERSE_A), (coupled.JACOBIAN_B, coupled.INVERSE_B))
    for c in range(n):
        for (rates, tensor), i in zip(parts, group._places[c], strict=True):
            if i < 0:
                continue
            own = slice(6 * i, 6 * i + 6)
            jacobian[6 * c : 6 * c + 6, own] += prepared[c, rates : rates + 36].reshape(6, 6)
            mass = group._masses[group._bodies[i]]
            turning = prepared[c, tensor : tensor + 9].reshape(3, 3)
            inverse[own, own][:3, :3] = np.eye(3) / mass
            inverse[own, own][3:, 3:] = turning
            unit[own] = [1.0] * 3 + [mass * float(np.trace(turning)) / 3.0] * 3
    found: Array = jacobian @ inverse @ jacobian.T
    unit_mass: Array = (jacobian * unit) @ jacobian.T
    return found, unit_mass
