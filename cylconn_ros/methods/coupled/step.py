"""The step of method impulse for connectors that share bodies, solved together.

Let Lambda_c be the wrench of connector c and w_c+ the relative twist at its node b at the end of
the step. The wrenches of all connectors move the bodies:

    v+ = vf + h M^-1 sum_d J~_d^T Lambda_d        w_c+ = J~_c vf + h sum_d G_cd Lambda_d
    G_cd = J~_c M^-1 J~_d^T                       the Delassus operator

The constrained rows of all connectors (y, z and both misalignments of each) have the targets of a
single connector:

    R = P (b - G_ra phi)        R: f2 f3 m2 m3 of all; phi: f1 m1 of all; b = (target - J~ vf)/h

P gives the minimum-norm solution (core/least_norm.py) in the metric sum f^2 + (m / arm)^2: if
connectors constrain a body redundantly, the reactions are the smallest that satisfy the
constraints. What remains are slide and spin of all (core/group_friction.py). With their solution,
each connector completes its step as if it were alone, the forces of the others being known
(methods/free_axes/step.py): it solves its friction and limits once more, and stores its history.
"""

import math
from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.dense import solve_general
from cylconn_ros.core.free_gain import store_step, update_gain
from cylconn_ros.core.friction import SIZE, Array
from cylconn_ros.core.group_friction import (
    GroupProblem,
    limit_friction,
    solve_group_friction,
    sticks,
)
from cylconn_ros.core.jit import device_function, inline_function, kernel
from cylconn_ros.core.kinematics import Twist
from cylconn_ros.core.relative_state import RelativeState, measure
from cylconn_ros.methods import impulse
from cylconn_ros.methods.coupled.constraints import (
    ABOUT,
    BACK,
    LIMITS,
    MEASURED,
    PUSH,
    RADIUS,
    SOLUTION,
    TERMS,
    WAS_STICK,
    Arrays,
    E,
    change,
    constraint_residual,
    eliminate,
    prepare,
    reduced_step,
    write_delassus,
    write_moved,
)
from cylconn_ros.methods.coupled.contacts import (
    ABOVE,
    BELOW,
    END,
    FRICTION,
    HIGH,
    LOW,
    NLIMITS,
    REACTION,
    REGIME,
    REST,
    find_contacts,
    has_any_stop,
    solve_limited,
)
from cylconn_ros.methods.coupled.elements import any_has_elements, settled_about
from cylconn_ros.methods.coupled.friction_law import CONVERGED, fix_limit, write_law
from cylconn_ros.methods.coupled.memory import parts
from cylconn_ros.methods.dispatch import begin, finish
from cylconn_ros.methods.free_axes.complementarity import ReducedStep
from cylconn_ros.methods.free_axes.elements import (
    HALVED_AFTER,
    MOST_SOLUTIONS,
    linearise_about,
)
from cylconn_ros.methods.free_axes.step import complete_free_axes, pose_free_axes

# --- report of a step ---
RESIDUAL: Final = 0  # of friction and limits of all
STEPS: Final = 1  # Newton steps
OFF: Final = 2  # rate of the constraints that contradict each other, m/s
NREPORT: Final = 3

CONTRADICTION: Final = 1e-5  # m in a step, by which constraints may contradict each other
HELD: Final = 1e-9  # relative mobility; below it what is at rest holds a component


@device_function
def _pose(g: GroupProblem, a: Arrays, constants: Array, h: float) -> None:
    """Write the problem of slide and spin, springs included, in scaled components."""
    n, q = 2 * g.number, 4 * g.number
    sprung = False
    for i in range(n):
        sprung = sprung or a.prepared[i // 2, E + i % 2] != 0.0
    for i in range(n):
        total = a.slip[i]
        for j in range(n):
            total += a.a[i, j] * a.prepared[j // 2, PUSH + j % 2]
            g.s[i, j] = a.a[i, j]
            if sprung:
                a.system[i, j] = a.a[i, j] * a.prepared[j // 2, E + j % 2]
                a.system[i, n + j] = a.a[i, j]
        g.free[i] = total
        if sprung:
            a.system[i, i] += 1.0
            a.system[i, 2 * n] = total
    if sprung:
        solve_general(a.system, n, n + 1)
        for i in range(n):
            g.free[i] = a.system[i, 2 * n]
            for j in range(n):
                g.s[i, j] = a.system[i, n + j]
    for i in range(q):
        base = a.x[n, i]
        for j in range(n):
            e = a.prepared[j // 2, E + j % 2]
            base += a.x[j, i] * (a.prepared[j // 2, PUSH + j % 2] - e * g.free[j])
            by = a.x[j, i]
            for k in range(n if sprung else 0):
                by -= a.x[k, i] * a.prepared[k // 2, E + k % 2] * g.s[k, j]
            g.by[i, j] = by
        g.base[i] = base
    _scale(g, a, constants, h)


@inline_function
def _scale(g: GroupProblem, a: Arrays, constants: Array, h: float) -> None:
    """Scale spin by the radius; write what else describes the problem."""
    n, q = 2 * g.number, 4 * g.number
    for j in range(n):
        c = j // 2
        r = constants[c, RADIUS] if j % 2 == 1 else 1.0
        g.moves[j] = 1.0 if a.a[j, j] > 0.0 else 0.0
        g.free[j] *= r
        for i in range(n):
            g.s[i, j] *= r
            g.s[j, i] *= r
        for i in range(q):
            g.by[i, j] *= r
        limits = LIMITS + NLIMITS * (j % 2)
        g.slips[j] = g.moves[j]
        g.terms[j] = abs(g.free[j]) + r * a.prepared[c, TERMS + j % 2]
        g.low[j], g.high[j] = r * a.prepared[c, limits + LOW], r * a.prepared[c, limits + HIGH]
        g.phi[j] = g.p[j] = g.anchor[j] = g.anchor[n + j] = 0.0
        g.least[j], g.most[j] = (
            -a.prepared[c, limits + BELOW] / r,
            a.prepared[c, limits + ABOVE] / r,
        )
    g.share[0] = 1.0
    _rest(g, a)
    for j in range(n):
        c, r = j // 2, constants[j // 2, RADIUS] if j % 2 == 1 else 1.0
        g.back[j] = r * a.prepared[c, BACK + j % 2] * g.slips[j]
        g.before[j] = r * a.prepared[c, MEASURED + j % 2] * g.slips[j]
    for c in range(g.number):
        par = g.par[c]
        mobility = (par[model.BODY_A + 2] if par[model.BODY_A] != 0.0 else 0.0) + (
            par[model.BODY_B + 2] if par[model.BODY_B] != 0.0 else 0.0
        )
        g.mobility[c] = h * mobility
        greatest = max(g.s[2 * c, 2 * c], g.s[2 * c + 1, 2 * c + 1])
        g.gain[c] = greatest if greatest > 0.0 else 1.0
        g.on[c] = 1.0 if greatest > 0.0 and model.law(par).on else 0.0
        g.forced[c] = 0.0
        a.was_stick[c] = a.prepared[c, WAS_STICK]


@inline_function
def _rest(g: GroupProblem, a: Arrays) -> None:
    """Set ``slips`` to 0 for what is at rest at a stop or a lock, and what that holds in place.

    The mobility that remains is that of the others after elimination of the components at rest.
    """
    n = 2 * g.number
    for i in range(n):
        for j in range(n):
            g.matrix[i, j] = g.s[i, j]
    found = False
    for k in range(n):
        resting = a.prepared[k // 2, LIMITS + NLIMITS * (k % 2) + REST] != 0.0
        if resting and g.moves[k] != 0.0:
            found = True
            g.slips[k] = 0.0
            if g.matrix[k, k] > HELD * g.s[k, k]:
                for i in range(n):
                    share = g.matrix[i, k] / g.matrix[k, k]
                    for j in range(n):
                        if i != k and j != k:
                            g.matrix[i, j] -= share * g.matrix[k, j]
                for i in range(n):
                    g.matrix[i, k] = g.matrix[k, i] = 0.0
    for k in range(n):
        if found and g.matrix[k, k] <= HELD * g.s[k, k]:
            g.slips[k] = 0.0


@inline_function
def _write_total(g: GroupProblem, a: Arrays, constants: Array) -> None:
    """(f1, m1) of all for the solution."""
    for j in range(2 * g.number):
        c, k = j // 2, j % 2
        r = constants[c, RADIUS] if k == 1 else 1.0
        rate = g.end[j] / r
        a.forces[j] = a.prepared[c, PUSH + k] - a.prepared[c, E + k] * rate
        a.forces[j] += r * (g.phi[j] + g.p[j])
        a.prepared[c, SOLUTION + END + k] = rate
        a.prepared[c, SOLUTION + FRICTION + k] = r * g.phi[j]
        a.prepared[c, SOLUTION + REACTION + k] = r * g.p[j]
        a.prepared[c, SOLUTION + REGIME] = layout.STICK if sticks(g, c) else layout.SLIP


@device_function
def _complete(
    par: Array, mem: Array, sample: Array, h: float, r: ReducedStep, moves: tuple[bool, bool],
    flags: int, terms: float, prepared: Array, out: Array,
) -> int:  # fmt: skip
    """Complete the step of one connector, its constraints eliminated; returns the status.

    ``moves``: of slide and spin. What the others hold has no slip that friction could oppose.
    ``terms``: sum of the terms of its slip, with which the residual of its direction is compared.
    """
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    o = measure(par, mem, sample, h, out)
    s = impulse.prepare_step(par, mem, sample, o, h, False)
    s = impulse.PreparedStep(
        s.a, s.b, s.acting, s.g, s.free, s.jacobian_change, s.target, r, s.flags | flags
    )
    v, w = o.twist.v, o.twist.w
    free = Twist((v[0] if moves[0] else 0.0, v[1], v[2]), (w[0] if moves[1] else 0.0, w[1], w[2]))
    o = RelativeState(
        o.body_a, o.body_b, o.nodes, o.a, o.b, o.frame, free, o.length, o.angle, o.error, o.flags
    )
    update_gain(par, mem, free.v[0], free.w[0], h)
    linearise_about(mem, (prepared[SOLUTION + END], prepared[SOLUTION + END + 1]), 1.0)
    q = pose_free_axes(par, mem, o, r, h)
    explicit = model.output(par).semi_implicit
    found = solve_limited(par, mem, o, r, q, h, explicit, prepared[LIMITS:], prepared[SOLUTION:])
    av = complete_free_axes(par, mem, o, r, q, found, h, False)
    flags = impulse.write_outputs(par, mem, out, o, s, av, h, 1.0)
    store_step(par, mem, r.free, r.a, flags & layout.LIMITED != 0)
    x, y = av.solved.s_mean
    slip = math.sqrt(x * x + y * y)
    out[layout.RESIDUAL] = av.solved.residual * (slip / terms if slip < terms else 1.0)
    return finish(par, mem, sample, h, flags, out)


@device_function
def _meets_stops(
    par: Array, mem: Array, samples: Array, h: float, outs: Array, constants: Array, a: Arrays,
    g: GroupProblem, residual: float,
) -> bool:  # fmt: skip
    """Find the contacts of all connectors with their stops; whether there is one."""
    count, found, known = g.number, False, False
    for c in range(count):
        if not has_any_stop(par[c]):
            continue
        if not known:
            known = True
            if residual > CONVERGED:
                limit_friction(g)
            _write_total(g, a, constants)
        r = reduced_step(a, c, count, h)
        fix_limit(par[c], a.kept, g, c, residual <= CONVERGED)
        for k in range(model.NMEM):
            a.scratch[k] = mem[c, k]
        about = (a.prepared[c, SOLUTION + END], a.prepared[c, SOLUTION + END + 1])
        bounded = find_contacts(
            par[c], a.scratch, samples[c], h, r, outs[c], a.prepared[c, LIMITS:], about
        )
        found = found or bounded
        for k in range(SIZE):
            par[c, model.FRICTION + k] = a.kept[k]
    return found


@device_function
def _solve(
    par: Array, mem: Array, samples: Array, h: float, outs: Array, constants: Array, a: Arrays,
    g: GroupProblem,
) -> tuple[float, int, bool]:  # fmt: skip
    """Solve slide and spin of all; the residual, Newton steps, and whether elements are settled."""
    count, steps = g.number, 0
    elastic = any_has_elements(par, count)
    for n in range(MOST_SOLUTIONS):
        _pose(g, a, constants, h)
        residual, taken = solve_group_friction(g, a.was_stick)
        steps += taken
        if not elastic:
            return residual, steps, True
        _write_total(g, a, constants)
        settled, share = True, 1.0 if n < HALVED_AFTER else 0.5
        for c in range(count):
            for k in range(model.NMEM):
                a.scratch[k] = mem[c, k]
            r = reduced_step(a, c, count, h)
            settled = settled_about(
                par[c], a.scratch, samples[c], h, r, outs[c], a.prepared[c],
                a.prepared[c, ABOUT:], share,
            ) and settled  # fmt: skip
        if settled:
            return residual, steps, True
    return residual, steps, False


@device_function
def _step(
    par: Array, mem: Array, samples: Array, h: float, outs: Array, constants: Array, a: Arrays,
    g: GroupProblem, report: Array,
) -> int:  # fmt: skip
    """:func:`step_group` with the working memory in parts."""
    count = samples.shape[0]
    for c in range(count):
        for k in range(model.NMEM):
            a.scratch[k] = mem[c, k]
        status = prepare(par[c], a.scratch, samples[c], h, outs[c], a.prepared[c])
        if status != layout.OK:
            return status
        write_moved(par[c], constants[c], a.prepared[c], a.moved[c])
    write_delassus(a, count, par, constants)
    off = eliminate(a, count, constants, h)
    residual, steps, settled = _solve(par, mem, samples, h, outs, constants, a, g)
    if _meets_stops(par, mem, samples, h, outs, constants, a, g, residual):
        residual, taken, settled = _solve(par, mem, samples, h, outs, constants, a, g)
        steps += taken
    flags = layout.CONTRADICTORY if not off * h <= CONTRADICTION else 0
    solved = residual <= CONVERGED
    if not (solved and settled):
        flags |= layout.NOT_CONVERGED
    if not solved:
        limit_friction(g)
    _write_total(g, a, constants)
    for c in range(count):
        if g.moves[2 * c] == 0.0 and g.moves[2 * c + 1] == 0.0:
            flags |= layout.CONTRADICTORY
    worst = layout.OK
    for c in range(count):
        r = reduced_step(a, c, count, h)
        moves = (g.moves[2 * c] != 0.0, g.moves[2 * c + 1] != 0.0)
        fix_limit(par[c], a.kept, g, c, solved)
        terms = g.size[2 * c] + g.size[2 * c + 1]
        status = _complete(
            par[c], mem[c], samples[c], h, r, moves, flags, terms, a.prepared[c], outs[c]
        )
        for k in range(SIZE):
            par[c, model.FRICTION + k] = a.kept[k]
        if status == layout.OK and model.law(par[c]).on:
            write_law(par[c], r, outs[c])
        worst = status if worst == layout.OK else worst
    if worst != layout.OK:
        return worst
    moved = change(a, g, outs, constants)
    residual = max(residual, moved, constraint_residual(a, count, outs, constants, h))
    for c in range(count):
        outs[c, layout.RESIDUAL] = max(outs[c, layout.RESIDUAL], residual)
        if residual > CONVERGED:
            outs[c, layout.FLAGS] = int(outs[c, layout.FLAGS]) | layout.NOT_CONVERGED
    report[RESIDUAL], report[STEPS], report[OFF] = residual, steps, off
    return layout.OK


@kernel
def step_group(
    par: Array, mem: Array, samples: Array, h: float, outs: Array, constants: Array,
    memory: Array, report: Array,
) -> int:  # fmt: skip
    """Compute one step of N connectors; returns the status, the first that is not OK.

    Args:
        par: (N, size). mem: (N, NMEM), updated. samples: (N, NSAMPLE). outs: (N, NOUT).
        constants: (N, NCONSTANTS). memory: (1, working_size(N)). report: (NREPORT,).
    """
    a, g = parts(memory[0], samples.shape[0], par)
    return _step(par, mem, samples, h, outs, constants, a, g, report)
