"""Connectors that share bodies, solved together at the same sample.

Let Lambda_c be the wrench of connector c and w_c+ the relative twist at its node b at the end of
the step. All of them move the bodies:

    v+ = vf + h M^-1 sum_d J~_d^T Lambda_d        w_c+ = J~_c vf + h sum_d G_cd Lambda_d
    G_cd = J~_c M^-1 J~_d^T

The constrained rows of all (y, z and both swings of each) have the targets that each alone has:

    R = P (b - G_ra phi)        R: f2 f3 m2 m3 of all; phi: f1 m1 of all; b = (target - J~ vf)/h

P gives the least-norm solution (core/least_norm.py) in the metric sum f^2 + (m / arm)^2: where
connectors hold a body more often than needed, the reactions are the smallest that do. What is left
for each is the step of methods/free_axes.py, in which the others' phi stands on the right:

1. With given limits of friction, the radii of the discs, they are solved in turns until nothing
   changes (block Gauss-Seidel): a convex problem.
2. The limits are those of the reactions that come out, and 1 is done again until they agree.

Both with Anderson's acceleration (core/anderson.py). So friction's limit grows with what it
causes, from the last sample's forces or from none, and everybody's at once: in each other's turn a
drawer on two slides would be jammed by the first before the second had its share.

Where several stick, what each of them bears may be open, too. It is then again the least, with
friction counted as f1^2 + (m1 / R)^2, if every disc admits it; else as the turns have found it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model
from cylconn_ros.core.anderson import Sooner
from cylconn_ros.core.friction import coefficient, contact, limit
from cylconn_ros.core.least_norm import directions, least, least_norm
from cylconn_ros.errors import SceneError
from cylconn_ros.methods import coupled
from cylconn_ros.scene import shared_bodies
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

MOST_TURNS, MOST_LIMITS, AT_ONCE = 300, 60, 50
SETTLED = 1e-13  # change of forces in a turn, over their size, that counts as none
_SAME_MOTION = 1e-9  # the same for a split of friction that is tried
_HARDLY = 1e-9  # a coefficient of friction
_MOVABLE = 1e-9  # of what a unit force does to its component alone; below it others hold it
_CONSTRAINED, _AVAILABLE = (1, 2, 4, 5), (0, 3)  # rows of a relative twist


class Group:
    """Connectors answered together, one sample after the other.

    Attributes
    ----------
        connectors: in the order of the scenes; their memories are the group's.
        turns: how many the last sample took. change: of the forces in the last of them, over their
        size; it is part of every ``residual``.

    One alone is answered by :meth:`Connector.step` itself. Raises SceneError where scenes disagree
    about a body that they share, or cannot be solved together.
    """

    def __init__(
        self, scenes: Sequence[Scene], connectors: Sequence[Connector] | None = None
    ) -> None:
        """``connectors``: of the scenes, to go on with their memories; by default new ones."""
        named = {f"connectors[{k}]": scene for k, scene in enumerate(scenes)}
        shared_bodies.check(named)
        if len(shared_bodies.groups(named)) > 1:
            raise SceneError("connectors of a group must have bodies in common")
        self.connectors = list(connectors or [Connector(scene) for scene in scenes])
        self.turns, self.change = 0, 0.0
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
        self._laws = [model.law(connector.par) for connector in self.connectors]
        self._radii = np.array([a for s in scenes for a in (1.0, _radius(s))])
        self._masses = {b.frame: b.mass for s in scenes for b in s.bodies if b.kind == "free"}
        self._looked = np.zeros((n, coupled.NLOOKED))
        self._given = np.zeros((n, coupled.NGIVEN))
        self._trial = np.zeros((n, layout.NOUT))
        self._phi: Array = np.zeros(2 * n)  # f1, m1 of all

    def reset(self) -> None:
        """Forget the reference configuration and all history."""
        for connector in self.connectors:
            connector.reset()
        self._phi[:] = 0.0

    def step(self, samples: Array, h: float = 0.0, outs: Array | None = None) -> Array:
        """Answer a sample of each: (N, NSAMPLE) of one stamp to (N, NOUT), as Connector.step does.

        What samples say of a shared body must be the same. Where one cannot be used all wrenches
        are zero, and ``STATUS`` of those that could be is that of the first that cannot.
        """
        if outs is None:
            outs = np.empty((len(self.connectors), layout.NOUT))
        if len(self.connectors) == 1:
            self.connectors[0].step(samples[0], h, outs[0])
            return outs
        h = min(connector.begin(h) for connector in self.connectors)  # of all the same
        for k, connector in enumerate(self.connectors):
            status = coupled.look(
                connector.par, connector.memory, samples[k], h, outs[k], self._looked[k]
            )
            if status != layout.OK:
                outs[:] = 0.0
                outs[:, layout.STATUS] = status
                return outs
        step = _Step(self, samples, h)
        phi = step.settle(self._phi.copy() if self.change <= _SAME_MOTION else 0.0 * self._phi)
        phi = step.share(phi)
        statuses = step.answer(phi, outs)
        self.turns, self.change = step.turns, step.change
        self._phi = phi
        if any(statuses):
            self.reset()
            outs[:] = 0.0
            outs[:, layout.STATUS] = layout.NOT_FINITE
        return outs


def arm(scene: Scene) -> float:
    """The arm by which a moment counts as a force, m: half the overlap, else the radius.

    Without both the radius of gyration of its lightest free body.
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
    """One sample of a group: the equations, and what has been found so far."""

    def __init__(self, group: Group, samples: Array, h: float) -> None:
        self._group, self._samples, self._h = group, samples, h
        self._memory = [connector.memory for connector in group.connectors]
        self._scratch = np.empty(model.NMEM)
        self.turns, self.change, self._size = 0, 0.0, 0.0
        self._limits: Array = np.zeros(len(samples))
        self._fixed = [connector.par.copy() for connector in group.connectors]
        looked, rows, columns = group._looked, group._rows, group._columns
        self.g, self._like = _delassus(group)
        free = looked[:, coupled.FREE : coupled.FREE + 6].ravel()
        turning = looked[:, coupled.TURNING : coupled.TURNING + 6].ravel()
        target = looked[:, coupled.TARGET : coupled.TARGET + 4].ravel()
        at = np.ix_(rows, rows)
        solve = least_norm(self.g[at], self._like[at], group._arms)
        self._free, self._target = free, target
        self._before = looked[:, coupled.MEASURED : coupled.MEASURED + 2]
        self._base = solve @ ((target - free[rows]) / h)
        across = self.g[np.ix_(rows, columns)]
        self._by = -solve @ across
        self._slip = (free + turning)[columns] + h * across.T @ self._base
        own = self.g[np.ix_(columns, columns)]
        self._a = h * (own + across.T @ self._by)
        least_own = h * _MOVABLE * np.diag(own)
        k = np.arange(len(columns))
        self._a[k, k] = np.maximum(np.diag(self._a), least_own)

    def reactions(self, phi: Array) -> Array:
        """R for the forces on slide and spin, (4 N,)."""
        found: Array = self._base + self._by @ phi
        return found

    def _give(self, c: int, phi: Array) -> Array:
        """What is left for connector c, the others' forces being what they are."""
        given = self._group._given[c]
        r, s = slice(4 * c, 4 * c + 4), slice(2 * c, 2 * c + 2)
        own_by, own_a = self._by[r, s], self._a[s, s]
        given[coupled.BASE : coupled.BY_F1] = self.reactions(phi)[r] - own_by @ phi[s]
        given[coupled.BY_F1 : coupled.BY_M1] = own_by[:, 0]
        given[coupled.BY_M1 : coupled.FREE_SLIP] = own_by[:, 1]
        given[coupled.FREE_SLIP : coupled.A] = self._slip[s] + self._a[s] @ phi - own_a @ phi[s]
        given[coupled.A : coupled.NGIVEN] = own_a[0, 0], own_a[0, 1], own_a[1, 1]
        return given

    def _try(self, c: int, phi: Array) -> None:
        """Solve for connector c; its forces into ``phi``."""
        scratch = self._scratch
        scratch[:] = self._memory[c]
        par, sample = self._fixed[c], self._samples[c]
        coupled.answer(par, scratch, sample, self._h, self._give(c, phi), self._group._trial[c])
        phi[2 * c : 2 * c + 2] = scratch[model.LAST_TOTAL : model.LAST_TOTAL + 2]

    def settle(self, phi: Array) -> Array:
        """Solve from ``phi`` until limits and forces agree; (2 N,)."""
        limits, sooner = self.limits(phi), Sooner()
        for _ in range(MOST_LIMITS):
            phi = self.turn(phi, limits)
            found = self.limits(phi)
            change = found - limits
            change[self._group._trial[:, layout.REGIME] != layout.SLIP] = 0.0  # not at its limit
            trial = self._group._trial
            sticks = trial[:, layout.REGIME] == layout.STICK
            beyond = sticks & (trial[:, layout.TRACTION] > found * (1.0 + _SAME_MOTION))
            size = max(float(np.abs(limits).max(initial=0.0)), self._size)
            self.change = max(self.change, float(np.abs(change).max()) / size) if size else 0.0
            if not (beyond.any() or self.change > SETTLED) or self.turns > MOST_TURNS:
                break
            limits = np.maximum(sooner.next(found, found - limits), 0.0)
        return phi

    def turn(self, phi: Array, limits: Array, most: int = AT_ONCE) -> Array:
        """Solve with friction up to ``limits`` (N,) in turns, until nothing changes; (2 N,)."""
        group, radii = self._group, self._group._radii
        self._fix(phi, limits)
        sooner = Sooner()
        for turn in range(most):
            before = phi.copy()
            for c in range(len(group.connectors)):
                self._try(c, phi)
            self.turns += 1
            reactions = self.reactions(phi) / group._arms
            self._size = float(max(np.abs(phi / radii).max(), np.abs(reactions).max()))
            change = (phi - before) / radii
            self.change = float(np.abs(change).max()) / self._size if self._size > 0.0 else 0.0
            if not self.change > SETTLED:
                break
            if turn + 1 < most:
                phi = sooner.next(phi / radii, change) * radii
        return phi

    def limits(self, phi: Array) -> Array:
        """The limits of friction, (N,), that go with the forces ``phi`` and their reactions."""
        return np.array([f[0] for f in self._contacts(phi)])

    def _contacts(self, phi: Array) -> list[tuple[float, float, float]]:
        """Limit, normal force and coefficient of each connector."""
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

    def _fix(self, phi: Array, limits: Array) -> None:
        """Let the discs have these radii, whatever the reactions are.

        A coefficient that hardly counts and a preload that makes up for it: within ``available``
        nothing is then different from friction with constant normal force.
        """
        self._limits = limits
        reactions = self.reactions(phi)
        for c, par in enumerate(self._fixed):
            law = self._group._laws[c]
            if not law.on:
                continue
            f2, f3, m2, m3 = reactions[4 * c : 4 * c + 4].tolist()
            pressed = contact(law, (f2, f3, m2, m3))
            preload = max(limits[c] / _HARDLY - pressed.radial - pressed.bending, 0.0)
            at = model.FRICTION
            par[at + 1 : at + 5] = _HARDLY, _HARDLY, 0.0, np.inf
            par[at + 7 : at + 12] = preload, 0.0, 0.0, 0.0, 0.0

    def _at_rest(self, phi: Array) -> list[int]:
        """Connectors that stick, or rest at the limit of friction."""
        trial, radii = self._group._trial, self._group._radii
        end = np.abs((self._slip + self._a @ phi) * radii).reshape(-1, 2).max(axis=1)
        small = _SAME_MOTION * np.abs(self._slip * radii).max(initial=0.0)
        at_limit = (trial[:, layout.REGIME] == layout.SLIP) & (end <= small)
        return [c for c, out in enumerate(trial) if at_limit[c] or _sticks(out)]

    def share(self, phi: Array) -> Array:
        """Forces of the same motion, in which what is open of the sticking friction is least."""
        group, trial = self._group, self._group._trial
        sticking = self._at_rest(phi)
        if not sticking:
            return phi
        at = np.array([2 * c + k for c in sticking for k in (0, 1)])
        rows = np.concatenate([group._rows, group._columns[at]])
        _, z = directions(self._like[np.ix_(rows, rows)])
        if not z.shape[1]:
            return phi
        friction = trial[sticking][:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]].ravel()
        x = np.concatenate([self.reactions(phi), friction])
        shared = least(x, z, np.concatenate([group._arms, group._radii[at]]))
        tried = phi.copy()
        tried[at] += shared[len(group._rows) :] - friction
        change, limits, kept = self.change, self._limits, trial.copy()
        found = self.turn(tried.copy(), self.limits(tried), 1)
        if self.change <= _SAME_MOTION and all(_sticks(trial[c]) for c in sticking):
            return found
        self.change = change
        trial[:] = kept
        self._fix(phi, limits)
        return phi

    def answer(self, phi: Array, outs: Array) -> list[int]:
        """Answer all with the forces found; their statuses."""
        group, h = self._group, self._h
        wrenches = np.empty(len(self._free))
        wrenches[group._rows], wrenches[group._columns] = self.reactions(phi), phi
        unmet, contacts = self._unmet(wrenches), self._contacts(phi)
        statuses = []
        for c, connector in enumerate(group.connectors):
            given = self._give(c, phi)
            memory, sample = self._memory[c], self._samples[c]
            statuses.append(coupled.answer(self._fixed[c], memory, sample, h, given, outs[c]))
            connector.memory = memory
            if group._laws[c].on and statuses[-1] == layout.OK:
                _write_contact(outs[c], *contacts[c])
            outs[c, layout.RESIDUAL] = max(outs[c, layout.RESIDUAL], self.change, unmet)
        return statuses

    def _unmet(self, wrenches: Array) -> float:
        """Residual of the constrained rows, over the size of what enters them."""
        rows, h = self._group._rows, self._h
        across, scale = self.g[rows], self._group._arms
        off = self._free[rows] - self._target + h * across @ wrenches
        size = np.abs(self._free[rows]) + np.abs(self._target)
        size += h * np.abs(across) @ np.abs(wrenches)
        greatest = float((size * scale).max())
        return float(np.abs(off * scale).max()) / greatest if greatest > 0.0 else 0.0


def _rate(before: Array, end: Array, radius: float) -> float:
    """The slip rate that friction counts over a step, from the slip at its ends (core/friction_disc.py)."""
    s, t = before * (1.0, radius), end * (1.0, radius)
    mean = 0.5 * (s + t) if s @ t > 0.25 * (s @ s) else t
    return float(np.hypot(*mean))


def _write_contact(out: Array, limit_: float, normal: float, mu: float) -> None:
    """What the law makes of the reactions, which the fixed discs do not know."""
    slips = out[layout.REGIME] == layout.SLIP
    out[layout.NORMAL_FORCE] = normal
    out[layout.FRICTION_LIMIT] = out[layout.TRACTION] if slips else limit_
    out[layout.FRICTION_COEFFICIENT] = mu


def _sticks(out: Array) -> bool:
    """Whether both components are held by friction alone."""
    free = out[layout.STOP] == 0.0 and out[layout.LOCK] == 0.0
    held = out[layout.FORCE_REACTION] != 0.0 or out[layout.MOMENT_REACTION] != 0.0
    return bool(out[layout.REGIME] == layout.STICK and free and not held)


def _delassus(group: Group) -> tuple[Array, Array]:
    """G (6 N, 6 N), what each wrench does to each relative velocity; J J^T for bodies all alike.

    For the latter every body has unit mass and the moment of inertia of its own arm.
    """
    looked = group._looked
    n, bodies = len(looked), len(group._bodies)
    jacobian = np.zeros((6 * n, 6 * bodies))
    inverse, alike = np.zeros((6 * bodies, 6 * bodies)), np.zeros(6 * bodies)
    parts = ((coupled.JACOBIAN_A, coupled.INVERSE_A), (coupled.JACOBIAN_B, coupled.INVERSE_B))
    for c in range(n):
        for (rates, tensor), i in zip(parts, group._places[c], strict=True):
            if i < 0:
                continue
            own = slice(6 * i, 6 * i + 6)
            jacobian[6 * c : 6 * c + 6, own] += looked[c, rates : rates + 36].reshape(6, 6)
            mass = group._masses[group._bodies[i]]
            turning = looked[c, tensor : tensor + 9].reshape(3, 3)
            inverse[own, own][:3, :3] = np.eye(3) / mass
            inverse[own, own][3:, 3:] = turning
            alike[own] = [1.0] * 3 + [mass * float(np.trace(turning)) / 3.0] * 3
    found: Array = jacobian @ inverse @ jacobian.T
    like: Array = (jacobian * alike) @ jacobian.T
    return found, like
