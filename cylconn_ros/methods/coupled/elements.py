"""Tables and compliant stops of connectors that share bodies.

As in the step of a single one (methods/free_axes/elements.py): the problem of all is solved again
until each linearised force is the force at the rates found.
"""

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.relative_state import measure
from cylconn_ros.methods.coupled.constraints import PUSH, SOLUTION, E
from cylconn_ros.methods.coupled.contacts import END, FRICTION, REACTION
from cylconn_ros.methods.dispatch import begin
from cylconn_ros.methods.free_axes.complementarity import ReducedStep
from cylconn_ros.methods.free_axes.elements import (
    add_elements,
    are_settled,
    has_any_element,
    linearise_about,
)


@device_function
def any_has_elements(par: Array, count: int) -> bool:
    """Whether one of ``count`` connectors has a table or a compliant stop."""
    found = False
    for c in range(count):
        found = found or has_any_element(par[c])
    return found


@device_function
def settled_about(
    par: Array, mem: Array, sample: Array, h: float, r: ReducedStep, out: Array, prepared: Array,
    about: Array, share: float,
) -> bool:  # fmt: skip
    """Whether the forces of one connector's elements are those of the group's solution.

    If not, they are linearised about it, and ``prepared`` is updated. ``mem`` is a copy, ``out``
    scratch space; ``about``: (2,) the rates about which they are linearised, updated.
    """
    if begin(par, mem, sample, h, out) != layout.OK:
        return True
    o = measure(par, mem, sample, h, out)
    linearise_about(mem, (about[0], about[1]), 1.0)
    end = (prepared[SOLUTION + END], prepared[SOLUTION + END + 1])
    at = SOLUTION + FRICTION
    others = (
        abs(prepared[at]) + abs(prepared[SOLUTION + REACTION]),
        abs(prepared[at + 1]) + abs(prepared[SOLUTION + REACTION + 1]),
    )
    if are_settled(par, mem, o, r, h, end, others):
        return True
    one, two = add_elements(par, mem, o, r, h)
    linearise_about(mem, end, share)
    new1, new2 = add_elements(par, mem, o, r, h)
    prepared[PUSH] += new1[0] - one[0]
    prepared[PUSH + 1] += new2[0] - two[0]
    prepared[E] += new1[1] - one[1]
    prepared[E + 1] += new2[1] - two[1]
    about[0], about[1] = mem[model.END_RATES], mem[model.END_RATES + 1]
    return False
