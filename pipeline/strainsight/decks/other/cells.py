"""Cells of meshes that meshio reads: data on them, and those that become shells and beams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from strainsight.decks.faults import plural
from strainsight.decks.other.arrays import Labels
from strainsight.decks.thin import Chosen, Groups
from strainsight.errors import DeckError
from strainsight.mesh.given_sections import LINE, LINE3, GivenSection
from strainsight.mesh.model import CellBlock, IntArray

THIN = {"quad": "quad4", "triangle": "tri3", "quad8": "quad8", "triangle6": "tri6", "line": LINE, "line3": LINE3}
"""Types of cells that may have a section."""


class CellData:
    """Cell data of some blocks, one after the other; rows[b] are those of block b among them."""

    def __init__(self, raw: Any, blocks: list[int]):
        sizes = [len(raw.cells[b].data) for b in blocks]
        ends = np.cumsum([0, *sizes])
        self.total = int(ends[-1])
        self.rows = {b: slice(int(ends[i]), int(ends[i + 1])) for i, b in enumerate(blocks)}
        self.data = {
            name: np.concatenate([np.asarray(values[b]) for b in blocks])
            for name, values in raw.cell_data.items()
            if len({np.shape(values[b])[1:] for b in blocks}) == 1 and all(values[b] is not None for b in blocks)
        }


def with_sections(raw: Any, given: Mapping[str, GivenSection]) -> list[int]:
    """Which blocks of cells may have one of these sections, by their dimension."""
    wanted = {own.dimension for own in given.values()}
    return [b for b, block in enumerate(raw.cells) if block.dim in wanted and len(block.data)]


def groups_of(raw: Any, cells: CellData, tags: Labels | None, names: Mapping[int, Mapping[int, list[str]]]) -> Groups:
    """Regions of the cells by their dimension; names: dimension → region → its names."""
    groups: dict[int, dict[int | None, str]] = {}
    for b, rows in cells.rows.items():
        dimension = raw.cells[b].dim
        own = groups.setdefault(dimension, {})
        if tags is None:
            own[None] = {1: "beams", 2: "shells", 3: "solids"}[dimension]
        else:
            for tag in np.unique(tags.values[rows]).tolist():
                own[tag] = ", ".join(names[dimension].get(tag, ())) or f"region {tag}"
    return groups


def thin_cells(
    raw: Any, thin: list[int], cells: CellData, ids: IntArray, tags: Labels | None, chosen: Chosen, path: str
) -> Iterator[CellBlock]:
    """Cells of the blocks `thin` whose regions have a section. Raises DeckError for others."""
    for b in sorted(thin, key=lambda b: list(THIN).index(raw.cells[b].type) if raw.cells[b].type in THIN else -1):
        block, rows = raw.cells[b], cells.rows[b]
        region = np.full(len(block.data), -1)
        inside = np.zeros(len(block.data), dtype=bool)
        for (dimension, tag), (own, _) in chosen.items():
            if dimension == block.dim:
                here = np.ones(len(region), dtype=bool) if tag is None or tags is None else tags.values[rows] == tag
                region[here], inside = own.id, inside | here
        if not inside.any():
            continue
        if block.type not in THIN:
            raise DeckError(
                f"{plural(int(inside.sum()), block.type + ' cell')} in regions with a section are not supported",
                where=path,
                remedy=f"mesh with {', '.join(THIN)}",
            )
        nodes = np.asarray(block.data, np.int64)[inside]
        yield CellBlock(THIN[block.type], ids[rows][inside], nodes, region[inside].astype(np.int64))
