"""Constraints in directions in which no joint of the model yields: their forces are bounded.

MuJoCo regularises a constraint by R = (1 - d)/d A, in which A is the mean inverse mass of its two
bodies at qpos0 (mjModel.body_invweight0). A body that only turns about its mass centre has A = 0
for translations: R falls to 1e-15, and a contact that the joint cannot yield to has a force of
depth times stiffness over R, some 1e17 N. The force is not determined by the model, as that of any
rigid body which is clamped twice; its size follows from the regularisation alone.

With A of the free body in place of (nearly) zero the contact is as stiff as on the free body.
"""

from __future__ import annotations

from typing import Any

import numpy as np

_YIELDS = 1e-3  # A over that of the free body, below which no joint yields


def bound_unyielding(model: Any) -> list[str]:
    """Give bodies that no joint moves (or turns) the inverse mass of a free body.

    Only constraints on these bodies change: their stiffness, not the motion that they hinder.
    ``model``: mjModel, changed in place. Returns the names of the bodies. Bodies fixed to the world
    are left as they are.
    """
    found = []
    for body in range(1, model.nbody):
        if int(model.body_weldid[body]) == 0:
            continue
        members = np.flatnonzero(np.asarray(model.body_weldid) == model.body_weldid[body])
        mass = float(np.sum(model.body_mass[members]))
        inertia = float(np.sum(model.body_inertia[members])) / 3.0
        for k, of_body in enumerate((mass, inertia)):
            if of_body > 0.0 and model.body_invweight0[body, k] < _YIELDS / of_body:
                model.body_invweight0[body, k] = 1.0 / of_body
                found.append(str(model.body(body).name or f"#{body}"))
    return list(dict.fromkeys(found))
