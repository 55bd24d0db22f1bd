"""Parameters of a shaft in several bearings: connectors that share a body."""

from typing import Any

MASS, RADIUS, OVERLAP = 2.0, 0.02, 0.05


def parameters(places, com=0.0, twist=(0.0,) * 6, **changes):
    """A shaft in bearings at ``places`` along it, m."""
    names = [f"at{k}" for k in range(len(places))]
    found: dict[str, Any] = {
        "connectors": names,
        "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
        "body_b": {
            "frame": "shaft",
            "mass": MASS,
            "com": [com, 0.0, 0.0],
            "inertia": [0.001, 0.0, 0.0, 0.05, 0.0, 0.05],
        },
        "friction": {"coefficient": 0.2, "radius": RADIUS, "overlap": OVERLAP},
        "plant": {"body_b": {"twist": list(twist)}},
    }
    for name, x in zip(names, places, strict=True):
        found[name] = {
            "body_a": {"pose": [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]},
            "node_b": {"position": [x, 0.0, 0.0]},
        }
    for key, value in changes.items():
        found[key] = {**found.get(key, {}), **value} if isinstance(value, dict) else value
    return found
