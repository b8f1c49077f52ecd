"""Gmsh meshes with their node and element numbers; physical groups are regions and sets."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strainsight.decks.faults import check_elements, check_nodes, entity_error, plural
from strainsight.decks.gmsh.records import KINDS, TYPES, Chunk, NodeRows, remedy
from strainsight.decks.gmsh.sections import GmshFile, GmshReader
from strainsight.decks.text import error_at
from strainsight.errors import DeckError
from strainsight.mesh.assigned_sections import (
    LINE,
    LINE3,
    SHELLS,
    GivenSection,
    SectionsByGroup,
    regions_with_sections,
    with_given,
)
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.kinds.kind import Order, in_order
from strainsight.mesh.model import CellBlock, IdTable, IntArray, Mesh, Origin, Region
from strainsight.mesh.thin import concatenate


@dataclass(frozen=True)
class Doubled:
    """Elements that are written once for each physical volume: dropped (k,) ids and remaining (k,) ids of the same elements."""

    dropped: IntArray
    remaining: IntArray


def merge_doubled(solids: list[Chunk], version: str) -> tuple[list[Chunk], Doubled]:
    """Format 2 writes an element once for each of its physical groups, with a new number; keep only that of the lowest group."""
    nothing = np.zeros(0, dtype=np.int64)
    if not version.startswith("2") or len({chunk.groups for chunk in solids}) < 2:
        return solids, Doubled(nothing, nothing)
    dropped, remaining, left = [nothing], [nothing], []
    for number in dict.fromkeys(chunk.type for chunk in solids):
        chunks_of_type = [chunk for chunk in solids if chunk.type == number]
        group = np.concatenate([np.full(len(c.ids), c.groups[0] if c.groups else 0) for c in chunks_of_type])
        ids, nodes = np.concatenate([c.ids for c in chunks_of_type]), np.concatenate([c.nodes for c in chunks_of_type])
        order = np.lexsort((group, *nodes.T))
        again = np.zeros(len(ids), dtype=bool)
        again[1:] = np.all(np.diff(nodes[order], axis=0) == 0, axis=1) & (np.diff(group[order]) > 0)
        first = np.maximum.accumulate(np.where(again, 0, np.arange(len(ids))))
        dropped.append(ids[order][again])
        remaining.append(ids[order][first[again]])
        stays = np.ones(len(ids), dtype=bool)
        stays[order[again]] = False
        at = 0
        for chunk in chunks_of_type:
            rows = stays[at : at + len(chunk.ids)]
            at += len(chunk.ids)
            line = None if chunk.line is None else chunk.line[rows]
            left.append(replace(chunk, ids=chunk.ids[rows], nodes=chunk.nodes[rows], line=line))
    return [chunk for chunk in left if len(chunk.ids)], Doubled(np.concatenate(dropped), np.concatenate(remaining))


def note_doubled(doubled: Doubled) -> list[str]:
    if not (count := len(doubled.dropped)):
        return []
    return [
        f"the file repeats elements ({count} in total; element {doubled.dropped[0]} repeats element {doubled.remaining[0]}), "
        "because geometric volumes belong to several physical volumes. Each element is imported once: in the region of the "
        "physical volume with the lowest tag, and in the element sets of all its physical volumes"
    ]


def block_of(file: GmshFile, chunk: Chunk, kind: str, order: Order, region: int) -> CellBlock:
    """Elements of a chunk with the rows of their nodes. Raises DeckError for a node that is not in the file."""
    rows, missing = file.table.rows(chunk.nodes)
    if missing.any():
        row, column = np.argwhere(missing)[0]
        element = int(chunk.ids[row])
        what = f"element {element} ({chunk.kind.name}) refers to the missing node {chunk.nodes[row, column]}"
        raise entity_error("element", element, what, "export the mesh again with all its nodes", file.where)
    return CellBlock(kind, chunk.ids, in_order(rows, order), np.full(len(chunk.ids), region))


THIN_KINDS = {3: "quad4", 2: "tri3", 16: "quad8", 9: "tri6", 1: LINE, 8: LINE3}
"""Element types that may have a section."""
NINE = 10
"""Type of the 9-node quadrilateral, the default of second order."""
GROUP = {1: "line", 2: "surface", 3: "volume"}


@dataclass(frozen=True)
class Thin:
    """Elements with sections: as in the file, as cells, their regions; elements that are written twice."""

    chunks: list[Chunk]
    cells: tuple[CellBlock, ...]
    chosen: SectionsByGroup
    doubled: Doubled


def thin_cells(
    file: GmshFile, sections: Mapping[str, GivenSection], solids: Mapping[int, Region], notes: list[str]
) -> Thin:
    """Elements of the physical groups that have a section; solids: regions of the volumes. Raises UserError for a missing group,
    DeckError for elements of higher order, and for an element with two different sections."""
    chosen = regions_with_sections(_groups(file), sections, solids, notes)
    chunks = []
    for chunk in file.elements:
        dimension = chunk.kind.dimension
        section_tags: list[int | None] = [tag for tag in chunk.groups or (None,) if (dimension, tag) in chosen]
        if not section_tags or not len(chunk.ids):
            continue
        if chunk.type not in THIN_KINDS:
            element, names = int(chunk.ids[0]), ", ".join(TYPES[number].name + "s" for number in THIN_KINDS)
            what = (
                f"element {element} is a {chunk.kind.name}, but elements with a section (mesh.sections: "
                f"{chosen[dimension, section_tags[0]][0]}) can only be {names}"
            )
            incomplete = "set Mesh.SecondOrderIncomplete = 1 before meshing"
            lower = "set Mesh.ElementOrder = 2 (or 1) before meshing"
            remedy = incomplete if chunk.type == NINE else lower
            raise entity_error("element", element, what, remedy, file.where)
        chunks.append(replace(chunk, groups=tuple(sorted(tag for tag in section_tags if tag is not None))))
    left, doubled = merge_doubled(chunks, file.version)
    several = [(int(chunk.ids[0]), chunk.kind.dimension, chunk.groups) for chunk in left if len(chunk.groups) > 1]
    several += _written_twice(chunks, doubled)
    for element, dimension, tags in several:
        (first, section), *others = (chosen[dimension, tag] for tag in tags)
        if other := next((region for region, another in others if another is not section), None):
            what = f"element {element} is in {first} and in {other}, which have different sections"
            remedy = (
                "assign a section to only one of the two physical groups (mesh.sections), or define disjoint groups"
            )
            raise entity_error("element", element, what, remedy, file.where)
    if several:
        notes.append(
            f"elements in several physical groups with a section (for example element {several[0][0]}) belong to the region of "
            "the group with the lowest tag"
        )
    cells = []
    for number, kind in THIN_KINDS.items():
        regions = {
            tag: region.id for (dimension, tag), (region, _) in chosen.items() if dimension == TYPES[number].dimension
        }
        own_kind = [chunk for chunk in left if chunk.type == number]
        blocks = [block_of(file, c, kind, (), regions[c.groups[0] if c.groups else None]) for c in own_kind]
        cells += [CellBlock.joined(blocks)] if blocks else []
    return Thin(left, tuple(cells), chosen, doubled)


def _groups(file: GmshFile) -> dict[int, dict[int | None, str]]:
    """Names of the physical groups with elements, by dimension; None: elements in no group."""
    groups: dict[int, dict[int | None, str]] = {}
    for chunk in file.elements:
        dimension = chunk.kind.dimension
        if dimension and len(chunk.ids):
            for tag in chunk.groups or (None,):
                word = GROUP[dimension]
                name = f"no physical {word}" if tag is None else file.names.get((dimension, tag)) or f"{word} {tag}"
                groups.setdefault(dimension, {})[tag] = name
    return groups


def _written_twice(chunks: list[Chunk], doubled: Doubled) -> Iterator[tuple[int, int, tuple[int, ...]]]:
    """Elements that format 2 writes once for each group, their dimension and the tags."""
    wanted = {*doubled.dropped.tolist(), *doubled.remaining.tolist()}
    of = {i: chunk for chunk in chunks for i in chunk.ids.tolist() if i in wanted}
    for dropped, remaining in zip(doubled.dropped.tolist(), doubled.remaining.tolist(), strict=True):
        yield remaining, of[remaining].kind.dimension, (of[remaining].groups[0], of[dropped].groups[0])


def read_gmsh(path: Path, *, required: bool = True, sections: Mapping[str, GivenSection] | None = None) -> Mesh:
    """Read a gmsh mesh (formats 2.0 to 2.2, 4.0, 4.1, text or binary) with its units and numbers.

    Regions are the physical volumes, by tag, and the surfaces and lines with a section. Every physical group is a node set, a
    region also an element set, by name or as "2d-5" (dimension, tag). The format has no materials and no supports. required:
    require solids if there are no sections; sections: config key → section of physical surfaces and lines, in the units of the
    file. Raises DeckError for unsupported input, with file:line in text files, and UserError for a missing region of a section.
    """
    path = Path(path)
    file = GmshReader(path).read()
    if file.skipped["$PartitionedEntities"]:
        raise error_at(
            path,
            "the mesh is partitioned: its physical groups belong to the partitions",
            "save the mesh without partitions (in gmsh: Modules, Mesh, Unpartition)",
        )
    nodes, sections = file.nodes, sections or {}
    solids = [chunk for chunk in file.elements if chunk.kind.dimension == 3 and len(chunk.ids)]
    check_nodes(nodes.ids, nodes.position, file.where)
    _check_types(solids, file, required and not sections)
    solids, doubled = merge_doubled(solids, file.version)
    blocks, regions, notes = _blocks(solids, file)
    thin = thin_cells(file, sections, regions, notes)
    check_elements([*blocks, *thin.cells], file.where)
    node_sets, element_sets, more = _sets(file, thin, doubled)
    mesh = Mesh(
        node_ids=nodes.ids,
        position=np.ascontiguousarray(nodes.position),
        blocks=blocks,
        regions=regions | {region.id: region for region, _ in thin.chosen.values()},
        node_sets=node_sets,
        element_sets=element_sets,
        ignored=dict(sorted(file.skipped.items())),
        read={kind.name: sum(len(c.ids) for c in solids if c.type == kind.gmsh) for kind in ELEMENTS},
        notes=(*note_doubled(doubled), *notes, *more),
        source=str(path),
        origin=_origin(str(path), nodes, [*solids, *thin.chunks]),
    )
    return with_given(mesh, thin.cells, thin.chosen)


def _check_types(solids: list[Chunk], file: GmshFile, required: bool) -> None:
    """Raise DeckError for unsupported solids, and for missing solids if they are required."""
    if not solids and required:
        counts: Counter[str] = Counter()
        for chunk in file.elements:
            counts[chunk.kind.name] += len(chunk.ids)
        shown = ", ".join(plural(count, name) for name, count in counts.items()) or "no elements"
        raise DeckError(
            f"the mesh contains no solid elements ({shown})",
            where=file.path,
            remedy="Mesh in three dimensions (gmsh -3), and put every volume in a physical group or set Mesh.SaveAll = 1. "
            f"{SHELLS}",
        )
    for chunk in solids:
        if chunk.type not in KINDS:
            name, count = chunk.kind.name, sum(len(c.ids) for c in solids if c.type == chunk.type)
            element = int(chunk.ids[0])
            what = f"element {element} is a {name}, which is not supported ({count} in the file)"
            raise entity_error("element", element, what, remedy(chunk.type), file.where)


def _blocks(solids: list[Chunk], file: GmshFile) -> tuple[tuple[CellBlock, ...], dict[int, Region], list[str]]:
    """Blocks of one kind each, and their physical volumes as regions."""
    tags = sorted({tag for chunk in solids for tag in chunk.groups})
    regions = {tag: Region(tag, file.names.get((3, tag)) or f"volume {tag}", 0) for tag in tags}
    notes = []
    outside = sum(len(chunk.ids) for chunk in solids if not chunk.groups)
    spare = tags[-1] + 1 if tags else 1
    if outside and tags:
        regions[spare] = Region(spare, "no physical volume", 0)
        notes.append(f"elements in no physical volume ({outside} in total) are assigned to region {spare}")
    elif outside:
        regions[spare] = Region(spare, "solids", 0)
        notes.append("the file has no physical volumes; all elements are in region 1 (solids)")
    if several := [chunk for chunk in solids if len(chunk.groups) > 1]:
        count, both = sum(len(chunk.ids) for chunk in several), ", ".join(map(str, sorted(several[0].groups)))
        notes.append(
            f"elements in several physical volumes ({count} in total, for example in the volumes {both}) belong to the "
            "region of the volume with the lowest tag"
        )
    blocks = []
    for kind in ELEMENTS:
        if not (chunks_of_kind := [chunk for chunk in solids if chunk.type == kind.gmsh]):
            continue
        parts = [block_of(file, c, kind.name, kind.gmsh_order, min(c.groups, default=spare)) for c in chunks_of_kind]
        blocks.append(CellBlock.joined(parts))
    used = {int(tag) for block in blocks for tag in np.unique(block.region)}
    return tuple(blocks), {tag: region for tag, region in regions.items() if tag in used}, notes


def _sets(file: GmshFile, thin: Thin, doubled: Doubled) -> tuple[dict[str, IntArray], dict[str, IntArray], list[str]]:
    """Node set of every physical group, element set of every region, and notes on their names."""
    members: defaultdict[tuple[int, int], list[Chunk]] = defaultdict(list)
    for chunk in file.elements:
        if len(chunk.ids) and chunk.type not in KINDS:
            block_of(file, chunk, "", (), 0)  # checks that all its nodes exist
        for tag in chunk.groups:
            members[chunk.kind.dimension, tag].append(chunk)
    names, notes = _set_names(members, file.names)
    node_sets: dict[str, IntArray] = {}
    element_sets: dict[str, IntArray] = {}
    for (dimension, tag), chunks in sorted(members.items()):
        name = names[dimension, tag]
        numbers = np.unique(np.concatenate([chunk.nodes.ravel() for chunk in chunks]))
        node_sets[name] = np.union1d(node_sets.get(name, numbers), numbers)
        if dimension == 3 or (dimension, tag) in thin.chosen:
            twice = doubled if dimension == 3 else thin.doubled
            ids = np.concatenate([chunk.ids for chunk in chunks])
            if len(twice.dropped):
                rows, absent = IdTable(twice.dropped).rows(ids)
                ids = np.where(absent, ids, twice.remaining[rows])
            element_sets[name] = np.union1d(element_sets.get(name, ids), ids)
    empty = [name for key, name in file.names.items() if key not in members]
    notes += [f"physical group {name!r} has no elements" for name in empty]
    return node_sets, element_sets, notes


def _set_names(
    members: Mapping[tuple[int, int], object], physical_names: Mapping[tuple[int, int], str]
) -> tuple[dict[tuple[int, int], str], list[str]]:
    """Name of every group; the dimension is added if groups of different dimensions share a name."""
    names = {
        (dimension, tag): physical_names.get((dimension, tag)) or f"{dimension}d-{tag}" for dimension, tag in members
    }
    shared = {
        name for name in names.values() if len({dimension for (dimension, _), n in names.items() if n == name}) > 1
    }
    notes = [
        f"physical groups of different dimensions have the name {name!r}; the names of their sets include the dimension, as "
        f"'{name} (2d)'"
        for name in sorted(shared)
    ]
    return {key: f"{name} ({key[0]}d)" if name in shared else name for key, name in names.items()}, notes


def _origin(path: str, nodes: NodeRows, solids: list[Chunk]) -> dict[str, Origin]:
    if nodes.line is None:
        return {}
    ids = concatenate(chunk.ids for chunk in solids)
    line = concatenate(chunk.line for chunk in solids if chunk.line is not None)
    return {
        "node": Origin(nodes.ids, nodes.line, np.zeros(len(nodes.ids), dtype=np.int64), (path,)),
        "element": Origin(ids, line, np.zeros(len(ids), dtype=np.int64), (path,)),
    }
