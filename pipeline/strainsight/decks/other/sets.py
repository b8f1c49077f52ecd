"""Sets of meshes that meshio reads."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from strainsight.decks.other.arrays import Labels, switches
from strainsight.decks.other.cells import CellData
from strainsight.mesh.model import IntArray


def tag_names(raw: Any, dimension: int) -> dict[int, list[str]]:
    """Tag → names of it on cells of this dimension: field data name → (tag, dimension), and the families of MED."""
    names: dict[int, list[str]] = {}
    for name, value in (raw.field_data or {}).items():
        pair = np.asarray(value).ravel() if not isinstance(value, list) else np.zeros(0)
        if pair.size == 2 and pair.dtype.kind in "iu" and pair[1] == dimension:
            names.setdefault(int(pair[0]), []).append(str(name))
    for tag, family in (getattr(raw, "cell_tags", None) or {}).items():
        names.setdefault(int(tag), []).extend(family)
    return names


def sets_of(
    raw: Any,
    tags: Labels | None,
    cells: CellData,
    elements: np.ndarray,
    node_ids: IntArray,
    element_ids: IntArray,
    ignored: Counter[str],
    taken: set[str],
) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """Sets of nodes and of elements; elements (cells,): which of the cells are some. The others give sets of nodes where they
    have a name."""
    points: dict[str, list[IntArray]] = {}
    members: dict[str, list[IntArray]] = {}
    for name, rows in (raw.point_sets or {}).items():
        points.setdefault(name, []).append(np.asarray(rows, dtype=np.int64).ravel())
    for tag, family in (getattr(raw, "point_tags", None) or {}).items():
        for name in family:
            points.setdefault(name, []).append(np.flatnonzero(np.asarray(raw.point_data["point_tags"]) == tag))
            taken.add("point_tags")
    for b, block in enumerate(raw.cells):
        named = False
        for name, rows in _named_cells(raw, b, tags):
            named = True
            points.setdefault(name, []).append(np.unique(np.asarray(block.data)[rows]))
            if b in cells.rows:
                own = cells.rows[b]
                members.setdefault(name, []).append(element_ids[own][rows[elements[own][rows]]])
        left = len(block.data) - (int(np.count_nonzero(elements[cells.rows[b]])) if b in cells.rows else 0)
        if left and not named:
            ignored[f"{block.type} cells"] += left
    for name, values in raw.point_data.items():
        if name not in taken:
            if (on := switches(values)) is not None:
                points.setdefault(name, []).append(np.flatnonzero(on))
            else:
                ignored[f"point data {name}"] += 1
    for name in raw.cell_data:
        if name not in taken:
            if name in cells.data and (on := switches(cells.data[name])) is not None:
                members.setdefault(name, []).append(element_ids[on & elements])
            else:
                ignored[f"cell data {name}"] += 1
    return (
        {name: np.unique(node_ids[np.concatenate(rows)]) for name, rows in points.items()},
        {name: np.unique(np.concatenate(ids)) for name, ids in members.items() if any(len(own) for own in ids)},
    )


def _named_cells(raw: Any, b: int, tags: Labels | None) -> list[tuple[str, IntArray]]:
    """Name → rows of block b that belong to it: sets of cells, and tags with names."""
    found = []
    for name, per_block in (raw.cell_sets or {}).items():
        if b < len(per_block) and per_block[b] is not None and len(per_block[b]):
            found.append((name, np.asarray(per_block[b], dtype=np.int64)))
    if tags:
        values = np.asarray(raw.cell_data[tags.name][b]).ravel()
        for tag, names in tag_names(raw, raw.cells[b].dim).items():
            if (rows := np.flatnonzero(values == tag)).size:
                found += [(name, rows) for name in names]
    return found
