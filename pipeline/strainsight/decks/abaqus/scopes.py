"""Parts and instances of an assembly: all nodes and elements, and the meaning of names in each instance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from strainsight.decks.abaqus.parts import BEAMS, SHELLS, THIN, Part, read_part
from strainsight.decks.abaqus.text import MESH, Keyword, Row, Step, read_structure
from strainsight.decks.faults import entity_error
from strainsight.decks.text import describe_non_integer, is_whole, parse_integer
from strainsight.errors import DeckError
from strainsight.mesh.coordinates import rotation
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.thin import concatenate


def placement(keyword: Keyword) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) of an *INSTANCE: first the translation, then the rotation about an axis
    of the assembly."""
    rows = keyword.rows(needed=False)
    turns = [row for row in rows if any(row.tokens[3:])]
    shifts = [row for row in rows if not any(row.tokens[3:])]
    if len(turns) > 1 or len(shifts) > 1:
        raise rows[-1].error(
            "the instance has more than one translation or more than one rotation",
            "write one line with the translation x, y, z, then one line with two points of the rotation axis and the angle [deg]",
        )
    shift = shifts[0].reals(3, "a translation") if shifts else np.zeros(3)
    if not turns:
        return np.eye(3), shift
    values = turns[0].reals(7, "a coordinate of the rotation axis, or the rotation angle,")
    a, axis = values[:3], values[3:6] - values[:3]
    if not np.linalg.norm(axis) > 0:
        raise turns[0].error(
            "the two points of the rotation axis coincide", "specify two different points, and the angle [deg]"
        )
    R = rotation(axis / np.linalg.norm(axis), np.radians(values[6]))
    return R, a + R @ (shift - a)


@dataclass(frozen=True)
class Scope:
    """A placed part: x = rotation (3, 3) x' + translation (3,); name of the instance, "" for the assembly or a flat
    deck; rows of its first node and element in the whole deck."""

    name: str
    part: Part
    rotation: FloatArray
    translation: FloatArray
    first_node: int
    first_element: int


@dataclass
class Assembly:
    """All nodes and elements of the deck, instance by instance, followed by those of the assembly itself.

    node_ids (n,), position (n, 3); element_ids (m,), kind (m,) index into ELEMENTS or −1, type of each element,
    empty if it is left out; nodes (c,) rows of nodes, −1 if missing, first (m + 1,) start of the nodes of each
    element; file and line of each; notes: messages on ids and sets."""

    scopes: dict[str, Scope]
    node_ids: IntArray
    position: FloatArray
    node_where: list[tuple[str, int]]
    element_ids: IntArray
    kind: IntArray
    type: list[str]
    nodes: IntArray
    first: IntArray
    element_where: list[tuple[str, int]]
    steps: tuple[Step, ...]
    notes: list[str] = field(default_factory=list)
    _known: dict[tuple[str, str, str], IntArray] = field(default_factory=dict)

    @cached_property
    def families(self) -> NDArray[np.str_]:
        """(m,): "solid", "shell", "beam" or "rod"; empty for elements that are not imported."""
        names = {
            **dict.fromkeys(SHELLS, "shell"),
            **{type_: "rod" if kind == "rod" else "beam" for type_, (kind, _) in BEAMS.items()},
        }
        families = np.array([names.get(type_, "") for type_ in self.type], dtype="U5")
        families[self.kind >= 0] = "solid"
        return families

    @cached_property
    def thin_kinds(self) -> NDArray[np.str_]:
        """(m,): kind of a shell, beam or rod; empty for all other elements."""
        return np.array([THIN.get(type_, ("", ""))[0] for type_ in self.type], dtype="U5")

    def element(self, row: int) -> str:
        """Name of an element in the words of the deck: "S4R 12"."""
        return f"{self.type[row]} {self.element_ids[row]}"

    def where(self, row: int) -> str:
        """file:line of an element."""
        return "{}:{}".format(*self.element_where[row])

    def element_error(self, row: int, what: str, remedy: str) -> DeckError:
        """A DeckError at an element."""
        return entity_error("element", int(self.element_ids[row]), what, remedy, lambda *_: self.where(row))

    def name_of(self, rows: IntArray) -> Callable[[int], str]:
        """Index of an element in `rows` → `element`."""
        return lambda i: self.element(int(rows[i]))

    def error_of(self, rows: IntArray) -> Callable[[int, str, str], DeckError]:
        """Index of an element in `rows` → `element_error`."""
        return lambda i, what, remedy: self.element_error(int(rows[i]), f"{self.element(int(rows[i]))}: {what}", remedy)

    @property
    def flat(self) -> bool:
        """Whether there is at most one instance, so that names are unique without it."""
        return len(self.scopes) <= 2

    def keywords(self, name: str, of_steps: bool = False) -> Iterator[tuple[Scope, Keyword]]:
        """Keywords of this name, once for every instance of a part, with the scope of their names; of_steps:
        followed by those in steps."""
        for scope in self.scopes.values():
            for keyword in scope.part.keywords:
                if keyword.name == name:
                    yield scope, keyword
        for step in self.steps if of_steps else ():
            yield from ((self.scopes[""], keyword) for keyword in step.keywords if keyword.name == name)

    def split_name(self, name: str, scope: Scope) -> tuple[Scope, str]:
        """WHEEL-1.RIM seen from the assembly → (scope of WHEEL-1, "RIM")."""
        if not scope.name:
            for i, letter in enumerate(name):
                if letter == "." and i and name[:i].upper() in self.scopes:
                    return self.scopes[name[:i].upper()], name[i + 1 :]
        return scope, name

    def connectivity(self, rows: IntArray, places: Sequence[int]) -> IntArray:
        """Rows (k, p) of the nodes of elements at these places of their connectivity."""
        return self.nodes[self.first[rows][:, None] + np.array(places)]

    def nodes_of(self, row: int) -> IntArray:
        """Rows of the nodes of one element; −1 for nodes that are not in the deck."""
        return self.nodes[self.first[row] : self.first[row + 1]]

    def element_nodes(self, rows: IntArray) -> IntArray:
        """Unique sorted rows (k,) of the nodes of elements."""
        counts = self.first[rows + 1] - self.first[rows]
        start = np.repeat(self.first[rows] - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
        nodes = np.unique(self.nodes[start + np.arange(counts.sum())]) if rows.size else rows
        return nodes[nodes >= 0]

    def set_names(self, kind: str, scope: Scope) -> dict[str, str]:
        """Name in capitals → name as first written, of the sets of kind NODE or ELEMENT in a scope."""
        parameter = "NSET" if kind == "NODE" else "ELSET"
        return {
            name: definitions[0].parameters[parameter]
            for (of, name), definitions in scope.part.sets.items()
            if of == kind
        }

    def rows(self, kind: str, entry: str, scope: Scope, row: Keyword | Row) -> IntArray:
        """Rows of the NODE or ELEMENT, or of the set of these, that an entry names; DeckError if it does not exist."""
        within, name = self.split_name(entry, scope)
        number = parse_integer(name)
        if number is None and is_whole(name):
            raise row.error(describe_non_integer(f"the {kind.lower()} id", name))
        if number is not None:
            rows, missing = self._numbered(kind, np.array([number]), within)
            if missing[0]:
                place = f" of instance {within.name}" if within.name else ""
                raise row.error(f"{kind.lower()} {number}{place} is not in the deck", "correct the id")
            return rows
        return self.set_rows(kind, entry, scope, row)

    def set_rows(self, kind: str, entry: str, scope: Scope, row: Keyword | Row) -> IntArray:
        """Rows of the set of this kind and name, also if the name is a number; DeckError if it does not exist."""
        within, name = self.split_name(entry, scope)
        if (rows := self._set(kind, name.upper(), within, ())) is None:
            raise row.error(f"{kind.lower()} set {entry!r} is not in the deck", "correct the set name, or add the set")
        return rows

    def _numbered(self, kind: str, ids: IntArray, scope: Scope) -> tuple[IntArray, np.ndarray]:
        table, first = (
            (scope.part.nodes, scope.first_node) if kind == "NODE" else (scope.part.elements, scope.first_element)
        )
        rows, missing = table.rows(ids)
        return rows + first, missing

    def _set(self, kind: str, name: str, scope: Scope, above: tuple[str, ...]) -> IntArray | None:
        """Unique sorted rows of a set; None if no keyword defines it."""
        key = (kind, scope.name.upper(), name)
        if key in self._known:
            return self._known[key]
        if (kind, name) not in scope.part.sets:
            return None
        parts: list[IntArray] = []
        first = scope.first_node if kind == "NODE" else scope.first_element
        for keyword in scope.part.sets[kind, name]:
            if keyword.name == kind:
                parts.append(scope.part.rows[id(keyword)] + first)
            else:
                parts.append(self._listed(kind, keyword, scope, (*above, f"{scope.name}.{name}")))
        self._known[key] = np.unique(concatenate(parts))
        return self._known[key]

    def _listed(self, kind: str, keyword: Keyword, scope: Scope, above: tuple[str, ...]) -> IntArray:
        """Members that an *NSET or *ELSET lists."""
        parameters = keyword.parameters
        if "INSTANCE" in parameters:
            name = parameters["INSTANCE"]
            if name.upper() not in self.scopes or not name:
                raise keyword.error(f"instance {name!r} is not in the deck", "correct the instance name")
            scope = self.scopes[name.upper()]
        if kind == "NODE" and "ELSET" in parameters:
            return self.element_nodes(self.set_rows("ELEMENT", parameters["ELSET"], scope, keyword))
        if "GENERATE" in parameters:
            return self._generated(kind, keyword, scope)
        entries: list[tuple[str, Row]] = [(e, row) for row in keyword.rows(needed=False) for e in row.tokens if e]
        numbers = [parse_integer(entry) for entry, _ in entries]
        ids = np.array([number or 0 for number in numbers], dtype=np.int64)
        rows, missing = self._numbered(kind, ids, scope)
        parts = [rows[np.array([number is not None for number in numbers], dtype=bool)]]
        for i in np.flatnonzero(missing):
            entry, row = entries[i]
            if numbers[i] is not None:
                self.rows(kind, entry, scope, row)  # raises the error for the missing entry
            within, name = self.split_name(entry, scope)
            if parse_integer(name) is None:
                if f"{within.name}.{name.upper()}" in above:
                    raise row.error(
                        f"{kind.lower()} set {entry!r} contains itself, directly or through another set",
                        f"remove {entry!r} from this line",
                    )
                self._set(kind, name.upper(), within, above)
            parts.append(self.rows(kind, entry, scope, row))
        return np.concatenate(parts)

    def _generated(self, kind: str, keyword: Keyword, scope: Scope) -> IntArray:
        table = scope.part.nodes if kind == "NODE" else scope.part.elements
        parts = [np.zeros(0, dtype=np.int64)]
        lost = 0
        for row in keyword.rows():
            low = row.integer(0, "the first id of the range")
            high = row.integer(1, "the last id of the range", low)
            step = row.integer(2, "the increment", 1) or 1
            if high < low or step < 0:
                raise row.error(
                    f"the range of ids {low} to {high} with increment {step} is decreasing",
                    "write the lower id first, and a positive increment",
                )
            sorted_ids = table.sorted
            within = sorted_ids[np.searchsorted(sorted_ids, low) : np.searchsorted(sorted_ids, high, side="right")]
            within = within[(within - low) % step == 0]
            lost += (high - low) // step + 1 - within.size
            parts.append(self._numbered(kind, within, scope)[0])
        if lost:
            what = f"ids of {keyword.title}, GENERATE that are not in the deck are left out ({lost} in total)"
            sentence = f"{keyword.where}: {what}"
            self.notes += [sentence] if sentence not in self.notes else []
        return np.concatenate(parts)


def assemble(keywords: list[Keyword]) -> Assembly:
    """Place the parts of a deck.

        x = a + R (x' + t − a)

    with the translation t and the rotation R about the axis from a to b of each instance. A deck without parts is
    one scope. If ids of instances clash, i·10ᵏ is added to the ids of instance i, with k large enough to make them
    unique. Raises DeckError for parts and steps without end, and for instances of missing parts."""
    model, parts, instances, steps = read_structure(keywords)
    scopes: dict[str, Scope] = {}
    read: dict[str, Part] = {}
    placed: list[tuple[str, Part, FloatArray, FloatArray]] = []
    for keyword, instance_keywords in instances:
        part_name = keyword.needs("PART").upper()
        if part_name not in parts:
            raise keyword.error(f"part {keyword.parameters['PART']!r} is not in the deck", "correct the part name")
        if any(k.name in MESH for k in instance_keywords):
            part = read_part((*parts[part_name], *instance_keywords))
        else:
            part = read.get(part_name) or read_part(parts[part_name])
            read[part_name] = part
            if instance_keywords:
                part = replace(part, keywords=(*part.keywords, *instance_keywords))
        placed.append((keyword.needs("NAME"), part, *placement(keyword)))
    placed.append(("", read_part(model), np.eye(3), np.zeros(3)))
    node = element = 0
    for name, part, turn, shift in placed:
        scopes[name.upper()] = Scope(name, part, turn, shift, node, element)
        node, element = node + len(part.nodes.ids), element + len(part.elements.ids)
    return _join_scopes(scopes, tuple(steps))


def _join_scopes(scopes: dict[str, Scope], steps: tuple[Step, ...]) -> Assembly:
    """Merge nodes and elements of all scopes into one table."""
    every = list(scopes.values())
    cells = [(scope, block) for scope in every for block in scope.part.cells]
    notes = [
        f"{block.keyword.where}: data lines of {block.type} have extra nodes and end in a comma, as for "
        f"quadratic elements; the first {int(block.first[1])} nodes are used, as in CalculiX"
        for _, block in cells
        if block.cut
    ]
    offsets = _offsets([scope.part.nodes.ids for scope in every]), _offsets([s.part.elements.ids for s in every])
    for scope, *by in zip(every, *offsets, strict=True):
        if any(by) and scope.part.nodes.ids.size:
            owner = f"instance {scope.name}" if scope.name else "the assembly"
            notes.append(
                f"the node ids of {owner} are increased by {by[0]}, and the element ids by {by[1]}, because several "
                "instances have the same ids"
            )
    assembly = Assembly(
        scopes=scopes,
        node_ids=concatenate(scope.part.nodes.ids + by for scope, by in zip(every, offsets[0], strict=True)),
        position=np.concatenate([scope.part.position @ scope.rotation.T + scope.translation for scope in every]),
        node_where=[at for scope in every for at in scope.part.node_where],
        element_ids=concatenate(scope.part.elements.ids + by for scope, by in zip(every, offsets[1], strict=True)),
        kind=concatenate(
            np.full(len(block.ids), ELEMENTS.index(block.kind) if block.kind else -1) for _, block in cells
        ),
        type=[block.type for _, block in cells for _ in block.ids],
        nodes=concatenate(np.where(block.nodes < 0, -1, block.nodes + scope.first_node) for scope, block in cells),
        first=np.cumsum(concatenate([np.zeros(1, dtype=np.int64), *(np.diff(block.first) for _, block in cells)])),
        element_where=[at for scope in every for at in scope.part.element_where],
        steps=steps,
        notes=notes,
    )
    base = 0
    for scope, block in cells:
        lines = block.keyword.rows() if block.words else []
        for i, word in block.words.items():
            rows = assembly.rows("NODE", word, scope, lines[block.line[np.searchsorted(block.first, i, "right") - 1]])
            assembly.nodes[base + i] = rows[0] if rows.size == 1 else -1
        base += len(block.nodes)
    return assembly


def _offsets(ids: list[IntArray]) -> list[int]:
    """Offset added to the ids of each scope: zero if all ids are distinct, else i·10ᵏ larger than all of them."""
    together = np.concatenate(ids)
    if len(np.unique(together)) == len(together):
        return [0] * len(ids)
    power = 10 ** len(str(int(together.max())))
    return [i * power for i in range(len(ids))]
