"""Elements of a gmsh file by rows of its nodes, each counted once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.faults import IdTable, Where, plural
from strainsight.decks.gmsh.records import TYPES, Chunk
from strainsight.errors import DeckError
from strainsight.mesh.model import IntArray


@dataclass(frozen=True)
class Doubled:
    """Elements written once for each of their physical volumes: those left out → the one that stays."""

    dropped: IntArray
    kept: IntArray


def merged(solids: list[Chunk], version: str) -> tuple[list[Chunk], Doubled]:
    """Format 2 writes an element once for each of its physical groups, under another number: keep the lowest group's."""
    nothing = np.zeros(0, dtype=np.int64)
    tags = {chunk.groups for chunk in solids}
    if not version.startswith("2") or len(tags) < 2:
        return solids, Doubled(nothing, nothing)
    dropped, kept, left = [nothing], [nothing], []
    for number in dict.fromkeys(chunk.type for chunk in solids):
        own = [chunk for chunk in solids if chunk.type == number]
        group = np.concatenate([np.full(len(c.ids), c.groups[0] if c.groups else 0) for c in own])
        ids, nodes = np.concatenate([c.ids for c in own]), np.concatenate([c.nodes for c in own])
        order = np.lexsort((group, *nodes.T))
        again = np.zeros(len(ids), dtype=bool)
        again[1:] = np.all(np.diff(nodes[order], axis=0) == 0, axis=1) & (np.diff(group[order]) > 0)
        first = np.maximum.accumulate(np.where(again, 0, np.arange(len(ids))))
        dropped.append(ids[order][again])
        kept.append(ids[order][first[again]])
        stays = np.ones(len(ids), dtype=bool)
        stays[order[again]] = False
        at = 0
        for chunk in own:
            rows = stays[at : at + len(chunk.ids)]
            at += len(chunk.ids)
            line = None if chunk.line is None else chunk.line[rows]
            left.append(replace(chunk, ids=chunk.ids[rows], nodes=chunk.nodes[rows], line=line))
    return [chunk for chunk in left if len(chunk.ids)], Doubled(np.concatenate(dropped), np.concatenate(kept))


def note_doubled(doubled: Doubled) -> list[str]:
    count = len(doubled.dropped)
    if not count:
        return []
    return [
        f"{plural(count, 'element')} written once more for a further physical volume (element {doubled.dropped[0]} is "
        f"{doubled.kept[0]} again): counted once, in the region of the lowest tag and in all sets"
    ]


def indices(chunk: Chunk, table: IdTable, where: Where) -> IntArray:
    index, missing = table.rows(chunk.nodes)
    if missing.any():
        row, column = np.argwhere(missing)[0]
        element = int(chunk.ids[row])
        raise DeckError(
            f"element {element} ({TYPES[chunk.type].name}) refers to node {chunk.nodes[row, column]}, "
            "which is not in the file",
            where=where("element", element),
            remedy="write the mesh again with all its nodes",
            entity=("element", element),
        )
    return index


def kept_ids(ids: IntArray, doubled: Doubled) -> IntArray:
    rows, absent = IdTable(doubled.dropped).rows(ids)
    return np.where(absent, ids, doubled.kept[rows]) if len(doubled.dropped) else ids
