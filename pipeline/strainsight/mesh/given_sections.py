"""Sections that are given to regions of a file that states none, and the shells, beams and rods that they make."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from strainsight.columns import Column
from strainsight.errors import DeckError, UserError, did_you_mean
from strainsight.mesh.model import CellBlock, Mesh, Region, element_error
from strainsight.mesh.node_order import plate_normals
from strainsight.mesh.thin import (
    CORNERS,
    SHELL_KINDS,
    BeamBlock,
    BeamSection,
    FloatArray,
    Section,
    ShellBlock,
    ShellSection,
)

LINE, LINE3 = "line2", "line3"
"""Kinds of the lines that become beams or rods; triangles and quadrangles have the names of shells."""
LINES = {"beam": LINE, "rod": LINE, "beam3": LINE3}
"""Kind of a beam → that of its lines."""
ON_AXIS = 1e-6
"""Sine of the angle of a direction to a beam, below which it gives no plane."""


@dataclass(frozen=True)
class GivenSection:
    """Section of regions (ids or names of the file, None: all): of their triangles and quadrangles with a thickness, of their
    lines with an area.

    offset [m] of the middle of shells from their nodes, along the normal that the order of nodes gives; direction (3,) towards
    which y of beams points, None of rods.
    """

    regions: tuple[int | str, ...] | None
    section: ShellSection | BeamSection
    offset: Annotated[float, Column("m", "", "of the middle of shells from their nodes")] = 0.0
    direction: tuple[float, float, float] | None = None

    @property
    def dimension(self) -> int:
        """Of the elements that it is of: 2 or 1."""
        return 2 if isinstance(self.section, ShellSection) else 1


def with_given(mesh: Mesh, cells: Sequence[CellBlock], given: Mapping[int, GivenSection]) -> Mesh:
    """The mesh with cells of triangles, quadrangles and lines as shells, beams and rods of the sections of their regions.

    x of a beam from its first node to its second, y towards its direction; rods are what has no moments of area.
    Raises DeckError for a shell of no area, folded or warped too much, a line without length, and one along the direction of its
    section.
    """
    of = {
        kind: CellBlock.joined([block for block in cells if block.kind == kind]) for kind in (*SHELL_KINDS, LINE, LINE3)
    }
    notes = list(mesh.notes)
    with mesh.located():
        shells = tuple(_shells(mesh, of[kind], given, notes) for kind in SHELL_KINDS if len(of[kind].ids))
        _refuse_curved_rods(of[LINE3], given)
        lines = [_beams(mesh, kind, of[line], given) for kind, line in LINES.items() if len(of[line].ids)]
    beams = tuple(block for block in lines if len(block.ids))
    sections: dict[int, Section] = {region: own.section for region, own in given.items()}
    return replace(mesh, shells=shells, beams=beams, sections=sections, notes=tuple(notes))


def _shells(mesh: Mesh, block: CellBlock, given: Mapping[int, GivenSection], notes: list[str]) -> ShellBlock:
    def called(row: int) -> str:
        return f"{block.kind} {block.ids[row]}"

    def fault(row: int, what: str, remedy: str) -> DeckError:
        return element_error(block.ids[row], f"{called(row)} {what}", remedy)

    plate_normals(mesh.position[block.nodes[:, : CORNERS[block.nodes.shape[1]]]], fault, called, "tri3", notes)
    offset = np.array([given[region].offset for region in block.region.tolist()])
    axis = np.full((len(block.ids), 3), np.nan)
    return ShellBlock(block.kind, block.ids, block.nodes, block.region, offset, axis)


def _beams(mesh: Mesh, kind: str, block: CellBlock, given: Mapping[int, GivenSection]) -> BeamBlock:
    """Those of the lines that are of this kind."""
    own = np.flatnonzero([_bends(given[region]) == (kind != "rod") for region in block.region.tolist()])
    ids, nodes, region = block.ids[own], block.nodes[own], block.region[own]
    along = np.diff(mesh.position[nodes[:, :2]], axis=1)[:, 0]
    size = np.linalg.norm(along, axis=1)
    if not size.all():
        element = int(ids[np.argmin(size)])
        raise element_error(element, f"element {element} is a line without length", "merge or move one of its nodes")
    towards = [given[number].direction for number in region.tolist()]
    across = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    v = np.array([across[i] if own is None else own for i, own in enumerate(towards)]).reshape(-1, 3)
    axes, lost = beam_axes(along, v)
    if lost.any():
        element = int(ids[np.argmax(lost)])
        raise element_error(
            element,
            f"element {element} runs along the direction {list(towards[int(np.argmax(lost))] or ())} of its section",
            "give lines that run another way a region and a direction of their own (mesh.sections)",
        )
    e = len(ids)
    return BeamBlock(kind, ids, nodes, region, axes, np.zeros((e, nodes.shape[1], 3)), np.zeros((e, 2, 6), dtype=bool))


def _refuse_curved_rods(block: CellBlock, given: Mapping[int, GivenSection]) -> None:
    for element, region in zip(block.ids.tolist(), block.region.tolist(), strict=True):
        if not _bends(given[region]):
            raise element_error(
                element,
                f"element {element} is a line of three nodes, and its section does not bend: nothing holds its middle",
                "give its section moments of area (mesh.sections), or mesh rods with lines of two nodes",
            )


def _bends(own: GivenSection) -> bool:
    return isinstance(own.section, BeamSection) and bool(own.section.second.any())


def beam_axes(along: FloatArray, towards: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """Axes (n, 3, 3) of beams, one in a column, and which of them have no plane as v runs along them (n,):

        x = along/|along|,     z = x × v/|x × v|,     y = z × x

    along (n, 3) from end A to B, not zero; towards (n, 3) v.
    """
    x = along / np.linalg.norm(along, axis=1)[:, None]
    z = np.cross(x, towards)
    size = np.linalg.norm(z, axis=1)
    lost = ~(size > ON_AXIS * np.linalg.norm(towards, axis=1))
    z /= np.where(lost, 1.0, size)[:, None]
    return np.stack([x, np.cross(z, x), z], axis=2), lost


Groups = Mapping[int, Mapping[int | None, str]]
"""Dimension 1, 2, 3 → number of the region of its elements in the file (None: in no region) → name."""
Chosen = dict[tuple[int, int | None], tuple[Region, GivenSection]]
"""Dimension and number in the file → the region that these elements become, and its section."""

WORDS = {1: "lines", 2: "triangles and quadrangles", 3: "solids"}
INSTEAD = {1: "lines have an area", 2: "triangles and quadrangles have a thickness", 3: "solids have no section"}
SHELLS = (
    "triangles and quadrangles become shells, and lines beams, where mesh.sections gives their regions a section: "
    "{skin: {regions: all, thickness: …}}"
)
"""What a file without solids may do."""


def regions_with_sections(
    groups: Groups, given: Mapping[str, GivenSection], solids: Mapping[int, Region], notes: list[str]
) -> Chosen:
    """The regions of triangles, quadrangles and lines that have a section; given: key of the config → section.

    A region keeps its number unless one of another dimension has it, and its name, with its dimension as in "skin (2d)" where
    another has that. Raises UserError with the key for a region that has no such elements, or two sections.
    """
    taken: dict[tuple[int, int | None], str] = {}
    for key, own in given.items():
        for tag in _tags(key, own, groups):
            if (other := taken.setdefault((own.dimension, tag), key)) != key:
                name = groups[own.dimension][tag]
                raise UserError(
                    f"region {name} has the section {other.rpartition('.')[2]} already",
                    key=f"{key}.regions",
                    remedy="give a region one section",
                )
    known = [tag for own in groups.values() for tag in own if tag is not None]
    spare = max([0, *known, *solids]) + 1
    chosen: Chosen = {}
    regions = dict(solids)
    for (dimension, tag), key in sorted(
        taken.items(), key=lambda item: (-item[0][0], item[0][1] is None, item[0][1] or 0)
    ):
        name = groups[dimension][tag]
        if name in {own.name for own in regions.values()}:
            name = f"{name} ({dimension}d)"
        number = tag
        if number is None or number in regions:
            number, spare = spare, spare + 1
        if tag is not None and number != tag:
            notes.append(
                f"region {tag} of {WORDS[dimension]} is region {number} ({name}), as {regions[tag]} is another"
            )
        regions[number] = Region(number, name, 0)
        chosen[dimension, tag] = (regions[number], given[key])
    return chosen


def sections_by_region(chosen: Chosen) -> dict[int, GivenSection]:
    """Region id → its section."""
    return {region.id: own for region, own in chosen.values()}


def _tags(key: str, own: GivenSection, groups: Groups) -> Iterator[int | None]:
    """Numbers in the file of the regions of a section."""
    there = groups.get(own.dimension, {})
    words = WORDS[own.dimension]
    if own.regions is None and not there:
        raise UserError(f"the file has no {words}", key=f"{key}.regions", remedy="remove the section")
    if own.regions is None:
        yield from there
        return
    for entry in own.regions:
        found = _named(entry, there)
        if not found:
            others = [d for d in (3, 2, 1) if _named(entry, groups.get(d, {}))]
            names = [str(name) for tag, name in there.items() if tag is not None]
            raise UserError(
                f"region {entry!r} has {WORDS[others[0]]} and no {words}"
                if others
                else f"the file has no region {entry!r} of {words}",
                key=f"{key}.regions",
                remedy=INSTEAD[others[0]]
                if others
                else did_you_mean(str(entry), names, f"its regions of {words}: {', '.join(names) or 'none'}; or all"),
            )
        yield from found


def _named(entry: int | str, there: Mapping[int | None, str]) -> list[int | None]:
    return [tag for tag, name in there.items() if tag is not None and entry in (tag, name)]
