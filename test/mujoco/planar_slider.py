"""A slider on a driven arm in a vertical plane, reduced by hand and integrated by SciPy.

The arm turns by q about z at the origin; the slider's node b is at the distance l along the arm,
its mass centre at (c, d) from there. Newton and Euler for the slider, with f1, f2, m3 of the arm on
it about node b, and the moment balance of the arm about the origin:

    f1 = m (l'' - d q'' - (l + c) q'^2) + m g sin q
    f2 = m (2 l' q' + (l + c) q'' - d q'^2) + m g cos q
    m3 = I q'' + c f2 - d f1
    J q'' = torque - M g C cos q - m3 - l f2
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

J, M, C = 0.08, 1.0, 0.25  # arm: inertia about the origin, mass, mass centre
m, c, d, I = 0.6, 0.03, 0.04, 0.004  # noqa: E741 - slider
MU, L, G = 0.25, 0.12, 9.81
START = (0.3, 0.3, 0.0, 0.5)  # q, l, and their rates


def model(h: float, integrator: str = "Euler") -> str:
    """The same in MJCF."""
    return f"""<mujoco><option timestep="{h}" gravity="0 {-G} 0" integrator="{integrator}"/>
      <worldbody><body><joint name="arm" type="hinge" axis="0 0 1"/>
        <inertial pos="{C} 0 0" mass="{M}" diaginertia="0.01 0.01 {J - M * C * C}"/>
        <body pos="{START[1]} 0 0"><joint name="slide" type="slide" axis="1 0 0"/>
          <inertial pos="{c} {d} 0" mass="{m}" diaginertia="{I} {I} {I}"/></body></body>
      </worldbody></mujoco>"""


def torque(t: float) -> float:
    return 3.0 + 2.5 * np.sin(4.0 * t)


def solve(t: float, y: np.ndarray, f1: float | None) -> np.ndarray:
    """q'', l'', f1, f2, m3 for a friction force, or (None) with the slide at rest."""
    q, l, w, v = y  # noqa: E741
    r = l + c
    a = np.zeros((5, 5))
    a[0] = m * d, -m, 1, 0, 0
    a[1] = -m * r, 0, 0, 1, 0
    a[2] = -I, 0, d, -c, 1
    a[3] = J, 0, 0, l, 1
    a[4] = (0, 1, 0, 0, 0) if f1 is None else (0, 0, 1, 0, 0)
    b = np.array(
        [
            -m * r * w * w + m * G * np.sin(q),
            m * (2 * v * w - d * w * w) + m * G * np.cos(q),
            0.0,
            torque(t) - M * G * C * np.cos(q),
            0.0 if f1 is None else f1,
        ]
    )
    return np.linalg.solve(a, b)


def limit(x: np.ndarray) -> float:
    return MU * (abs(x[3]) + 2.0 * abs(x[4]) / L)


def slip(t: float, y: np.ndarray, side: float) -> np.ndarray:
    """The solution of f1 = -side mu FN(f1)."""
    f1 = brentq(lambda f: f + side * limit(solve(t, y, f)), -200.0, 200.0, xtol=1e-13, rtol=1e-14)
    return solve(t, y, f1)


def reference(end: float) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """q, l, q', l' at ``end``, and the times at which slip ends (side 0) or begins."""
    t, y, side, events = 0.0, np.array(START), 1.0, []
    while t < end:

        def rates(t, y, side=side):
            x = slip(t, y, side) if side else solve(t, y, None)
            return [y[2], y[3] if side else 0.0, x[0], x[1] if side else 0.0]

        def event(t, y, side=side):
            x = None if side else solve(t, y, None)
            return y[3] if x is None else limit(x) - abs(x[2])

        event.terminal, event.direction = True, -side or -1.0  # type: ignore[attr-defined]
        run = solve_ivp(
            rates, (t, end), y, method="DOP853", rtol=1e-11, atol=1e-13, events=event, max_step=0.01
        )
        t, y = run.t[-1], run.y[:, -1].copy()
        if run.status != 1:
            break
        y[3] = 0.0
        x = solve(t, y, None)
        side = 0.0 if side and abs(x[2]) <= limit(x) else -np.sign(x[2])
        y[3] = 1e-12 * side
        events.append((t, side))
    return y, events
