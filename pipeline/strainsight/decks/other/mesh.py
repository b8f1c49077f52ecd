"""Solid meshes of any format that meshio reads: VTU, VTK, XDMF, MED, Medit, Netgen and others."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from strainsight.decks.faults import check_elements, check_nodes, plural
from strainsight.decks.other.load import load, load_sandboxed
from strainsight.decks.text import error_at
from strainsight.mesh.assigned_sections import (
    LINE,
    LINE3,
    GivenSection,
    Groups,
    SectionsByGroup,
    regions_with_sections,
    with_given,
)
from strainsight.mesh.kinds import ELEMENTS, FAMILIES
from strainsight.mesh.kinds.kind import ElementKind, in_order
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh, Region
from strainsight.mesh.node_order import left_handed
from strainsight.mesh.thin import concatenate

REGIONS = (
    *("region", "region_id", "gmsh:physical", "medit:ref", "cell_tags", "netgen:index", "tetgen:ref"),
    *("avsucd:material", "su2:tag", "ugrid:ref", "MaterialIds", "MaterialID", "MaterialId", "material_id"),
    *("material", "PartId", "part_id", "PropertyId", "property_id", "ElementBlockIds", "ObjectId"),
)
"""Cell data names that programs use for regions; the first existing one is used."""


class Labels(NamedTuple):
    """Cell data used as regions: name, values (cells,)."""

    name: str
    values: IntArray


def as_integers(values: Any) -> IntArray | None:
    """Values (n,) as integers, one a row; None for other data."""
    array = np.asarray(values)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "biuf":
        return None
    if array.dtype.kind == "f" and not (np.all(np.abs(array) < 2.0**53) and np.all(array == np.floor(array))):
        return None
    return array.astype(np.int64)


def switches(values: Any) -> np.ndarray | None:
    """Rows with value 1, for data that contain only 0 and 1 and at least one 1; None for other data."""
    numbers = as_integers(values)
    if numbers is None or not numbers.any() or not np.all((numbers == 0) | (numbers == 1)):
        return None
    return numbers == 1


def numbers_of(
    data: Mapping[str, Any], names: tuple[str, ...], count: int, what: str, notes: list[str]
) -> tuple[IntArray, str]:
    """Node or element numbers (count,), and the data they come from, "" if the numbers count from 1."""
    for name in (name for name in names if name in data):
        numbers = as_integers(data[name])
        right = numbers is not None and len(numbers) == count and numbers.min(initial=1) > 0
        if numbers is not None and right and len(np.unique(numbers)) == count:
            return numbers, name
        notes.append(f"the array {name} is not used as {what} ids, because its values are not unique positive integers")
    notes.append(f"the file contains no valid {what} ids, so ids from 1 are assigned in the order of the file")
    return np.arange(1, count + 1), ""


def labels(data: Mapping[str, Any], name: str | None, count: int, path: str, notes: list[str]) -> Labels | None:
    """Cell data that define the regions: those of this name, or the first usual ones; None if there are no such data. Raises
    DeckError for a missing name or data that are not integers."""
    candidates = {
        key: numbers
        for key, values in data.items()
        if (numbers := as_integers(values)) is not None and len(numbers) == count
    }
    if name is not None:
        if name not in candidates:
            known = ", ".join(candidates) or "none"
            raise error_at(
                path,
                f"cell data {name!r} are not integers" if name in data else f"cell data {name!r} not found",
                f"set mesh.region_data to cell data of integers (in this file: {known}), or remove the key",
            )
        return Labels(name, candidates[name])
    for usual in REGIONS:
        if usual in candidates:
            notes.append(f"regions are defined by the cell data {usual}")
            return Labels(usual, candidates[usual])
    others = ", ".join(candidates)
    notes.append(
        "no cell data define regions, so all elements are in region 1 (solids)"
        + (f"; possible values of mesh.region_data: {others}" if others else "")
    )
    return None


THIN = {"quad": "quad4", "triangle": "tri3", "quad8": "quad8", "triangle6": "tri6", "line": LINE, "line3": LINE3}
"""Cell types that may have a section."""


KINDS = {cell: kind for kind in ELEMENTS for cell in kind.meshio}
WIDTH = {"quad": 4, "triangle": 3, "quad8": 8, "triangle6": 6, "line": 2, "line3": 3}
NODE_IDS = ("node_id", "node_ids", "GlobalNodeId", "GlobalNodeIds", "GlobalPointIds", "PointIds", "ids")
ELEMENT_IDS = ("element_id", "element_ids", "GlobalElementId", "GlobalElementIds", "GlobalCellIds", "CellIds", "ids")
TURNED = "med"
"""MED uses the opposite node orientation in every solid ("Connectivity conventions of nodes of elements", Salome SMESH)."""


class Cells:
    """Cells of some blocks of the meshio mesh: rows[b] are those of block b; data by name; ids (cells,); tags:
    region data, or None; names: dimension → region → names; used_data: data of ids and regions."""

    def __init__(self, raw: Any, blocks: list[int], region_data: str | None, path: str, notes: list[str]):
        self.raw, self.path = raw, path
        *starts, total = np.cumsum([0, *(len(raw.cells[b].data) for b in blocks)]).tolist()
        self.rows = {b: slice(i, i + len(raw.cells[b].data)) for b, i in zip(blocks, starts, strict=True)}
        self.data = {
            name: np.concatenate([np.asarray(values[b]) for b in blocks])
            for name, values in raw.cell_data.items()
            if len({np.shape(values[b])[1:] for b in blocks}) == 1 and all(values[b] is not None for b in blocks)
        }
        self.ids, numbers = numbers_of(self.data, ELEMENT_IDS, total, "element", notes)
        self.tags = labels(self.data, region_data, total, path, notes)
        self.names = {dimension: tag_names(raw, dimension) for dimension in range(4)}
        self.used_data = {numbers, self.tags.name if self.tags else ""}

    def region_name(self, dimension: int, tag: int) -> str:
        """Name of a region."""
        return ", ".join(self.names[dimension].get(tag, ())) or f"region {tag}"

    def groups(self) -> Groups:
        """Regions of the cells by dimension."""
        groups: dict[int, dict[int | None, str]] = {}
        for b, rows in self.rows.items():
            dimension = self.raw.cells[b].dim
            groups_of_dimension = groups.setdefault(dimension, {})
            if self.tags is None:
                groups_of_dimension[None] = {1: "beams", 2: "shells", 3: "solids"}[dimension]
            else:
                groups_of_dimension |= {
                    tag: self.region_name(dimension, tag) for tag in np.unique(self.tags.values[rows]).tolist()
                }
        return groups

    def solids(self, of: list[int], form: str, position: FloatArray, notes: list[str]) -> tuple[CellBlock, ...]:
        """Solid cells of the blocks `of` by kind; form: format name of meshio."""
        region = self.tags.values if self.tags else np.ones(len(self.ids), dtype=np.int64)
        parts: dict[str, list[CellBlock]] = {kind.name: [] for kind in ELEMENTS}
        for b in of:
            block, rows, kind = self.raw.cells[b], self.rows[b], KINDS[self.raw.cells[b].type]
            nodes = in_order(np.asarray(block.data, np.int64), kind.meshio[block.type])
            nodes = in_our_order(kind, nodes, form, position, notes)
            parts[kind.name].append(CellBlock(kind.name, self.ids[rows], nodes, region[rows]))
        return tuple(CellBlock.joined(blocks) for blocks in parts.values() if blocks)

    def thin(self, of: list[int], chosen: SectionsByGroup) -> Iterator[CellBlock]:
        """Cells of the blocks `of` whose regions have a section. Raises DeckError for unsupported cell types."""
        cells, known = self.raw.cells, list(THIN)
        for b in sorted(of, key=lambda b: known.index(cells[b].type) if cells[b].type in THIN else -1):
            block, rows = cells[b], self.rows[b]
            region = np.full(len(block.data), -1)
            inside = np.zeros(len(block.data), dtype=bool)
            for (dimension, tag), (region_, _) in chosen.items():
                if dimension == block.dim:
                    tags = None if tag is None else self.tags
                    here = np.ones(len(region), dtype=bool) if tags is None else tags.values[rows] == tag
                    region[here], inside = region_.id, inside | here
            if not inside.any():
                continue
            if block.type not in THIN:
                raise error_at(
                    self.path,
                    f"a region of mesh.sections has cells of type {block.type}, which cannot have a section",
                    f"mesh the regions of mesh.sections with {', '.join(THIN)}",
                )
            nodes = np.asarray(block.data, np.int64)[inside]
            yield CellBlock(THIN[block.type], self.ids[rows][inside], nodes, region[inside].astype(np.int64))

    def sets(
        self, elements: np.ndarray, node_ids: IntArray, ignored: Counter[str]
    ) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
        """Node sets and element sets; elements (cells,): cells used as elements. Other cells define node sets if
        they have a name."""
        raw, used_data = self.raw, set(self.used_data)
        points: defaultdict[str, list[IntArray]] = defaultdict(list)
        members: defaultdict[str, list[IntArray]] = defaultdict(list)
        for name, rows in (raw.point_sets or {}).items():
            points[name].append(np.asarray(rows, dtype=np.int64).ravel())
        for tag, family in (getattr(raw, "point_tags", None) or {}).items():
            for name in family:
                points[name].append(np.flatnonzero(np.asarray(raw.point_data["point_tags"]) == tag))
                used_data.add("point_tags")
        for b, block in enumerate(raw.cells):
            cell_rows, named = self.rows.get(b), list(self._named(b))
            for name, rows in named:
                points[name].append(np.unique(np.asarray(block.data)[rows]))
                if cell_rows is not None:
                    members[name].append(self.ids[cell_rows][rows[elements[cell_rows][rows]]])
            left = len(block.data) - (0 if cell_rows is None else int(np.count_nonzero(elements[cell_rows])))
            if left and not named:
                ignored[f"{block.type} cells"] += left
        for name, values in raw.point_data.items():
            if name not in used_data and (on := switches(values)) is not None:
                points[name].append(np.flatnonzero(on))
            elif name not in used_data:
                ignored[f"point data {name}"] += 1
        for name in (name for name in raw.cell_data if name not in used_data):
            if name in self.data and (on := switches(self.data[name])) is not None:
                members[name].append(self.ids[on & elements])
            else:
                ignored[f"cell data {name}"] += 1
        return (
            {name: np.unique(node_ids[np.concatenate(rows)]) for name, rows in points.items()},
            {name: np.unique(np.concatenate(ids)) for name, ids in members.items() if any(map(len, ids))},
        )

    def _named(self, b: int) -> Iterator[tuple[str, IntArray]]:
        """Name → rows of block b that belong to it, from cell sets and named tags."""
        for name, per_block in (self.raw.cell_sets or {}).items():
            if b < len(per_block) and per_block[b] is not None and len(per_block[b]):
                yield name, np.asarray(per_block[b], dtype=np.int64)
        if self.tags:
            values = np.asarray(self.raw.cell_data[self.tags.name][b]).ravel()
            for tag, names in self.names[self.raw.cells[b].dim].items():
                if (rows := np.flatnonzero(values == tag)).size:
                    yield from ((name, rows) for name in names)


def read_meshio(
    path: Path,
    region_data: str | None = None,
    *,
    required: bool = True,
    sections: Mapping[str, GivenSection] | None = None,
    sandboxed: bool = True,
) -> Mesh:
    """Read a mesh of a meshio format in its own units; such files have no materials and no supports.

    Node and element numbers come from point and cell data (node_id, GlobalNodeId, … element_id, …) if these are
    positive and unique, else they count from 1. Regions are the cell data `region_data`, or the first usual ones
    (region, gmsh:physical, MaterialIds, …). Sets are those of the file, and data that contain only 0 and 1. required:
    require solids if there are no sections; sections: config key → section of regions of triangles, quadrilaterals and
    lines, in the units of the file; sandboxed: run meshio in a child process. Raises DeckError for files that cannot
    be read or imported, and UserError for a missing region of a section."""
    path, sections = Path(path), sections or {}
    loaded = load_sandboxed(path) if sandboxed else load(path)
    raw = loaded.mesh
    ignored: Counter[str] = Counter()
    notes = [f"meshio reports: {loaded.notes[:500]}"] if loaded.notes else []
    solids, wanted = (
        _solids(raw, str(path), required and not sections),
        {section.dimension for section in sections.values()},
    )
    thin = [b for b, block in enumerate(raw.cells) if block.dim in wanted and len(block.data)]
    position = _position(raw, str(path), notes)
    _check_cells(raw, [*solids, *(b for b in thin if raw.cells[b].type in THIN)], len(position), str(path))
    node_ids, numbers = numbers_of(raw.point_data, NODE_IDS, len(position), "node", notes)
    check_nodes(node_ids, position, lambda *_: str(path))
    cells = Cells(raw, sorted([*solids, *thin]), region_data, str(path), notes)
    cells.used_data.add(numbers)
    blocks = cells.solids(solids, loaded.format, position, notes)
    tags = (
        np.unique(concatenate(block.region for block in blocks)).tolist() if blocks or cells.tags or sections else [1]
    )
    regions = {tag: Region(tag, cells.region_name(3, tag) if cells.tags else "solids", 0) for tag in tags}
    chosen = regions_with_sections(cells.groups(), sections, regions, notes)
    shells = list(cells.thin(thin, chosen))
    check_elements([*blocks, *shells], lambda *_: str(path))
    used = np.isin(cells.ids, concatenate(block.ids for block in (*blocks, *shells)))
    node_sets, element_sets = cells.sets(used, node_ids, ignored)
    mesh = Mesh(
        node_ids=node_ids,
        position=position,
        blocks=blocks,
        regions=regions | {region_.id: region_ for region_, _ in chosen.values()},
        node_sets=node_sets,
        element_sets=element_sets,
        ignored=dict(sorted(ignored.items())),
        notes=tuple(notes),
        source=str(path),
        included=loaded.included,
    )
    return with_given(mesh, shells, chosen)


def _position(raw: Any, path: str, notes: list[str]) -> FloatArray:
    points = np.asarray(raw.points)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise error_at(
            path,
            f"the points have {points.shape[-1] if points.ndim else 0} coordinates instead of 3",
            "export the mesh with three coordinates per point",
        )
    if points.dtype == np.float32:
        notes.append(
            "coordinates in the file have single precision (7 digits): export them in double precision, if the format allows it"
        )
    return np.ascontiguousarray(points, dtype=np.float64)


def _solids(raw: Any, path: str, required: bool) -> list[int]:
    """Indices of cell blocks with supported solids."""
    supported = []
    for i, block in enumerate(raw.cells):
        if block.dim == 3 and block.type not in KINDS and len(block.data):
            raise error_at(
                path,
                f"the cell type {block.type} is not supported ({plural(len(block.data), 'cell')})",
                f"mesh with {FAMILIES} ({', '.join(KINDS)})",
            )
        if block.type in KINDS and len(block.data):
            supported.append(i)
    if not supported and required:
        shown = ", ".join(plural(len(block.data), block.type + " cell") for block in raw.cells) or "no cells"
        what = f"the mesh contains no solid elements ({shown})"
        raise error_at(path, what, "mesh in three dimensions, or specify sections of shells and beams in mesh.sections")
    return supported


def _check_cells(raw: Any, blocks: list[int], points: int, path: str) -> None:
    remedy = "the file is damaged: export the mesh again"
    for b in blocks:
        kind, nodes = raw.cells[b].type, np.asarray(raw.cells[b].data)
        width = len(KINDS[kind].nodes) if kind in KINDS else WIDTH[kind]
        if nodes.ndim != 2 or nodes.shape[1] != width or nodes.dtype.kind not in "iu":
            raise error_at(path, f"the {kind} cells do not have {width} nodes each", remedy)
        if (wrong := nodes[(nodes < 0) | (nodes >= points)]).size:
            what = f"a {kind} cell refers to point {wrong[0]} (counted from 0), but the mesh has only {plural(points, 'point')}"
            raise error_at(path, what, remedy)


def in_our_order(kind: ElementKind, nodes: IntArray, form: str, position: FloatArray, notes: list[str]) -> IntArray:
    """Convert cells (n, k) from the order of meshio for a format to our order. If all cells are then inverted, and both
    orientations are in use for this kind (wedges; all cells in MED), their order is mirrored, with a note."""
    nodes = in_order(nodes, kind.orders.get(form, kind.mirrored if form == TURNED else ()))
    if (form == TURNED or kind.either_way) and left_handed(kind, nodes, position).all():
        nodes = in_order(nodes, kind.mirrored)
        notes.append(
            f"{kind.name} elements had a left-handed node order in the file (format {form}); the node order is corrected"
        )
    return nodes


def tag_names(raw: Any, dimension: int) -> dict[int, list[str]]:
    """Tag → names on cells of this dimension, from field data (name → (tag, dimension)) and MED families."""
    names: dict[int, list[str]] = {}
    for name, value in (raw.field_data or {}).items():
        pair = np.asarray(value).ravel() if not isinstance(value, list) else np.zeros(0)
        if pair.size == 2 and pair.dtype.kind in "iu" and pair[1] == dimension:
            names.setdefault(int(pair[0]), []).append(str(name))
    for tag, family in (getattr(raw, "cell_tags", None) or {}).items():
        names.setdefault(int(tag), []).extend(family)
    return names
