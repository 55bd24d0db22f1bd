r"""Method augmented_lagrangian, unknown inertia: a multiplier takes over the load of the spring.

    lambda <- lambda - rho k e
    f_c     = lambda - k e - c w_c         e the constraint's error, w_c its rate

In steady state lambda carries the whole load and e is zero, whereas the penalty method deflects by
load/k. rho is `penalty.multiplier_gain`; by default k h/(32 c), at most 0.1. Friction is that of
the penalty method: elastic stick, returned radially onto the friction disc.

Drawbacks: lambda follows a changing load with a lag of h/rho, during which e is not zero; and rho
is a third gain that can be unstable. The passivity controller detects unstable gains and lowers
them (methods/passivity_controller.py), which sets the flag GAINS_LOWERED. Where the stiffness falls
at once, the multiplier falls with it: what an oscillation has summed up would act for ever.
"""

import math

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import feedback_gain
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.relative_state import measure
from cylconn_ros.methods import passivity_controller, penalty

SUDDEN = 1.0  # -log of a factor on the stiffness in one sample: more than a window takes
LATE = 1.0  # m/s or rad/s: an oscillation that the work did not end grows as wrenches act late


@device_function
def step(par: Array, mem: Array, sample: Array, h: float, out: Array) -> int:
    """Compute one step: sample (NSAMPLE,), out (NOUT,), ``mem`` updated; returns the flags."""
    o = measure(par, mem, sample, h, out)
    at = model.PENALTY
    e, v, w = o.error, o.twist.v, o.twist.w
    before = _reductions(mem)
    penalty.watch_free_axes(par, mem, o)
    penalty.watch_constraint(par, mem, o, LATE)
    y, z, low = _block(par, mem, 0, par[at], par[at + 2], (e[0], e[1]), (v[1], v[2]), h)
    m2, m3, low_too = _block(par, mem, 1, par[at + 1], par[at + 3], (e[2], e[3]), (w[1], w[2]), h)
    after = _reductions(mem)
    for block in range(2):
        change = after[block] - before[block]
        if change > SUDDEN:  # what an oscillation has summed up is no load
            to = model.MULTIPLIER + 2 * block
            mem[to] *= math.exp(-change)
            mem[to + 1] *= math.exp(-change)
    flags = penalty.write_outputs(par, mem, out, o, (y, z, m2, m3), h)
    if low or low_too:
        flags |= layout.GAINS_LOWERED
    return flags


@inline_function
def _reductions(mem: Array) -> tuple[float, float]:
    """-log of the factors on the stiffnesses of offsets and swings."""
    at = passivity_controller.STIFFNESS_REDUCTION
    one, two = passivity_controller.section(0), passivity_controller.section(1)
    return mem[one + at], mem[two + at]


@device_function
def _block(
    par: Array,
    mem: Array,
    block: int,
    k: float,
    c: float,
    e: tuple[float, float],
    w: tuple[float, float],
    h: float,
) -> tuple[float, float, bool]:
    """Constraint force on two components: offsets (block 0) or swings (1)."""
    to, at = (
        model.MULTIPLIER + 2 * block,
        passivity_controller.section(block),
    )
    explicit, rho = model.output(par).semi_implicit, par[model.AUGMENTED]
    alpha = feedback_gain(par, mem)
    k, c = alpha * alpha * k, alpha * c
    g = passivity_controller.adapted_gains(mem, at, k, c, rho, h, explicit)
    passivity_controller.update(mem, at, g, e, w, (mem[to], mem[to + 1]))
    g = passivity_controller.adapted_gains(mem, at, k, c, rho, h, explicit)
    mem[to] -= g.rho * g.k * e[0]
    mem[to + 1] -= g.rho * g.k * e[1]
    f1 = mem[to] - g.k * e[0] - g.c * w[0]
    f2 = mem[to + 1] - g.k * e[1] - g.c * w[1]
    mem[at + passivity_controller.FORCE], mem[at + passivity_controller.FORCE + 1] = f1, f2
    return f1, f2, g.lowered
