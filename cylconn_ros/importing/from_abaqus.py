"""A connector of an Abaqus deck as a scene: type CYLINDRICAL, or SLOT with REVOLUTE."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import ModelError
from cylconn_ros.importing import behaviour_of_deck
from cylconn_ros.importing.deck import Block, Units, read, units
from cylconn_ros.importing.scene_text import Draft

Array = NDArray[np.float64]

# Keywords that carry nothing for a scene.
_SILENT = {"HEADING", "NODE", "NSET", "ELSET", "PART", "END PART", "ASSEMBLY", "END ASSEMBLY",
           "END INSTANCE", "END STEP", "STEP", "PREPRINT"}  # fmt: skip
_ELEMENTS = ("CONN3D2", "MASS", "ROTARYI")


class Deck:
    """The blocks of a deck, with its nodes, sets and elements."""

    def __init__(self, path: Path, scale: Units) -> None:
        self.path, self.units, self.blocks = path, scale, read(path)
        self.nodes: dict[str, Array] = {}
        self.sets: dict[str, list[str]] = {}
        self.elements: dict[str, tuple[str, list[str]]] = {}  # number: type, nodes
        for block in self.of("NODE"):
            numbers = []
            for row, fields in enumerate(block.data):
                xyz = [*block.numbers(row)[1:4], 0.0, 0.0, 0.0][:3]
                self.nodes[fields[0]] = np.array(xyz) * scale.length
                numbers.append(fields[0])
            self._add(block.name("NSET"), numbers)
        for block in self.of("ELEMENT"):
            numbers = []
            for fields in block.data:
                self.elements[fields[0]] = (block.name("TYPE"), [f for f in fields[1:] if f])
                numbers.append(fields[0])
            self._add(block.name("ELSET"), numbers)
        for block in [*self.of("NSET"), *self.of("ELSET")]:
            name = block.name(block.keyword)
            if "GENERATE" in block.parameters:
                for row in range(len(block.data)):
                    first, last, step = [*map(int, block.numbers(row)), 1][:3]
                    self._add(name, [str(k) for k in range(first, last + 1, max(step, 1))])
            else:
                self._add(name, [f for fields in block.data for f in fields if f])

    def _add(self, name: str, members: list[str]) -> None:
        if name:
            self.sets.setdefault(name, []).extend(members)

    def of(self, keyword: str) -> Iterator[Block]:
        """Blocks with a keyword."""
        return (block for block in self.blocks if block.keyword == keyword)

    def members(self, name: str, depth: int = 0) -> list[str]:
        """Members of a set, or the one number that the name is."""
        if name.upper() not in self.sets or depth > 20:
            return [name.rpartition(".")[2]]
        found = []
        for one in self.sets[name.upper()]:
            found += self.members(one, depth + 1) if one.upper() in self.sets else [one]
        return found


def draft_of(path: Path, connector: str | None, units_text: str | None) -> Draft:
    """The scene of the connector with this element set. Raises ModelError."""
    scale = units(units_text)
    try:
        return _draft(Deck(path, scale), connector, units_text or "")
    except ModelError as error:
        text = str(error)
        raise ModelError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def _draft(deck: Deck, connector: str | None, units_text: str) -> Draft:
    sections = list(deck.of("CONNECTOR SECTION"))
    names = [section.name("ELSET") for section in sections]
    if connector is None or connector.upper() not in names:
        raise ModelError(
            f"--connector {connector or ''}: must be the element set of a *CONNECTOR SECTION; "
            f"the deck has {', '.join(names) or 'none'}"
        )
    section = sections[names.index(connector.upper())]
    section.used = True
    kinds = {field.upper() for fields in section.data[:1] for field in fields if field}
    if kinds not in ({"CYLINDRICAL"}, {"SLOT", "REVOLUTE"}):
        raise ModelError(
            f"line {section.line}: connection type {', '.join(sorted(kinds)) or 'none'}: must be "
            "CYLINDRICAL, or SLOT with REVOLUTE"
        )
    elements = deck.members(section.name("ELSET"))
    if len(elements) != 1 or elements[0] not in deck.elements:
        raise ModelError(f"element set {connector}: holds {len(elements)} elements; must be one")
    kind, nodes = deck.elements[elements[0]]
    if not kind.startswith("CONN3D2"):
        raise ModelError(f"element {elements[0]}: type {kind}; must be CONN3D2")
    draft = Draft(f"{deck.path.name}, connector {connector} (units {units_text})")
    draft.put("reference.offsets", "hold")
    if len(nodes) == 1:
        nodes = ["0", nodes[0]]
    axes = _orientations(deck, section)
    for group, node, orientation in zip("ab", nodes, axes, strict=True):
        _put_body(deck, draft, group, node)
        draft.put(f"node_{group}.orientation", orientation)
    if not deck.sets.get(section.name("BEHAVIOR")) and section.name("BEHAVIOR"):
        behaviour_of_deck.put(draft, deck.blocks, section.name("BEHAVIOR"), deck.units)
    behaviour_of_deck.put_loads(draft, deck.blocks, {connector.upper(), elements[0]}, deck.units)
    _put_gravity(deck, draft)
    draft.friction_blanks()
    rest: dict[str, list[int]] = {}
    for block in deck.blocks:
        element = block.keyword == "ELEMENT" and block.name("TYPE") in _ELEMENTS
        if not (block.used or element or block.keyword in _SILENT):
            rest.setdefault(block.keyword, []).append(block.line)
    draft.left_out += [
        f"*{keyword} (line {', '.join(map(str, lines))})" for keyword, lines in rest.items()
    ]
    return draft


def _orientations(deck: Deck, section: Block) -> list[Array]:
    """Axes at the two nodes as quaternions; the second is the first unless it is given."""
    named = {block.name("NAME"): block for block in deck.of("ORIENTATION")}
    given = [field.upper() for fields in section.data[1:2] for field in fields]
    found: list[Array] = []
    for k in range(2):
        name = given[k] if k < len(given) else ""
        if not name:
            found.append(found[0] if found else np.array([0.0, 0.0, 0.0, 1.0]))
            continue
        if name not in named:
            raise ModelError(f"line {section.line}: orientation {name}: not in the deck")
        found.append(_axes(named[name]))
    return found


def _axes(block: Block) -> Array:
    """Quaternion of an *ORIENTATION: a on the x axis, b in the x-y plane, c the origin."""
    block.used = True
    if block.parameters.get("SYSTEM", "RECTANGULAR").upper() != "RECTANGULAR" or \
            block.parameters.get("DEFINITION", "COORDINATES").upper() != "COORDINATES":  # fmt: skip
        raise ModelError(
            f"line {block.line}: *ORIENTATION: must be SYSTEM=RECTANGULAR, DEFINITION=COORDINATES"
        )
    values = [*block.numbers(0), *([0.0] * 9)][:9]
    a, b, c = (np.array(values[k : k + 3]) for k in (0, 3, 6))
    x, y = a - c, b - c
    z = np.cross(x, y)
    if not np.linalg.norm(z) > 1e-12 * np.linalg.norm(x) * np.linalg.norm(y):
        raise ModelError(f"line {block.line}: *ORIENTATION: the points are on one line")
    axes = np.column_stack([x, np.cross(z, x), z])
    axes = axes / np.linalg.norm(axes, axis=0)
    if len(block.data) > 1:
        number, angle = [*block.numbers(1), 0.0][:2]
        about, half = int(number or 3) - 1, math.radians(angle)
        i, j = (about + 1) % 3, (about + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = math.cos(half)
        turn[i, j], turn[j, i] = -math.sin(half), math.sin(half)
        axes = axes @ turn
    return quaternion(axes)


def quaternion(m: Array) -> Array:
    """Quaternion x, y, z, w of a rotation matrix, w >= 0."""
    k = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], 0, 0, 0],
            [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0, 0],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)],
        ]
    )
    vector: Array = np.linalg.eigh(k)[1][:, -1]
    return vector if vector[3] >= 0.0 else -vector


def _put_body(deck: Deck, draft: Draft, group: str, node: str) -> None:
    """The rigid body that a node belongs to; its frame is at the reference node, world axes."""
    name, scale = f"body_{group}", deck.units
    reference = node
    for block in deck.of("RIGID BODY"):
        sets = [block.name(key) for key in ("ELSET", "PIN NSET", "TIE NSET") if block.name(key)]
        inside = {n for one in sets for m in deck.members(one)
                  for n in (deck.elements[m][1] if m in deck.elements else [m])}  # fmt: skip
        centre = deck.members(block.name("REF NODE"))[0]
        if node in inside or node == centre:
            reference, block.used = centre, True
    at = deck.nodes.get(reference, np.zeros(3))
    if node != "0" and node not in deck.nodes:
        raise ModelError(f"node {node} of the connector: not in the deck")
    draft.put(f"{name}.frame", f"node_{reference}" if node != "0" else "ground")
    held = node == "0" or any(
        {reference, node} & set(deck.members(fields[0]))
        and (fields[1].upper() == "ENCASTRE" or fields[1:3] == ["1", "6"])
        for block in deck.of("BOUNDARY") for fields in block.data if len(fields) > 1
    )  # fmt: skip
    draft.put(f"{name}.kind", "fixed" if held else "free")
    draft.put(f"{name}.pose", [*at, 0.0, 0.0, 0.0, 1.0], "Axes of the deck, at the body's node.")
    draft.put(f"node_{group}.position", deck.nodes.get(node, at) - at)
    if held:
        for block in deck.of("BOUNDARY"):
            block.used = True
        return
    for keyword, key in (("MASS", "mass"), ("ROTARY INERTIA", "inertia")):
        for block in deck.of(keyword):
            points = {n for m in deck.members(block.name("ELSET")) if m in deck.elements
                      for n in deck.elements[m][1]}  # fmt: skip
            if not points & {reference, node}:
                continue
            block.used = True
            numbers = block.numbers(0)
            if key == "mass":
                draft.put(f"{name}.mass", numbers[0] * scale.mass)
            else:  # Abaqus: I11, I22, I33, I12, I13, I23
                xx, yy, zz, xy, xz, yz = [*numbers, *([0.0] * 6)][:6]
                tensor = np.array([xx, xy, xz, yy, yz, zz]) * scale.inertia
                draft.put(f"{name}.inertia", tensor)
    draft.blank(f"{name}.mass", "1.0", "kg; the deck has no *MASS at this node; the scene cannot "
                "be loaded", required=True)  # fmt: skip
    draft.blank(
        f"{name}.inertia",
        "[0.01, 0.0, 0.0, 0.01, 0.0, 0.01]",
        "kg m^2; the deck has no *ROTARY INERTIA at this node; the scene cannot be loaded",
        required=True,
    )


def _put_gravity(deck: Deck, draft: Draft) -> None:
    gravity = np.zeros(3)
    for block in deck.of("DLOAD"):
        for row, fields in enumerate(block.data):
            if len(fields) > 1 and fields[1].upper() == "GRAV":
                clean = Block("DLOAD", {}, [fields[2:]], block.line)
                size, *direction = clean.numbers(0)
                unit = np.array(direction[:3]) / max(np.linalg.norm(direction[:3]), 1e-300)
                gravity += size * unit * deck.units.length / deck.units.time**2
                block.used = row + 1 == len(block.data)
    draft.put("gravity", gravity, "Of *DLOAD, GRAV; none if the deck has none.")
