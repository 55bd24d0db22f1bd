"""Closed-form solutions, derived from Coulomb friction on one friction disc; SI units."""

import math


def coast(mu: float, gravity: float, preload: float, mass: float, v0: float) -> tuple[float, float]:
    """Stop time (s) and distance (m) of a sleeve with its mass centre on the axis, at node b.

    The normal force is |m g + FCint| at all times, with gravity g across the axis:
    a = mu |g + FCint/m|.
    """
    a = mu * abs(gravity + preload / mass)
    return v0 / a, 0.5 * v0 * v0 / a


def constant_normal_force(c: float, v0: float, tau: float) -> tuple[float, float]:
    """Stop time (s) and distance (m) of slide and spin together, for k = m R^2/I = 2.

    With a constant normal force the slip velocity s = (v, R w) obeys R w / R w0 = (v/v0)^k, and for
    k = 2, c = R w0/v0, tau = m v0/(mu FN):

        T = tau/2 (sqrt(1 + c^2) + asinh(c)/c),     X = tau v0 ((1 + c^2)^1.5 - 1) / (3 c^2)
    """
    root = math.sqrt(1.0 + c * c)
    return 0.5 * tau * (root + math.asinh(c) / c), tau * v0 * (root**3 - 1.0) / (3.0 * c * c)


def constant_normal_force_turn(c: float, v0: float, tau: float) -> float:
    """R times the angle (m) until slide and spin come to rest together, as above.

    R alpha = c v0 tau Int_0^1 p^2 sqrt(1 + c^2 p^2) dp, p = v/v0.
    """
    root = math.sqrt(1.0 + c * c)
    integral = (1.0 + 2.0 * c * c) * root / (8.0 * c * c) - math.asinh(c) / (8.0 * c**3)
    return c * v0 * tau * integral


def bouncing(gap: float, v0: float, restitution: float, time: float) -> tuple[float, float]:
    """Position (m) from the first stop and velocity (m/s) between two stops ``gap`` apart.

    The motion starts at the first stop with v0 towards the other. The n-th crossing (n from 0)
    takes gap/(v0 restitution^n).
    """
    crossing, speed, left = 0, v0, time
    while left > gap / speed:
        left -= gap / speed
        crossing, speed = crossing + 1, speed * restitution
    if crossing % 2 == 0:
        return speed * left, speed
    return gap - speed * left, -speed


def dry_oscillator(k: float, mass: float, force: float, x0: float) -> tuple[float, float]:
    """Time (s) and position (m) of rest of a mass on a spring k with constant friction ``force``.

    Each half cycle lasts pi sqrt(m/k) and reduces the amplitude by 2 force/k. The mass rests at
    the first turning point with |k x| <= force.
    """
    shrink, amplitude, half_cycles = 2.0 * force / k, abs(x0), 0
    while k * amplitude > force:
        amplitude -= shrink
        half_cycles += 1
    side = math.copysign(1.0, x0) * (-1.0) ** half_cycles
    return half_cycles * math.pi * math.sqrt(mass / k), side * amplitude


def damped_oscillator(
    k: float, c: float, mass: float, push: float, time: float
) -> tuple[float, float]:
    """Displacement (m) and velocity (m/s) under a constant ``push`` (N), from rest at u = 0.

    m u'' = push - k u - c u', less than critically damped.
    """
    decay = 0.5 * c / mass
    w = math.sqrt(k / mass - decay * decay)
    sag, shrunk = push / k, math.exp(-decay * time)
    swing = math.cos(w * time) + decay / w * math.sin(w * time)
    return sag * (1.0 - shrunk * swing), sag * shrunk * (w + decay * decay / w) * math.sin(w * time)


def own_centrifugal_load(
    mu: float, radius: float, mass: float, offset: float, inertia: float, w0: float, time: float
) -> tuple[float, float]:
    """Angle (rad) and spin (rad/s) of a rotor braked by friction of its own centrifugal load.

    The mass centre is at ``offset`` from the shaft: FN = m r sqrt(w^4 + a^2), and with
    gamma = mu R m r/(I + m r^2) the moment mu R FN gives a = -q w^2, q = gamma/sqrt(1 - gamma^2):

        w = w0/(1 + q w0 t),     angle = ln(1 + q w0 t)/q
    """
    gamma = mu * radius * mass * offset / (inertia + mass * offset * offset)
    q = gamma / math.sqrt(1.0 - gamma * gamma)
    grown = 1.0 + q * w0 * time
    return math.log(grown) / q, w0 / grown


def near_jam(
    mu: float, arm: float, overlap: float, gravity: float, v0: float
) -> tuple[float, float]:
    """Stop time (s) and distance (m) with the mass centre ``arm`` below the shaft.

    Friction at the shaft loads the sleeve in bending: FN = m g + (2/L) arm mu FN, so that
    a = mu g/(1 - c), c = 2 mu arm/L < 1.
    """
    a = mu * gravity / (1.0 - 2.0 * mu * arm / overlap)
    return v0 / a, 0.5 * v0 * v0 / a


def decaying_coefficient(
    kinetic: float, static: float, decay: float, gravity: float, v0: float
) -> float:
    """Stop time (s) of a coast with mu = mu_k + (mu_s - mu_k) exp(-dc |s|).

    Separation of variables: T = ln((mu_k exp(dc v0) + mu_s - mu_k)/mu_s) / (g mu_k dc).
    """
    rise = static - kinetic
    return math.log((kinetic * math.exp(decay * v0) + rise) / static) / (gravity * kinetic * decay)


def linear_coefficient(
    at_rest: float, slope: float, gravity: float, v0: float
) -> tuple[float, float]:
    """Stop time (s) and distance (m) of a coast with mu = mu0 + b |s|: v' = -g (mu0 + b v)."""
    time = math.log(1.0 + slope * v0 / at_rest) / (gravity * slope)
    return time, v0 / (gravity * slope) - at_rest / slope * time


def telescope(mu: float, arm: float, overlap: float, gravity: float, v0: float) -> float:
    """Distance (m) that a tube thrown outwards slides, its mass centre ``arm`` below the axis.

    As :func:`near_jam` with an overlap L0 - u: v^2/2 = v0^2/2 - mu g [u + Lj ln((L0 - Lj)/(L0 - u -
    Lj))], Lj = 2 mu arm. It stops before the overlap Lj, at which it jams; found by bisection.
    """
    jam = 2.0 * mu * arm
    low, high = 0.0, overlap - jam
    for _ in range(200):
        u = 0.5 * (low + high)
        work = mu * gravity * (u + jam * math.log((overlap - jam) / (overlap - jam - u)))
        low, high = (u, high) if work < 0.5 * v0 * v0 else (low, u)
    return 0.5 * (low + high)


def piston_rod(
    mu: float, overlap: float, mass: float, gravity: float, pull: float, start: float
) -> tuple[float, float]:
    """Stop time (s) and distance (m) of a rod pulled from its gland, whose middle is at slide 0.

    The weight at the rod's end bends it at the gland: m l'' = F - mu m g (1 + 2 l/L), a harmonic
    motion about l_e = (F/(mu m g) - 1) L/2 with the square of its rate 2 mu g/L.
    """
    middle = 0.5 * overlap * (pull / (mu * mass * gravity) - 1.0)
    return math.pi / math.sqrt(2.0 * mu * gravity / overlap), 2.0 * (middle - start)
