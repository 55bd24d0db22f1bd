"""The friction law of a connector that is solved with others: fixed limit, reported values."""

import math
from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import (
    SIZE,
    Array,
    coefficient,
    contact,
    cosine,
    limit,
    set_limit,
    share_of,
)
from cylconn_ros.core.group_problem import GroupProblem
from cylconn_ros.core.jit import inline_function
from cylconn_ros.methods.free_axes.complementarity import ReducedStep, reactions

AT_REST: Final = 1e-12  # slip over the terms that make it up
CONVERGED: Final = 1e-9  # residual of a solution


@inline_function
def fix_limit(par: Array, kept: Array, g: GroupProblem, c: int, solved: bool) -> None:
    """Fix the limit of connector c at that of the group's solution; keep the law's numbers.

    With a limit of its own, that depends on its forces, the connector could find another solution
    than the group: jam, where all together slide.
    """
    at = model.FRICTION
    for k in range(SIZE):
        kept[k] = par[at + k]
    if g.on[c] == 0.0:
        return
    radius = g.radius[c] if solved else g.fixed[c]
    i, j = 2 * c, 2 * c + 1
    x, y = g.end[i] + g.back[i], g.end[j] + g.back[j]
    if math.sqrt(x * x + y * y) <= AT_REST * (g.size[i] + g.size[j]):
        radius *= 1.0 + CONVERGED  # at rest: stick, at its limit too
    set_limit(par, at, radius)


@inline_function
def write_law(par: Array, r: ReducedStep, out: Array) -> None:
    """Write coefficient, limit and the flag of a jam by the true law of the connector."""
    law = model.law(par)
    phi = (out[layout.FORCE_FRICTION], out[layout.MOMENT_FRICTION] / law.radius)
    c = cosine(law, phi)
    share = share_of(law, c)
    normal, traction = out[layout.NORMAL_FORCE], out[layout.TRACTION]
    if out[layout.REGIME] == layout.SLIP:
        if normal > 0.0 and traction < law.cap:
            out[layout.FRICTION_COEFFICIENT] = traction / normal
        else:
            out[layout.FRICTION_COEFFICIENT] = coefficient(law, par, 0.0, normal) * share
        return
    out[layout.FRICTION_COEFFICIENT] = coefficient(law, par, 0.0, normal) * share
    out[layout.FRICTION_LIMIT] = limit(law, par, 0.0, normal, c)
    f1 = out[layout.FORCE] - out[layout.FORCE_FRICTION]
    m1 = out[layout.MOMENT] - out[layout.MOMENT_FRICTION]
    grown = normal - contact(law, reactions(r, f1, m1)).normal
    if not (coefficient(law, par, 0.0, grown) * share * grown >= traction > 0.0):
        out[layout.FLAGS] = int(out[layout.FLAGS]) & ~layout.JAMMED
