r"""Reference solution of a free sleeve on a fixed shaft, reduced to slide l and spin alpha.

In the shaft's axes (e1 along it), rho(alpha) from node b to the mass centre, I(alpha) the inertia
about it:

    a_c = l'' e1 + alpha'' e1 x rho + alpha'^2 e1 x (e1 x rho)
    F   = m (a_c - g)                                           force on the sleeve at node b
    M   = rho x F + I e1 alpha'' + alpha'^2 e1 x (I e1)         moment on it about node b
    FN  = |sqrt(F2^2 + F3^2) + (2/L) sqrt(M2^2 + M3^2) + FCint|
    F1  = -mu FN l' / |s|,    M1 = -mu FN R^2 alpha' / |s|,     s = (l', R alpha')

F2, F3, M2, M3 depend on the accelerations, these on friction, and friction on FN. At each instant
this is one scalar equation for FN, solved by Brent's method. Time integration: DOP853 (Hairer,
Norsett, Wanner, 1993), order 8. The slip direction is undefined at rest, so the closed form of
constant deceleration replaces the integration for the last 1e-7 of the slip velocity.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
E1 = np.array([1.0, 0.0, 0.0])
REST = 1e-7  # of the initial slip velocity, at which the integration ends


@dataclass(frozen=True)
class Reference:
    """Solution over time.

    Attributes
    ----------
        t: (n,) s.
        l, alpha: (n,) m and rad since the start.
        v, omega: (n,) m/s and rad/s.
        normal_force: (n,) N; at rest, that of static equilibrium.
        stop_time: s; infinite if the motion does not stop within the duration.
        distance: m, at the end. turns: at the end.
    """

    t: Array
    l: Array  # noqa: E741 - the symbol of the equations
    alpha: Array
    v: Array
    omega: Array
    normal_force: Array
    stop_time: float
    distance: float
    turns: float


def slide_and_spin(scene: Scene, duration: float | None = None, points: int = 2001) -> Reference:
    """Solve ``scene`` from its initial state for ``duration`` (s; default: that of the scene).

    points: number of points of the result. Raises ValueError unless the scene is a free sleeve with
    a constant coefficient of friction on a fixed shaft, and ImportError without SciPy.
    """
    from scipy.integrate import solve_ivp

    sleeve = _Sleeve(scene)
    end = scene.plant.duration if duration is None else duration
    speed = sleeve.slip_rate(sleeve.start)

    def rest(_t: float, y: Array) -> float:
        return sleeve.slip_rate(y) - REST * speed

    rest.terminal = sleeve.mu > 0.0  # type: ignore[attr-defined]
    solution = solve_ivp(
        lambda _t, y: np.array([*y[2:], *sleeve.accelerations(y)[:2]]),
        (0.0, end),
        sleeve.start,
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
        events=rest if speed > 0.0 else None,
        dense_output=True,
    )
    if not solution.success:
        raise RuntimeError(f"the reference did not integrate: {solution.message}")
    t: Array = np.linspace(0.0, end, points, dtype=np.float64)
    y: Array = solution.sol(np.minimum(t, solution.t[-1]))
    normal: Array = np.array([sleeve.accelerations(column)[2] for column in y.T])
    stop_time, last = np.inf, solution.y[:, -1]
    if solution.status == 1:
        a = sleeve.accelerations(last)
        slip = np.array([last[2], sleeve.radius * last[3]])
        slowing = -(a[0] * slip[0] + sleeve.radius * a[1] * slip[1]) / np.hypot(*slip)
        rest_of_time = np.hypot(*slip) / slowing
        stop_time = solution.t[-1] + rest_of_time
        last = last + np.array([*(0.5 * rest_of_time * last[2:]), *-last[2:]])
        at_rest = t >= stop_time
        y[:, at_rest] = last[:, None]
        normal[at_rest] = sleeve.forces(last[1], 0.0, 0.0, 0.0)[2]
    turns = float(last[1]) / (2.0 * np.pi)
    return Reference(t, y[0], y[1], y[2], y[3], normal, float(stop_time), float(last[0]), turns)


class _Sleeve:
    """Parameters of the scene in the shaft's axes, and its equations of motion."""

    def __init__(self, scene: Scene) -> None:
        a, b = scene.body_a, scene.body_b
        if a.kind != "fixed" or b.kind != "free":
            raise ValueError("needs a free body B on a fixed body A")
        friction = scene.friction
        if friction.table is not None or friction.static_coefficient > friction.coefficient:
            raise ValueError("needs a constant coefficient of friction")
        shaft = rotation(a.pose[3:]) @ rotation(scene.node_a.orientation)
        pose = np.array(scene.plant.body_b.pose or b.pose)
        turn = shaft.T @ rotation(pose[3:])
        twist = np.array(scene.plant.body_b.twist)
        self.mass = b.mass
        self.rho = turn @ (np.array(b.com) - np.array(scene.node_b.position))
        self.inertia = turn @ tensor(b.inertia) @ turn.T
        self.gravity = shaft.T @ np.array(scene.gravity)
        self.mu = friction.coefficient
        self.radius = friction.radius if self.mu > 0.0 else 1.0
        self.bending = 2.0 / friction.overlap if friction.overlap > 0.0 else 0.0
        self.preload = friction.preload
        spin = shaft.T @ twist[3:]
        at_b = turn @ np.array(scene.node_b.position)
        velocity = shaft.T @ twist[:3] + np.cross(spin, at_b)
        across = max(*abs(velocity[1:]), *abs(spin[1:]))
        if across > 1e-9 * max(1.0, *abs(velocity), *abs(spin)):
            raise ValueError(f"the initial twist leaves the shaft by {across:.1e} (m/s, rad/s)")
        self.start = np.array([0.0, 0.0, velocity[0], spin[0]])

    def slip_rate(self, y: Array) -> float:
        return float(np.hypot(y[2], self.radius * y[3]))

    def forces(self, alpha: float, w: float, l2: float, a2: float) -> tuple[Array, Array, float]:
        """F, M and FN for the spin angle and rate and the accelerations l'' and alpha''."""
        c, s = np.cos(alpha), np.sin(alpha)
        turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        rho = turn @ self.rho
        column = (turn @ self.inertia @ turn.T)[:, 0]
        around = np.cross(E1, rho)
        acceleration = l2 * E1 + a2 * around + w * w * np.cross(E1, around)
        force = self.mass * (acceleration - self.gravity)
        moment = np.cross(rho, force) + a2 * column + w * w * np.cross(E1, column)
        pressed = np.hypot(*force[1:]) + self.bending * np.hypot(*moment[1:]) + self.preload
        return force, moment, float(abs(pressed))

    def accelerations(self, y: Array) -> tuple[float, float, float]:
        """l'', alpha'' and FN for the state (l, alpha, l', alpha')."""
        from scipy.optimize import brentq

        _, alpha, v, w = y
        size = self.slip_rate(y)
        along, around = (v / size, self.radius * w / size) if size > 0.0 else (0.0, 0.0)
        offset = self.forces(alpha, w, 0.0, 0.0)[1][
            0
        ]  # M1 is linear in alpha'' and independent of l''
        slope = self.forces(alpha, w, 0.0, 1.0)[1][0] - offset

        def accelerated(normal: float) -> tuple[float, float]:
            traction = self.mu * normal
            return (
                self.gravity[0] - traction * along / self.mass,
                (-traction * self.radius * around - offset) / slope,
            )

        def residual(normal: float) -> float:
            return normal - self.forces(alpha, w, *accelerated(normal))[2]

        if self.mu == 0.0:
            return *accelerated(0.0), self.forces(alpha, w, *accelerated(0.0))[2]
        most = 1.0
        while residual(most) < 0.0:
            most *= 2.0
            if most > 1e12:
                raise ValueError("friction jams the sleeve: no finite normal force while it slides")
        normal = brentq(residual, 0.0, most, xtol=1e-15 * most, rtol=1e-15)
        return *accelerated(normal), normal


def tensor(inertia: tuple[float, ...]) -> Array:
    """(3, 3) inertia tensor from its elements xx, xy, xz, yy, yz, zz."""
    ixx, ixy, ixz, iyy, iyz, izz = inertia
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def rotation(quaternion: tuple[float, ...] | Array) -> Array:
    """(3, 3) rotation matrix of a unit quaternion x, y, z, w, by Rodrigues' formula."""
    axis, w = np.array(quaternion[:3]), quaternion[3]
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turned: Array = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
    return turned
