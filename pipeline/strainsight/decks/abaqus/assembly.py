"""Parts placed as instances, and their ids made distinct."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.abaqus.parts import Part, kind_index, read_part
from strainsight.decks.abaqus.scopes import MESH, Assembly, Scope, Step, placement, read_structure
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.mesh.model import FloatArray, IntArray


def assemble(keywords: list[Keyword]) -> Assembly:
    """The parts of a deck in their places.

        x = a + R (x' + t − a)

    with the translation t and the rotation R about the axis from a to b of each instance. A deck without parts is one
    scope. Where ids of instances clash, instance i gets i·10ᵏ on top of its own, k so that they cannot meet.
    Raises DeckError for parts and steps that do not end, and for instances of parts that are not there.
    """
    model, parts, instances, steps = read_structure(keywords)
    scopes: dict[str, Scope] = {}
    read: dict[str, Part] = {}
    placed: list[tuple[str, Part, FloatArray, FloatArray]] = []
    for keyword, own in instances:
        part_name = keyword.needs("PART").upper()
        if part_name not in parts:
            raise keyword.error(
                f"part {keyword.parameters['PART']!r} is not in the deck", "correct the name of the part"
            )
        if any(k.name in MESH for k in own):
            part = read_part((*parts[part_name], *own))
        else:
            part = read.get(part_name) or read_part(parts[part_name])
            read[part_name] = part
            if own:
                part = replace(part, keywords=(*part.keywords, *own))
        placed.append((keyword.needs("NAME"), part, *placement(keyword)))
    placed.append(("", read_part(model), np.eye(3), np.zeros(3)))
    node = element = 0
    for name, part, rotation, translation in placed:
        scopes[name.upper()] = Scope(name, part, rotation, translation, node, element)
        node, element = node + len(part.nodes.ids), element + len(part.elements.ids)
    return _joined(scopes, model, tuple(steps))


def _joined(scopes: dict[str, Scope], model: tuple[Keyword, ...], steps: tuple[Step, ...]) -> Assembly:
    """Nodes and elements of all scopes in one table."""
    notes: list[str] = []
    node_offset = _offsets([scope.part.nodes.ids for scope in scopes.values()])
    element_offset = _offsets([scope.part.elements.ids for scope in scopes.values()])
    empty = np.zeros(0, dtype=np.int64)
    node_ids, position, element_ids, kind, nodes, count = (
        [empty],
        [np.zeros((0, 3))],
        [empty],
        [empty],
        [empty],
        [empty],
    )
    node_where: list[tuple[str, int]] = []
    element_where: list[tuple[str, int]] = []
    type_: list[str] = []
    words: list[tuple[int, str, Scope, Row]] = []
    members = 0
    for scope, by_node, by_element in zip(scopes.values(), node_offset, element_offset, strict=True):
        part = scope.part
        node_ids.append(part.nodes.ids + by_node)
        position.append(part.position @ scope.rotation.T + scope.translation)
        node_where += part.node_where
        element_ids.append(part.elements.ids + by_element)
        for cells in part.cells:
            base, lines = members, cells.keyword.rows() if cells.words else []
            for i, word in cells.words.items():
                line = lines[cells.line[np.searchsorted(cells.first, i, "right") - 1]]
                words.append((base + i, word, scope, line))
            if cells.cut:
                notes.append(
                    f"{cells.keyword.where}: lines of {cells.type} hold more nodes and end in a comma, as those of quadratic "
                    f"elements do: the first {int(cells.first[1])} count, as in CalculiX"
                )
            members += len(cells.nodes)
            nodes.append(np.where(cells.nodes < 0, -1, cells.nodes + scope.first_node))
            count.append(np.diff(cells.first))
            kind.append(np.full(len(cells.ids), kind_index(cells.kind)))
            type_ += [cells.type] * len(cells.ids)
            element_where += [(cells.keyword.files[i], cells.keyword.numbers[i]) for i in cells.line.tolist()]
        if by_node or by_element:
            owner = f"instance {scope.name}" if scope.name else "the assembly's own"
            shifts = [f"{what} ids + {by}" for what, by in (("node", by_node), ("element", by_element)) if by]
            if part.nodes.ids.size:
                notes.append(f"{owner}: {', '.join(shifts)}, as several instances have the same ids")
    assembly = Assembly(
        scopes=scopes,
        node_ids=np.concatenate(node_ids),
        position=np.concatenate(position),
        node_where=node_where,
        element_ids=np.concatenate(element_ids),
        kind=np.concatenate(kind),
        type=type_,
        nodes=np.concatenate(nodes),
        first=np.concatenate([[0], np.cumsum(np.concatenate(count))]).astype(np.int64),
        element_where=element_where,
        model=model,
        steps=steps,
        notes=notes,
    )
    for i, word, scope, row in words:
        rows = assembly.node_rows(word, scope, row)
        assembly.nodes[i] = rows[0] if rows.size == 1 else -1
    return assembly


def _offsets(ids: list[IntArray]) -> list[int]:
    """What each scope adds to its ids: nothing where all are distinct, else i·10ᵏ beyond all of them."""
    together = np.concatenate(ids)
    if len(np.unique(together)) == len(together):
        return [0] * len(ids)
    power = 10 ** len(str(int(together.max())))
    return [i * power for i in range(len(ids))]
