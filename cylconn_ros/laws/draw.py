"""Random scenes and states over extreme scales, every extreme drawn jointly with the others.

A scene is drawn from its own generator, seeded by (seed, number): any one of them can be made
again alone. Families steer the draw where a regime would otherwise be rare: nothing is taken away
from the range of the other quantities.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.scene import Scene
from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.parameters import Bools, Parameters

Array = NDArray[np.float64]
Random = np.random.Generator
Names = NDArray[np.str_]
FAMILIES = ("wide", "sliding", "roots", "wide", "sliding", "jam", "roots", "turning")
KINDS = (
    ("free", "free"),
    ("fixed", "free"),
    ("free", "fixed"),
    ("driven", "free"),
    ("free", "driven"),
)


def generator(seed: int, number: int) -> Random:
    """The generator of scene ``number``."""
    return np.random.default_rng([seed, number])


def family(number: int) -> str:
    """The family of scene ``number``."""
    return FAMILIES[number % len(FAMILIES)]


def decades(rng: Random, low: float, high: float, size: int | None = None) -> Any:
    """10 to a power uniform between ``low`` and ``high``."""
    return 10.0 ** rng.uniform(low, high, size)


def direction(rng: Random, n: int) -> Array:
    """(n, 3) unit vectors, uniform."""
    v = rng.normal(size=(n, 3))
    return v / rigid.norm(v)[:, None]


def orientation(rng: Random, n: int) -> Array:
    """(n, 4) quaternions, uniform."""
    return rigid.normalised(rng.normal(size=(n, 4)))


def scene(seed: int, number: int, method: str = "impulse") -> Scene:
    """The scene ``number`` of the draw ``seed``."""
    rng = generator(seed, number)
    kind = family(number)
    mass = decades(rng, -2.0, 2.0)
    arm = decades(rng, -2.5, 0.0)  # m, of the inertia
    inertia = mass * arm * arm
    ratio_mass, ratio_inertia = decades(rng, -6.0, 6.0, 2)
    period = float(decades(rng, -4.0, -1.0))
    shares = [0.2, 0.4, 0.0, 0.4, 0.0] if kind == "roots" else [0.5, 0.15, 0.1, 0.15, 0.1]
    kind_a, kind_b = KINDS[int(rng.choice(len(KINDS), p=shares))]
    weight = mass * 9.81
    values: dict[str, Any] = {
        "method": method,
        "period": period,
        "gravity": _list(rng.choice([0.0, 1.0, 1.0]) * 9.81 * direction(rng, 1)[0]),
        "body_a": _body(rng, kind_a, mass * ratio_mass, inertia * ratio_inertia),
        "body_b": _body(rng, kind_b, mass, inertia),
        "node_a": {"position": _far(rng), "orientation": _list(orientation(rng, 1)[0])},
        "node_b": {"position": _far(rng)},
        "reference": _reference(rng),
        "friction": _friction(rng, kind, weight, arm),
        "wrench": {
            "axes": str(rng.choice(["body", "world"])),
            "point": str(rng.choice(["origin", "com"])),
            "hold": str(rng.choice(["world", "world", "body"])),
        },
        "plant_integration": str(rng.choice(["exact", "exact", "exact", "semi_implicit"])),
    }
    if kind == "roots":
        _bind(rng, values)
    if rng.random() < 0.3:
        values["elasticity"] = {
            "k1": mass / period**2 * decades(rng, -6.0, 1.0),
            "kr1": inertia / period**2 * decades(rng, -6.0, 1.0),
        }
    if rng.random() < 0.3:
        values["damping"] = {
            "c1": mass / period * decades(rng, -5.0, 1.0),
            "cr1": inertia / period * decades(rng, -5.0, 1.0),
        }
    if rng.random() < 0.1:
        values["limits"] = {"force": weight * decades(rng, -2.0, 3.0)}
        if rng.random() < 0.5:
            values["limits"]["torque"] = weight * arm * decades(rng, -2.0, 3.0)
    return Scene.from_parameters(values)


def _bind(rng: Random, values: dict[str, Any]) -> None:
    """Choose the mass centre off node b and the overlap so that friction may bind: c about 1."""
    body, friction = values["body_b"], values["friction"]
    node = np.array(values["node_b"]["position"])
    arm = direction(rng, 1)[0] * decades(rng, -3.0, 0.5)
    body["com"] = _list(node + arm)
    mu = friction.get("coefficient", 1.0)
    coupling = decades(rng, -0.3, 2.0)
    friction["overlap"] = float(2.0 * mu * np.linalg.norm(arm) / coupling)


def _list(values: Array) -> list[float]:
    return [float(x) for x in values]


def _far(rng: Random) -> list[float]:
    return _list(direction(rng, 1)[0] * decades(rng, -3.0, 0.5) * rng.choice([0.0, 1.0, 1.0]))


def _body(rng: Random, kind: str, mass: float, inertia: float) -> dict[str, Any]:
    pose = [*_list(rng.normal(size=3)), *_list(orientation(rng, 1)[0])]
    if kind != "free":
        return {"kind": kind, "pose": pose}
    # squared radii along the principal axes: their pairwise sums are moments that a body can have
    spread = decades(rng, -3.0, 0.0, 3) if rng.random() < 0.3 else decades(rng, -0.7, 0.0, 3)
    moments = inertia * (spread.sum() - spread) / (spread.sum())
    axes = rigid.matrix(orientation(rng, 1))[0]
    tensor = axes @ np.diag(moments) @ axes.T
    elements = [float(tensor[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    com = direction(rng, 1)[0] * decades(rng, -3.0, 1.0) * rng.choice([0.0, 1.0, 1.0])
    return {"kind": kind, "pose": pose, "mass": mass, "com": _list(com), "inertia": elements}


def _reference(rng: Random) -> dict[str, Any]:
    values: dict[str, Any] = {
        "offsets": str(rng.choice(["hold", "zero"])),
        "misalignment": str(rng.choice(["hold", "zero"])),
        "pull_in_speed": float(decades(rng, -3.0, 2.0)),
        "pull_in_rate": float(decades(rng, -3.0, 2.0)),
    }
    if rng.random() < 0.3:
        values["length"], values["angle"] = _list(rng.normal(size=2))
    return values


def _friction(rng: Random, kind: str, weight: float, arm: float) -> dict[str, Any]:
    if kind == "wide" and rng.random() < 0.15:
        return {}
    high = {"sliding": -0.3, "turning": 0.0}.get(kind, 1.0)
    mu = float(decades(rng, -2.5, high))
    low = {"jam": -6.0, "roots": -3.0, "wide": -6.0}.get(kind, -1.0)
    overlap = float(decades(rng, low, 0.5))
    values: dict[str, Any] = {
        "coefficient": mu,
        "radius": float(decades(rng, -6.0 if rng.random() < 0.3 else -2.5, 0.0)),
        "overlap": 0.0 if rng.random() < 0.2 and kind != "roots" else overlap,
        "preload": float(rng.choice([0.0, 1.0, 1.0, -1.0]) * weight * decades(rng, -3.0, 3.0)),
    }
    variable = rng.random()
    if variable < 0.2:
        values["static_coefficient"] = mu * (1.0 + rng.random())
        values["decay"] = float(decades(rng, -2.0, 2.0))
    elif variable < 0.3:
        del values["coefficient"]
        values["table"] = _table(rng, mu, weight)
    if rng.random() < 0.2:
        values["max_force"] = float(weight * decades(rng, -2.0, 3.0))
    return values


def _table(rng: Random, mu: float, weight: float) -> dict[str, list[float]]:
    rows, columns = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    rates = np.cumsum(decades(rng, -2.0, 1.0, rows))
    forces = weight * np.cumsum(decades(rng, -2.0, 2.0, columns))
    values = mu * rng.uniform(0.5, 1.5, rows * columns)
    return {"rates": _list(rates), "forces": _list(forces), "values": _list(values)}


def states(rng: Random, p: Parameters, family_of: Names, fixed: tuple[Bools, Bools]) -> Array:
    """(n, NSAMPLE) random samples without loads, one for each row of ``p``.

    B stands where the connector lets it, but for a violation, and moves as it may, but for another.

    Args:
        family_of: (n,) names of families. fixed: whether A, whether B stands still.
    """
    n = len(p.h)
    sample = np.zeros((n, layout.NSAMPLE))
    calm = (family_of == "roots") & (rng.random(n) < 0.8)
    qa, at_a = orientation(rng, n), rng.normal(size=(n, 3))
    q_node = rigid.multiply(qa, p.axes_a)
    axes = rigid.matrix(q_node)
    wrong = np.where(calm[:, None], 0.0, 1.0)
    tilt = wrong * _sometimes(rng, n) * direction(rng, n) * decades(rng, -12.0, 0.0, n)[:, None]
    turn = rigid.multiply(
        rigid.exp(tilt * np.array([0.0, 1.0, 1.0])),
        rigid.exp(rng.uniform(-math.pi, math.pi, n)[:, None] * np.array([1.0, 0.0, 0.0])),
    )
    given = np.where(np.isnan(p.axes_b[:, :1]), orientation(rng, n), p.axes_b)
    qb = rigid.normalised(rigid.multiply(rigid.multiply(q_node, turn), rigid.conjugate(given)))
    offset = wrong * _sometimes(rng, n) * direction(rng, n) * decades(rng, -12.0, -0.5, n)[:, None]
    offset[:, 0] = rng.normal(size=n) * decades(rng, -2.0, 0.5, n)
    arm_a = rigid.out_of(rigid.matrix(qa), p.a.com + p.a.node) + rigid.out_of(axes, offset)
    arm_b = rigid.out_of(rigid.matrix(qb), p.b.com + p.b.node)

    v, w = _rates(rng, n, calm)
    still = (rng.random(n) < np.where(family_of == "wide", 0.2, 0.5)) | calm
    spin_a = direction(rng, n) * np.where(still, 0.0, decades(rng, -3.0, 3.0, n))[:, None]
    speed_a = direction(rng, n) * decades(rng, -3.0, 1.5, n)[:, None]
    spin_b = spin_a + rigid.out_of(axes, w)
    speed_b = speed_a + np.cross(spin_a, arm_a) + rigid.out_of(axes, v) - np.cross(spin_b, arm_b)
    at_b = at_a + arm_a - arm_b
    # seen from a body that stands still
    apart = at_b - at_a
    from_a, from_b = fixed[0][:, None], fixed[1][:, None]
    speed_b = np.where(from_a, speed_b - speed_a - np.cross(spin_a, apart), speed_b)
    speed_a = np.where(from_b, speed_a - speed_b + np.cross(spin_b, apart), speed_a)
    spin_a, spin_b = (
        np.where(from_b, spin_a - spin_b, spin_a),
        np.where(from_a, spin_b - spin_a, spin_b),
    )
    put(sample, layout.A_POSE, at_a, qa, np.where(from_a, 0.0, speed_a), spin_a * ~from_a)
    put(sample, layout.B_POSE, at_b, qb, np.where(from_b, 0.0, speed_b), spin_b * ~from_b)
    return sample


def put(sample: Array, at: int, position: Array, q: Array, speed: Array, spin: Array) -> None:
    """Write pose and twist of one body into (n, NSAMPLE)."""
    sample[:, at : at + 13] = np.concatenate([position, q, speed, spin], axis=1)


def _sometimes(rng: Random, n: int) -> Array:
    return rng.choice([0.0, 1.0], n)[:, None]


def _rates(rng: Random, n: int, calm: Bools) -> tuple[Array, Array]:
    """(n, 3) v and w of b against a: slide and spin at will, the others mostly small."""
    wrong = rng.choice([0.0, 1.0, 1.0], n)[:, None] * decades(rng, -9.0, 0.0, n)[:, None]
    wrong = np.where(calm[:, None], 1e-3 * wrong, wrong)
    v, w = wrong * rng.normal(size=(n, 3)), wrong * rng.normal(size=(n, 3))
    v[:, 0] = rng.normal(size=n) * decades(rng, -4.0, 2.0, n)
    w[:, 0] = rng.normal(size=n) * decades(rng, -3.0, 2.8, n) * np.where(calm, 1e-2, 1.0)
    quiet = rng.random((2, n)) < np.where(calm, 0.0, 0.15)
    v[quiet[0], 0] = 0.0
    w[quiet[1], 0] = 0.0
    return v, w


def load(rng: Random, p: Parameters, sample: Array, family_of: Names) -> None:
    """Draw the loads of (n, NSAMPLE) samples anew, in place.

    In the family ``roots`` the load bends B against the arm of friction about its mass centre:
    bending then first falls and later grows with friction, which is what gives several solutions.
    """
    n = len(sample)
    for at, body in ((layout.A_LOAD, p.a), (layout.B_LOAD, p.b)):
        mass = np.where(body.free, 1.0 / np.where(body.free, body.inverse_mass, 1.0), 0.0)
        force = 9.81 * mass * decades(rng, -3.0, 3.0, n)
        moment = force * decades(rng, -3.0, 0.5, n)
        sample[:, at : at + 3] = direction(rng, n) * (force * rng.choice([0, 1], n))[:, None]
        sample[:, at + 3 : at + 6] = direction(rng, n) * (moment * rng.choice([0, 1], n))[:, None]
    rows = np.flatnonzero((family_of == "roots") & p.b.free & (rng.random(n) < 0.8))
    if not len(rows):
        return
    q, sub = p.take(rows), sample[rows]
    a, b = (
        rigid.matrix(rigid.multiply(rigid.normalised(sub[:, 3:7]), q.axes_a)),
        rigid.matrix(rigid.normalised(sub[:, 16:20])),
    )
    arm, com = rigid.out_of(b, q.b.node), rigid.out_of(b, q.b.com)
    slide = rigid.dot(a[:, :, 0], sub[:, 20:23] - sub[:, 7:10])
    axis = np.cross(arm, a[:, :, 0])
    weight = 9.81 / q.b.inverse_mass
    force = direction(rng, len(rows)) * (weight * decades(rng, -3.0, 1.0, len(rows)))[:, None]
    moment = (
        axis
        * (
            np.sign(slide)
            * np.maximum(q.kinetic, 0.01)
            * (weight + np.abs(q.preload))
            * decades(rng, -0.5, 2.5, len(rows))
        )[:, None]
    )
    sample[rows, layout.A_LOAD : layout.B_LOAD] = 0.0
    sample[rows, layout.B_LOAD : layout.B_LOAD + 3] = force
    sample[rows, layout.B_LOAD + 3 : layout.NSAMPLE] = moment + np.cross(com, force)
