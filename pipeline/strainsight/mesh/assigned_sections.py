"""Sections assigned in the config to regions of a file without sections, and the resulting shells, beams and rods."""

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
"""Kinds of the lines that become beams or rods; triangles and quadrangles have the names of shell kinds."""
LINES = {"beam": LINE, "rod": LINE, "beam3": LINE3}
"""Kind of a beam → that of its lines."""
ON_AXIS = 1e-6
"""Smallest sine of the angle between a direction and a beam axis that defines a plane."""


@dataclass(frozen=True)
class GivenSection:
    """Section of regions (ids or names of the file, None: all): thickness of their triangles and quadrangles, or area of lines.

    offset [m] of the middle of shells from their nodes, along the normal defined by the node order; direction (3,): y of beams
    points to it, None for rods."""

    regions: tuple[int | str, ...] | None
    section: ShellSection | BeamSection
    offset: Annotated[
        float,
        Column("m", "", "offset of the shell mid-surface from the nodes, along the normal defined by the node order"),
    ] = 0.0
    direction: tuple[float, float, float] | None = None

    @property
    def dimension(self) -> int:
        """Dimension of its elements: 2 or 1."""
        return 2 if isinstance(self.section, ShellSection) else 1


def with_given(mesh: Mesh, cells: Sequence[CellBlock], chosen: SectionsByGroup) -> Mesh:
    """The mesh with cells of triangles, quadrangles and lines as shells, beams and rods with the sections of their regions.

    x of a beam from its first node to its second, y towards its direction; rods are sections without moments of area.
    Raises DeckError for a shell without area, folded or too warped, a line without length, and a line parallel to the
    direction of its section."""
    assignments = {region.id: assigned for region, assigned in chosen.values()}
    of = {
        kind: CellBlock.joined([block for block in cells if block.kind == kind]) for kind in (*SHELL_KINDS, LINE, LINE3)
    }
    notes = list(mesh.notes)
    with mesh.located():
        shells = tuple(_shells(mesh, of[kind], assignments, notes) for kind in SHELL_KINDS if len(of[kind].ids))
        for element, region in zip(of[LINE3].ids.tolist(), of[LINE3].region.tolist(), strict=True):
            if not _bends(assignments[region]):
                what = f"element {element} is a line of three nodes, which requires bending stiffness, but its section has none"
                remedy = (
                    "Specify `second_moments` of the section in mesh.sections, or mesh rods with lines of two nodes."
                )
                raise element_error(element, what, remedy)
        lines = [_beams(mesh, kind, of[line], assignments) for kind, line in LINES.items() if len(of[line].ids)]
    beams = tuple(block for block in lines if len(block.ids))
    sections: dict[int, Section] = {region: assigned.section for region, assigned in assignments.items()}
    return replace(mesh, shells=shells, beams=beams, sections=sections, notes=tuple(notes))


def _shells(mesh: Mesh, block: CellBlock, assignments: Mapping[int, GivenSection], notes: list[str]) -> ShellBlock:
    def called(row: int) -> str:
        return f"{block.kind} {block.ids[row]}"

    def fault(row: int, what: str, remedy: str) -> DeckError:
        return element_error(block.ids[row], f"{called(row)}: {what}", remedy)

    plate_normals(mesh.position[block.nodes[:, : CORNERS[block.nodes.shape[1]]]], fault, called, "tri3", notes)
    offset = np.array([assignments[region].offset for region in block.region.tolist()])
    axis = np.full((len(block.ids), 3), np.nan)
    return ShellBlock(block.kind, block.ids, block.nodes, block.region, offset, axis)


def _beams(mesh: Mesh, kind: str, block: CellBlock, assignments: Mapping[int, GivenSection]) -> BeamBlock:
    """The beams of this kind among the lines."""
    selected = np.flatnonzero([_bends(assignments[region]) == (kind != "rod") for region in block.region.tolist()])
    ids, nodes, region = block.ids[selected], block.nodes[selected], block.region[selected]
    along = np.diff(mesh.position[nodes[:, :2]], axis=1)[:, 0]
    size = np.linalg.norm(along, axis=1)
    if not size.all():
        element = int(ids[np.argmin(size)])
        raise element_error(
            element, f"element {element} is a line of zero length", "Move one of the two nodes, or remove the element."
        )
    towards = [assignments[number].direction for number in region.tolist()]
    across = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    v = np.array([across[i] if direction is None else direction for i, direction in enumerate(towards)]).reshape(-1, 3)
    axes, is_parallel = beam_axes(along, v)
    if is_parallel.any():
        element = int(ids[np.argmax(is_parallel)])
        raise element_error(
            element,
            f"element {element} is parallel to the section direction {list(towards[int(np.argmax(is_parallel))] or ())}",
            "Put this line into a separate region with another `direction` in mesh.sections.",
        )
    e = len(ids)
    return BeamBlock(kind, ids, nodes, region, axes, np.zeros((e, nodes.shape[1], 3)), np.zeros((e, 2, 6), dtype=bool))


def _bends(assigned: GivenSection) -> bool:
    return isinstance(assigned.section, BeamSection) and bool(assigned.section.second.any())


def beam_axes(along: FloatArray, towards: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """Axes (n, 3, 3) of beams, one in a column, and whether v is parallel to the beam and defines no plane (n,):

        x = along/|along|,     z = x × v/|x × v|,     y = z × x

    along (n, 3) from end A to B, not zero; towards (n, 3) v."""
    x = along / np.linalg.norm(along, axis=1)[:, None]
    z = np.cross(x, towards)
    size = np.linalg.norm(z, axis=1)
    is_parallel = ~(size > ON_AXIS * np.linalg.norm(towards, axis=1))
    z /= np.where(is_parallel, 1.0, size)[:, None]
    return np.stack([x, np.cross(z, x), z], axis=2), is_parallel


Groups = Mapping[int, Mapping[int | None, str]]
"""Dimension 1, 2, 3 → region number of its elements in the file (None: no region) → name."""
SectionsByGroup = dict[tuple[int, int | None], tuple[Region, GivenSection]]
"""Dimension and number in the file → the region of these elements, and its section."""

ELEMENT_NAMES = {1: "lines", 2: "triangles and quadrangles", 3: "solids"}
REMEDIES = {
    1: "Specify `area` for regions of lines.",
    2: "Specify `thickness` for regions of triangles and quadrangles.",
    3: "Remove this region from the section: solids have no section.",
}
SHELLS = (
    "Specify a section of their regions in mesh.sections to import triangles and quadrangles as shells, and lines as beams: "
    "{skin: {regions: all, thickness: …}}."
)
"""Remedy for a file without solids."""


def regions_with_sections(
    groups: Groups, assignments: Mapping[str, GivenSection], solids: Mapping[int, Region], notes: list[str]
) -> SectionsByGroup:
    """The regions of triangles, quadrangles and lines with a section; assignments: key of the config → section.

    A region keeps its number unless a region of another dimension has it, and its name, with its dimension appended ("skin
    (2d)") if another region has it. Raises UserError with the key for a region without such elements, or with two sections."""
    owner: dict[tuple[int, int | None], str] = {}
    for key, assigned in assignments.items():
        for tag in _tags(key, assigned, groups):
            if (other := owner.setdefault((assigned.dimension, tag), key)) != key:
                name = groups[assigned.dimension][tag]
                raise UserError(
                    f"region {name} already has the section {other.rpartition('.')[2]}",
                    key=f"{key}.regions",
                    remedy="Assign only one section to this region.",
                )
    known = [tag for group in groups.values() for tag in group if tag is not None]
    spare = max([0, *known, *solids]) + 1
    chosen: SectionsByGroup = {}
    regions = dict(solids)
    for (dimension, tag), key in sorted(
        owner.items(), key=lambda item: (-item[0][0], item[0][1] is None, item[0][1] or 0)
    ):
        name = groups[dimension][tag]
        if name in {region.name for region in regions.values()}:
            name = f"{name} ({dimension}d)"
        number = tag
        if number is None or number in regions:
            number, spare = spare, spare + 1
        if tag is not None and number != tag:
            notes.append(
                f"region {tag} of {ELEMENT_NAMES[dimension]} is imported as region {number} ({name}), "
                f"because the id {tag} already belongs to {regions[tag]}"
            )
        regions[number] = Region(number, name, 0)
        chosen[dimension, tag] = (regions[number], assignments[key])
    return chosen


def _tags(key: str, assigned: GivenSection, groups: Groups) -> Iterator[int | None]:
    """Numbers in the file of the regions with a section."""
    tags = groups.get(assigned.dimension, {})
    words = ELEMENT_NAMES[assigned.dimension]
    if assigned.regions is None and not tags:
        raise UserError(f"the file has no {words} for this section", key=f"{key}.regions", remedy="Remove the section.")
    if assigned.regions is None:
        yield from tags
        return
    for entry in assigned.regions:
        if not (matches := _named(entry, tags)):
            others = [d for d in (3, 2, 1) if _named(entry, groups.get(d, {}))]
            names = [str(name) for tag, name in tags.items() if tag is not None]
            raise UserError(
                f"region {entry!r} has {ELEMENT_NAMES[others[0]]}, but no {words}"
                if others
                else f"the file has no region {entry!r} of {words}",
                key=f"{key}.regions",
                remedy=REMEDIES[others[0]]
                if others
                else did_you_mean(
                    str(entry), names, f"Use one of the regions of {words} ({', '.join(names) or 'none'}), or `all`."
                ),
            )
        yield from matches


def _named(entry: int | str, tags: Mapping[int | None, str]) -> list[int | None]:
    return [tag for tag, name in tags.items() if tag is not None and entry in (tag, name)]
