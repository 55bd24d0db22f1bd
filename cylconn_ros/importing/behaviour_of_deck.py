"""*CONNECTOR BEHAVIOR of an Abaqus deck: what acts on slide (component 1) and spin (4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cylconn_ros.core.layout import MOST_POINTS
from cylconn_ros.errors import ModelError
from cylconn_ros.importing.deck import Block, Units
from cylconn_ros.importing.scene_text import Draft

SLIDE, SPIN = 1, 4


def put(draft: Draft, blocks: Sequence[Block], name: str, scale: Units) -> None:
    """Take over the behaviour with this name. Raises ModelError if it is not in the deck."""
    start = next(
        (k for k, block in enumerate(blocks)
         if block.keyword == "CONNECTOR BEHAVIOR" and block.name("NAME") == name), None
    )  # fmt: skip
    if start is None:
        raise ModelError(f"*CONNECTOR BEHAVIOR, NAME={name}: not in the deck")
    blocks[start].used = True
    beyond = blocks[start].name("EXTRAPOLATION") or "CONSTANT"
    for k in range(start + 1, len(blocks)):
        block = blocks[k]
        if block.keyword == "FRICTION" and blocks[k - 1].keyword == "CONNECTOR FRICTION":
            if blocks[k - 1].used:
                _friction(draft, block, scale)
            continue
        if not block.keyword.startswith("CONNECTOR ") or block.keyword == "CONNECTOR BEHAVIOR":
            break
        _part(draft, block, scale, block.name("EXTRAPOLATION") or beyond)


def _part(draft: Draft, block: Block, scale: Units, beyond: str) -> None:
    """Take over one keyword; ``beyond``: the extrapolation of its tables."""
    component = int(block.parameters.get("COMPONENT", "0") or 0)
    slides = component == SLIDE
    kind = block.keyword.removeprefix("CONNECTOR ")
    unit = scale.length if slides else 1.0
    effort = scale.force if slides else scale.moment
    if kind == "CONSTITUTIVE REFERENCE":
        values = block.data[0] if block.data else []
        block.used = True
        for at, key, size in ((0, "length", scale.length), (3, "angle", math.radians(1.0))):
            if at < len(values) and values[at]:
                comment = "In degrees in the deck." if key == "angle" else ""
                draft.put(f"reference.{key}", block.numbers(0)[at] * size, comment)
        return
    if kind == "FRICTION":
        if "PREDEFINED" in block.parameters:
            block.used = True
            constants = [*block.numbers(0), 0.0, 0.0, 0.0][:3]
            draft.put("friction.radius", constants[0] * scale.length,
                      "Constants of predefined friction in the order R, L, FCint.")  # fmt: skip
            draft.put("friction.overlap", constants[1] * scale.length)
            draft.put("friction.preload", constants[2] * scale.force)
        return
    if component not in (SLIDE, SPIN):
        return
    if kind in ("ELASTICITY", "DAMPING"):
        plain = not {"NONLINEAR", "RIGID", "TYPE"} & set(block.parameters)
        elastic = kind == "ELASTICITY"
        if "NONLINEAR" in block.parameters:
            group = (
                f"{'elasticity' if elastic else 'damping'}.{'' if slides else 'rotational_'}table"
            )
            time = 1.0 if elastic else scale.time
            if _table(draft, block, group, effort, unit / time) and beyond == "LINEAR":
                draft.put(f"{group}.extrapolation", "linear")
            return
        if not plain or len(block.data) != 1:
            return
        names = ("k1", "kr1") if elastic else ("c1", "cr1")
        name = f"{'elasticity' if elastic else 'damping'}.{names[0] if slides else names[1]}"
        time = 1.0 if elastic else scale.time
        draft.put(name, block.numbers(0)[0] * effort * time / unit)
        block.used = True
    elif kind == "STOP":
        bound = "l" if slides else "theta"
        for field, end in zip(block.data[0] if block.data else [], ("min", "max"), strict=False):
            if field:
                at = 0 if end == "min" else 1
                draft.put(f"stops.{bound}_{end}", block.numbers(0)[at] * unit)
        block.used = True
    elif kind == "LOCK":
        _lock(draft, block, slides, unit, effort)


def _table(draft: Draft, block: Block, group: str, effort: float, unit: float) -> bool:
    """Nonlinear elasticity or damping: a force and a position, or a rate, in each line.

    Whether it could be taken over.
    """
    rows = [block.numbers(k)[:2] for k in range(len(block.data))]
    if not 2 <= len(rows) <= MOST_POINTS or any(len(row) < 2 for row in rows):
        return False
    turns = group.endswith("rotational_table")
    at = "rates" if group.startswith("damping") else "angles" if turns else "positions"
    draft.put(f"{group}.{at}", [x * unit for _, x in rows])
    draft.put(f"{group}.{'moments' if turns else 'forces'}", [force * effort for force, _ in rows])
    block.used = True
    return True


def _lock(draft: Draft, block: Block, slides: bool, unit: float, effort: float) -> None:
    """Lower and upper limit of the position, and of the force; one of each is taken."""
    fields = [*(block.data[0] if block.data else []), "", "", "", ""][:4]
    values = [*(block.numbers(0) if block.data else []), 0.0, 0.0, 0.0, 0.0][:4]
    if (fields[0] and fields[1]) or (fields[2] and fields[3] and values[2] != -values[3]):
        return  # two criteria; a scene has one: listed
    draft.put("lock.component", "slide" if slides else "spin")
    for at in (0, 1):
        if fields[at]:
            draft.put("lock.position", values[at] * unit)
    for at in (2, 3):
        if fields[at]:
            draft.put("lock.force", abs(values[at]) * effort)
    block.used = True


def _friction(draft: Draft, block: Block, scale: Units) -> None:
    """The coefficient: constant, with exponential decay, or over the slip rate."""
    speed = scale.length / scale.time
    if "EXPONENTIAL DECAY" in block.parameters:
        static, kinetic, decay = [*block.numbers(0), 0.0, 0.0][:3]
        draft.put("friction.coefficient", kinetic)
        draft.put("friction.static_coefficient", static)
        draft.put("friction.decay", decay / speed)
    elif len(block.data) == 1:
        draft.put("friction.coefficient", block.numbers(0)[0])
    else:
        rows = [block.numbers(k) for k in range(len(block.data))]
        if any(len(row) > 2 for row in rows):
            return  # over pressure: listed
        table = sorted((row[1] if len(row) > 1 else 0.0, row[0]) for row in rows)
        draft.put("friction.table.rates", [rate * speed for rate, _ in table])
        draft.put("friction.table.forces", [0.0])
        draft.put("friction.table.values", [value for _, value in table])
        draft.blanks.pop("friction.coefficient", None)
    if "TAUMAX" in block.parameters:
        draft.put("friction.max_force", float(block.parameters["TAUMAX"]) * scale.force)
    block.used = True


def _amplitude(block: Block | None, scale: Units) -> dict[str, Any] | None:
    """Parameters of an *AMPLITUDE: a table, or a periodic one of one term from 0 on.

    None if it is of another kind: smoothed, absolute, of several terms, or not in the deck.
    """
    if block is None or "SMOOTH" in block.parameters or block.name("VALUE") == "ABSOLUTE":
        return None
    kind = block.name("DEFINITION") or "TABULAR"
    if kind == "TABULAR":
        numbers = [x for row in range(len(block.data)) for x in block.numbers(row)]
        times, values = numbers[0::2], numbers[1::2]
        if len(times) != len(values) or len(times) < 2 or min(times) < 0.0:
            return None
        return {"times": [t * scale.time for t in times], "values": values}
    if kind != "PERIODIC" or len(block.data) < 2:
        return None
    terms, omega, start, mean = [*block.numbers(0), 0.0, 0.0, 0.0, 0.0][:4]
    cosine, sine = [*block.numbers(1), 0.0, 0.0][:2]
    if terms != 1 or start != 0.0 or not omega > 0.0:
        return None
    return {
        "frequency": omega / scale.time / (2.0 * math.pi),
        "mean": mean,
        "amplitude": math.hypot(cosine, sine),
        "phase": math.atan2(cosine, sine),
    }


def put_loads(draft: Draft, blocks: Sequence[Block], targets: set[str], scale: Units) -> None:
    """*CONNECTOR MOTION and *CONNECTOR LOAD on components 1 and 4, with their *AMPLITUDE."""
    amplitudes = {block.name("NAME"): block for block in blocks if block.keyword == "AMPLITUDE"}
    for block in blocks:
        if block.keyword not in ("CONNECTOR MOTION", "CONNECTOR LOAD"):
            continue
        taken, factor = 0, None
        if "AMPLITUDE" in block.parameters:
            factor = _amplitude(amplitudes.get(block.name("AMPLITUDE")), scale)
            if factor is None:
                continue  # another kind of amplitude: listed
        for fields in block.data:
            if len(fields) < 3 or fields[0].upper() not in targets or \
                    fields[1] not in (str(SLIDE), str(SPIN)):  # fmt: skip
                continue
            slides = fields[1] == str(SLIDE)
            axis, unit = ("slide", scale.length) if slides else ("spin", 1.0)
            value = Block(block.keyword, {}, [fields[2:3]], block.line).numbers(0)[0]
            if block.keyword == "CONNECTOR LOAD":
                effort = scale.force if slides else scale.moment
                draft.put(f"command.{axis}.force", value * effort)
            elif block.name("TYPE") == "VELOCITY":
                draft.put(f"command.{axis}.velocity", value * unit / scale.time)
            elif block.name("TYPE") in ("", "DISPLACEMENT"):
                comment = "A displacement in the deck: counted from its initial position."
                draft.put(f"command.{axis}.position", value * unit, comment)
            else:
                continue
            taken += 1
            for key, number in (factor or {}).items():
                draft.put(f"plant.{axis}_amplitude.{key}", number)
        if taken and factor:
            amplitudes[block.name("AMPLITUDE")].used = True
        block.used = taken == len(block.data)
