"""Random scenes over extreme scales, with every extreme drawn jointly with the others.

Each scene has its own generator, seeded by (seed, number), so it is reproducible alone. Families
raise the share of rare regimes and do not restrict the range of the other quantities.

One range is restricted: an arm from a mass centre to the connector is at most LONGEST_ARM least
radii of gyration k. The effective inertia there is the sum of 1/m and r^2/I, so 2 log10(r/k) of the
sixteen digits are lost: half of them at LONGEST_ARM. Longer arms leave no meaningful digits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws import rigid
from cylconn_ros.laws.random import Random, decades, direction, generator, orientation, soften
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
LONGEST_ARM = 1e4
LEAST_CHANGING_OVERLAP = 1e-4  # m: that of a shorter one is less than the rounding of positions
SAMPLED = -0.9  # decades over m/h^2 and m/h of each element whose force is that of the sample
FAMILIES = ("wide", "sliding", "roots", "wide", "roots", "sliding", "jam", "roots", "turning")
KINDS = (
    ("free", "free"),
    ("fixed", "free"),
    ("free", "fixed"),
    ("driven", "free"),
    ("free", "driven"),
)


def family(number: int) -> str:
    """The family of scene ``number``."""
    return FAMILIES[number % len(FAMILIES)]


def scene(seed: int, number: int, method: str = "impulse") -> Scene:
    """The scene ``number`` for a seed."""
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
        "latency": 0,  # random samples do not follow from the wrenches: no latency to measure
        "gravity": _list(rng.choice([0.0, 1.0, 1.0]) * 9.81 * direction(rng, 1)[0]),
        "body_a": _body(rng, kind_a, mass * ratio_mass, inertia * ratio_inertia),
        "body_b": _body(rng, kind_b, mass, inertia),
        "node_a": {"position": _node_position(rng), "orientation": _list(orientation(rng, 1)[0])},
        "node_b": {"position": _node_position(rng)},
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
    soften(values)
    more = generator(seed, number, 1)
    if more.random() < 0.5:
        values["node_b"]["orientation"] = _list(orientation(more, 1)[0])
    reach = _within_reach(values)
    if TRAITS[method].uses_gains:
        values["penalty"] = _gains(more, mass, inertia, period)
    if not TRAITS[method].has_limits:
        values["command"] = {name: _force(more, weight) for name in ("slide", "spin")}
    elif more.random() < (0.25 if kind == "roots" else 0.5):
        _bound(more, values, weight, reach)
    if values["friction"].get("overlap", 0.0) > LEAST_CHANGING_OVERLAP:
        values["friction"] |= _overlap(generator(seed, number, 2), values["friction"]["overlap"])
    _details(generator(seed, number, 3), values, weight)
    most = SAMPLED if TRAITS[method].samples_elements else 0.5
    _elements(generator(seed, number, 4), values, mass, inertia, most)
    return Scene.from_parameters(values)


def _elements(
    rng: Random, values: dict[str, Any], mass: float, inertia: float, most: float
) -> None:
    """Tables of springs and dampers in a quarter of the scenes; some of the stops are compliant.

    ``most``: decades of the greatest stiffness and damping over m/h^2 and m/h.
    """
    h = values["period"]
    limits, free = values.get("stops", {}), [values[b] for b in ("body_a", "body_b")]
    free = [body for body in free if body["kind"] == "free"]
    least = min(body["mass"] for body in free)
    for k, (points, forces, name, moved) in enumerate((
        ("positions", "forces", "table", min(mass, least)),
        ("angles", "moments", "rotational_table", min(inertia, *map(_least, free))),
    )):  # fmt: skip
        stiff, damp = moved / h**2, moved / h
        if rng.random() < 0.12:
            x = np.cumsum(decades(rng, -6.0, 0.0, int(rng.integers(2, 7))))
            x -= x[int(rng.integers(len(x)))]
            slopes = stiff * decades(rng, -6.0, most, len(x) - 1) * rng.choice([0.0, 1.0, 1.0])
            y = np.concatenate([[0.0], np.cumsum(slopes * np.diff(x))])
            y += y[-1] * rng.choice([0.0, 0.0, -0.5, 1.0])
            values.setdefault("elasticity", {})[name] = {
                points: _list(x), forces: _list(y), "extrapolation": _beyond(rng),
            }  # fmt: skip
        if rng.random() < 0.12:
            x = np.cumsum(decades(rng, -3.0, 1.0, int(rng.integers(2, 7))))
            x -= x[int(rng.integers(len(x)))]
            y = np.concatenate([
                [0.0], np.cumsum(damp * decades(rng, -5.0, most, len(x) - 1) * np.diff(x))
            ])  # fmt: skip
            y -= y[int(np.argmin(np.abs(x)))]
            values.setdefault("damping", {})[name] = {
                "rates": _list(x), forces: _list(y), "extrapolation": _beyond(rng),
            }  # fmt: skip
        component = ("slide", "spin")[k]
        moves = values.get("command", {}).get(component, {}).keys() & {"position", "velocity"}
        held = moves or values.get("lock", {}).get("component") == component
        soft = rng.random() < 0.4 and not held  # else the sizes of both forces are not known
        if soft and any(end.startswith(("l_", "theta_")[k]) for end in limits):
            prefix = ("", "rotational_")[k]
            limits[f"{prefix}stiffness"] = float(stiff * decades(rng, -6.0, most))
            if rng.random() < 0.7:
                limits[f"{prefix}damping"] = float(damp * decades(rng, -5.0, most))
                limits[f"{prefix}damping_depth"] = float(decades(rng, -6.0, 0.0))
    ends = [end for end in ("l_min", "l_max") if "stiffness" not in limits]
    ends += [end for end in ("theta_min", "theta_max") if "rotational_stiffness" not in limits]
    if not any(end in limits for end in ends):
        limits.pop("restitution", None)


def _beyond(rng: Random) -> str:
    """How a table goes on beyond its ends."""
    return str(rng.choice(["constant", "linear"]))


def _least(body: dict[str, Any]) -> float:
    """Least moment of inertia of a body."""
    return least_moment(body["inertia"])


def _within_reach(values: dict[str, Any]) -> float:
    """Limit node positions, mass centres and gravity; returns the largest slide, m.

    Half of the longest arm is for the node from its mass centre and half for the slide.
    """
    reach, fall = math.inf, math.inf
    for body, node in (("body_a", "node_a"), ("body_b", "node_b")):
        given = values[body]
        if given["kind"] != "free":
            continue
        k = math.sqrt(least_moment(given["inertia"]) / given["mass"])
        arm = float(np.linalg.norm(np.subtract(values[node]["position"], given["com"])))
        share = min(1.0, 0.5 * LONGEST_ARM * k / arm) if arm > 0.0 else 1.0
        given["com"] = [share * x for x in given["com"]]
        values[node]["position"] = [share * x for x in values[node]["position"]]
        fall = min(fall, 0.05 * LONGEST_ARM * k)
        if body == "body_a":
            reach = 0.5 * LONGEST_ARM * k
    fallen = (
        values["period"] ** 2 * 9.81 / 6.0
    )  # displacement of a mass centre's mean position by gravity
    values["gravity"] = [min(1.0, fall / fallen) * x for x in values["gravity"]]
    return reach


def least_moment(elements: list[float]) -> float:
    """Least principal moment of an inertia tensor, from its six elements."""
    xx, xy, xz, yy, yz, zz = elements
    return float(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0])


def _gains(rng: Random, mass: float, inertia: float, period: float) -> dict[str, float]:
    """Stiffness and damping; some are unstable in a closed loop."""
    soft = decades(rng, -4.0, 0.0)
    return {
        "stiffness": float(soft * mass / period**2),
        "damping": float(soft * mass / period),
        "rotational_stiffness": float(soft * inertia / period**2),
        "rotational_damping": float(soft * inertia / period),
    }


def _bound(rng: Random, values: dict[str, Any], weight: float, reach: float) -> None:
    """Add stops, a lock, an imposed motion or force at random, alone or together."""
    stops: dict[str, float] = {}
    given = "orientation" in values["node_b"]  # otherwise the angle starts at 0
    middle = float(rng.uniform(-3.0, 3.0)) if given else 0.0
    for name, chance, at in (
        ("l", 0.7, min(reach, 10.0) * rng.uniform(-1.0, 1.0) * decades(rng, -3.0, -0.5)),
        ("theta", 0.5, middle + (0.0 if given else rng.normal() * decades(rng, -6.0, 0.5))),
    ):
        if rng.random() > chance:
            continue
        distance = float(decades(rng, -7.0, 0.5)) * (min(reach, 1.0) if name == "l" else 1.0)
        which = rng.integers(3)  # lower, upper, both
        if which != 1:
            stops[f"{name}_min"] = float(at)
        if which != 0:
            stops[f"{name}_max"] = float(at) + distance
    if stops and rng.random() < 0.8:
        some = (0.0, 1.0, float(rng.random()), float(rng.random()), float(decades(rng, -6.0, 0.0)))
        stops["restitution"] = some[rng.integers(len(some))]
    values["stops"] = stops
    if rng.random() < 0.15:
        lock: dict[str, Any] = {"component": str(rng.choice(["slide", "spin"]))}
        if rng.random() < 0.6:
            position = float(rng.normal() * decades(rng, -3.0, 0.0) * min(reach, 1.0))
            lock["position"] = _within(stops, lock["component"], position)
        if rng.random() < 0.5 or "position" not in lock:
            lock["force"] = float(weight * decades(rng, -3.0, 2.0))
        values["lock"] = lock
    command: dict[str, Any] = {}
    for name in ("slide", "spin"):
        if rng.random() < 0.12:
            command[name] = _force(rng, weight)
        elif rng.random() < 0.12:
            command[name] = _motion(rng, min(reach, 1.0) if name == "slide" else 1.0)
            if "position" in command[name]:
                command[name]["position"] = _within(stops, name, command[name]["position"])
    for motion in command.values():
        brakes = "position" not in motion or "penalty" not in values
        if "force" not in motion and brakes and rng.random() < 0.5:
            motion["max_force"] = float(weight * decades(rng, -3.0, 3.0))
    values["command"] = command
    if "reference" in values:  # a constitutive reference has to be within the stops
        values["reference"].pop("length", None)
        values["reference"].pop("angle", None)


def _within(stops: dict[str, float], component: str, position: float) -> float:
    """A position within the stops of slide or spin."""
    name = "l" if component == "slide" else "theta"
    low, high = stops.get(f"{name}_min", -math.inf), stops.get(f"{name}_max", math.inf)
    return min(max(position, low), high)


def _force(rng: Random, weight: float) -> dict[str, float]:
    """An imposed force."""
    return {"force": float(rng.normal() * weight * decades(rng, -3.0, 3.0))}


def _motion(rng: Random, reach: float) -> dict[str, float]:
    """An imposed motion."""
    motion: dict[str, float] = {}
    which = rng.integers(3)  # position, velocity, or both
    if which != 1:
        motion["position"] = float(rng.normal() * decades(rng, -4.0, 0.0) * reach)
    if which != 0:
        motion["velocity"] = float(rng.normal() * decades(rng, -4.0, 1.0) * reach)
    return motion


def _bind(rng: Random, values: dict[str, Any]) -> None:
    """Set mass centre and overlap of B so that friction can bind: coupling c of about 1."""
    body, friction = values["body_b"], values["friction"]
    node = np.array(values["node_b"]["position"])
    arm = direction(rng, 1)[0] * decades(rng, -3.0, 0.5)
    body["com"] = _list(node + arm)
    mu = friction.get("coefficient", 1.0)
    coupling = decades(rng, -0.3, 2.0)
    friction["overlap"] = float(2.0 * mu * np.linalg.norm(arm) / coupling)


def _list(values: Array) -> list[float]:
    return [float(x) for x in values]


def _node_position(rng: Random) -> list[float]:
    return _list(direction(rng, 1)[0] * decades(rng, -3.0, 0.5) * rng.choice([0.0, 1.0, 1.0]))


def _body(rng: Random, kind: str, mass: float, inertia: float) -> dict[str, Any]:
    """Parameters of a body."""
    pose = [*_list(rng.normal(size=3)), *_list(orientation(rng, 1)[0])]
    if kind != "free":
        return {"kind": kind, "pose": pose}
    # squared radii along the principal axes: their pairwise sums are valid principal moments
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
    """Parameters of friction; empty: none. kind: family of the scene."""
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


def _details(rng: Random, values: dict[str, Any], weight: float) -> None:
    """Friction by direction, an offset force, and parts of FN left out, in a few scenes each."""
    friction = values["friction"]
    if not friction:
        return
    if rng.random() < 0.2 and "coefficient" in friction:
        difference = float(rng.choice([-1.0, 1.0]) * rng.choice([rng.random(), 1.0], p=[0.9, 0.1]))
        mean = friction.pop("coefficient")
        friction["coefficient_forward"] = mean * (1.0 + difference)
        friction["coefficient_backward"] = mean * (1.0 - difference)
        if "static_coefficient" in friction:  # the sum rounds
            friction["static_coefficient"] *= 1.0 + 1e-12
    if rng.random() < 0.1:
        friction["offset_force"] = float(rng.normal() * weight * decades(rng, -2.0, 1.0))
    if rng.random() < 0.1:
        inputs = rng.permutation(["radial", "bending", "preload"])
        inputs = inputs[: int(rng.integers(1, 3))].tolist()
        presses = {"radial": True, "bending": friction["overlap"], "preload": friction["preload"]}
        if any(presses[each] for each in inputs):  # else there is no friction
            friction["inputs"] = inputs


def _overlap(rng: Random, overlap: float) -> dict[str, Any]:
    """A fifth of the overlaps change, and the middle of a contact in four moves."""
    values: dict[str, Any] = {}
    if rng.random() < 0.25:
        values["contact_centre"] = str(rng.choice(["body_a", "between", "body_b"]))
    if rng.random() < 0.2:
        values |= {
            "overlap_change": str(rng.choice(["increasing", "decreasing"])),
            "overlap_min": overlap * float(decades(rng, -2.0, 0.0)),
            "overlap_max": overlap * float(decades(rng, 0.0, 2.0)),
        }
    if values and rng.random() < 0.5:
        values["overlap_at"] = overlap * float(rng.normal())
    return values


def _table(rng: Random, mu: float, weight: float) -> dict[str, list[float]]:
    """A table of the friction coefficient."""
    rows, columns = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    rates = np.cumsum(decades(rng, -2.0, 1.0, rows))
    forces = weight * np.cumsum(decades(rng, -2.0, 2.0, columns))
    values = mu * rng.uniform(0.5, 1.5, rows * columns)
    return {"rates": _list(rates), "forces": _list(forces), "values": _list(values)}
