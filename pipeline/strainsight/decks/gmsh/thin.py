"""Triangles, quadrangles and lines of a gmsh file whose physical groups have a section."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.faults import IdTable, Where
from strainsight.decks.gmsh.records import TYPES, Chunk
from strainsight.decks.gmsh.rows import Doubled, indices, merged
from strainsight.decks.gmsh.sections import GmshFile
from strainsight.decks.thin import Chosen, regions_with_sections
from strainsight.errors import DeckError
from strainsight.mesh.given_sections import LINE, LINE3, GivenSection
from strainsight.mesh.model import CellBlock, Region

KINDS = {3: "quad4", 2: "tri3", 16: "quad8", 9: "tri6", 1: LINE, 8: LINE3}
"""Types of elements that may have a section."""
NINE = 10
"""Type of the quadrangle that second order makes by default."""
GROUP = {1: "line", 2: "surface", 3: "volume"}


@dataclass(frozen=True)
class Thin:
    """Elements with sections: as they stand in the file, as cells, their regions; elements that are written twice."""

    chunks: list[Chunk]
    cells: tuple[CellBlock, ...]
    chosen: Chosen
    doubled: Doubled


def thin_cells(
    file: GmshFile,
    table: IdTable,
    given: Mapping[str, GivenSection],
    solids: Mapping[int, Region],
    where: Where,
    notes: list[str],
) -> Thin:
    """Elements of the physical groups that have a section; solids: regions of the volumes.

    Raises UserError for a group that is not there, DeckError for elements of higher order, and for one in groups of two sections.
    """
    chosen = regions_with_sections(_groups(file), given, solids, notes)
    chunks = []
    for chunk in file.elements:
        dimension = TYPES[chunk.type].dimension
        own: list[int | None] = [tag for tag in chunk.groups or (None,) if (dimension, tag) in chosen]
        if not own or not len(chunk.ids):
            continue
        if chunk.type not in KINDS:
            element = int(chunk.ids[0])
            raise DeckError(
                f"element {element} is a {TYPES[chunk.type].name}, and {chosen[dimension, own[0]][0]} has a section: "
                f"its elements may be {', '.join(TYPES[number].name + 's' for number in KINDS)}",
                where=where("element", element),
                remedy="set Mesh.SecondOrderIncomplete = 1 before meshing"
                if chunk.type == NINE
                else "set Mesh.ElementOrder = 2 (or 1) before meshing",
                entity=("element", element),
            )
        groups = tuple(sorted(tag for tag in own if tag is not None))
        chunks.append(replace(chunk, groups=groups))
    left, doubled = merged(chunks, file.version)
    together = [*_in_several(left), *_written_twice(chunks, doubled)]
    for element, dimension, tags in together:
        _check_one_section(element, [chosen[dimension, tag] for tag in tags], where)
    if together:
        notes.append(
            f"element {together[0][0]} is in several physical groups with a section: in the region of the lowest tag"
        )
    return Thin(left, tuple(_cells(left, chosen, table, where)), chosen, doubled)


def _groups(file: GmshFile) -> dict[int, dict[int | None, str]]:
    """Names of the physical groups that hold elements, by dimension; None: elements in none."""
    groups: dict[int, dict[int | None, str]] = {}
    for chunk in file.elements:
        dimension = TYPES[chunk.type].dimension
        if dimension and len(chunk.ids):
            for tag in chunk.groups or (None,):
                word = GROUP[dimension]
                name = f"no physical {word}" if tag is None else file.names.get((dimension, tag)) or f"{word} {tag}"
                groups.setdefault(dimension, {})[tag] = name
    return groups


def _in_several(chunks: list[Chunk]) -> Iterator[tuple[int, int, tuple[int, ...]]]:
    """The first element of those in several groups, its dimension and their tags."""
    for chunk in chunks:
        if len(chunk.groups) > 1:
            yield int(chunk.ids[0]), TYPES[chunk.type].dimension, chunk.groups


def _written_twice(chunks: list[Chunk], doubled: Doubled) -> Iterator[tuple[int, int, tuple[int, ...]]]:
    """The same of elements that format 2 writes once for each of their groups."""
    wanted = {*doubled.dropped.tolist(), *doubled.kept.tolist()}
    of = {i: chunk for chunk in chunks for i in chunk.ids.tolist() if i in wanted}
    for dropped, kept in zip(doubled.dropped.tolist(), doubled.kept.tolist(), strict=True):
        yield kept, TYPES[of[kept].type].dimension, (of[kept].groups[0], of[dropped].groups[0])


def _check_one_section(element: int, regions: list[tuple[Region, GivenSection]], where: Where) -> None:
    (a, own), *others = regions
    for b, other in others:
        if other is not own:
            raise DeckError(
                f"element {element} is in {a} and in {b}, which have different sections",
                where=where("element", element),
                remedy="give one of the two a section (mesh.sections), or part the physical groups",
                entity=("element", element),
            )


def _cells(chunks: list[Chunk], chosen: Chosen, table: IdTable, where: Where) -> Iterator[CellBlock]:
    for number, kind in KINDS.items():
        own = [chunk for chunk in chunks if chunk.type == number]
        if own:
            region = [
                np.full(len(c.ids), chosen[TYPES[number].dimension, c.groups[0] if c.groups else None][0].id)
                for c in own
            ]
            yield CellBlock(
                kind,
                np.concatenate([chunk.ids for chunk in own]),
                np.concatenate([indices(chunk, table, where) for chunk in own]),
                np.concatenate(region),
            )
