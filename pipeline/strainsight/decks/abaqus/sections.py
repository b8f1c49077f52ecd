"""Sections of an Abaqus deck: the region of every element, its material, and what makes shells and beams solid."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.decks.abaqus.materials import Materials, definitions, solid_orientation
from strainsight.decks.abaqus.parts import NODES
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.section_cards import (
    beam_section,
    composite_solid,
    default_axes,
    own_constants,
    shell_section,
)
from strainsight.decks.abaqus.text import Keyword
from strainsight.decks.faults import OR_CONFIG, folded, note_shared
from strainsight.errors import DeckError
from strainsight.mesh.given_sections import beam_axes
from strainsight.mesh.model import FloatArray, IntArray, Properties, Region
from strainsight.mesh.node_order import plate_normals
from strainsight.mesh.thin import (
    BEAM_KINDS,
    CORNERS,
    SHELL_KINDS,
    BeamBlock,
    BeamSection,
    Laminate,
    ShellBlock,
    ShellSection,
)
from strainsight.mesh.thin_faces import ALONG, axes_along

FOR = {
    "SOLIDSECTION": ("solid", "rod"),
    "SHELLSECTION": ("shell",),
    "SHELLGENERALSECTION": ("shell",),
    "BEAMSECTION": ("beam",),
    "BEAMGENERALSECTION": ("beam",),
}
"""Keyword → families of the elements that it is for."""
WANTED = {"solid": "*SOLID SECTION", "shell": "*SHELL SECTION", "beam": "*BEAM SECTION", "rod": "*SOLID SECTION"}


@dataclass(frozen=True)
class Sections:
    """region (m,) of each element, 0 of those that are not imported; properties: the regions, one a section, and what they
    refer to.

    offset: region → where the middle of its elements lies from their nodes, along the normal of a shell, along n1 and n2 of a
    beam; direction (3,): n1 of a beam, x of the material of a shell; left (k,): rows of the shells, beams and rods without a
    section.
    """

    region: IntArray
    properties: Properties
    offset: dict[int, FloatArray] = field(default_factory=dict)
    direction: dict[int, FloatArray] = field(default_factory=dict)
    left: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def read_sections(
    assembly: Assembly,
    keywords: list[Keyword],
    set_name: dict[tuple[str, str], str],
    ignored: Counter[str],
    required: bool,
    stated: bool,
) -> Sections:
    """*SOLID SECTION of solids and trusses, *SHELL SECTION, *BEAM SECTION and *BEAM GENERAL SECTION.

    set_name: (instance, SET) → its name in the mesh; required: sections of shells and beams have to be there and supported;
    otherwise the elements of others are left out and counted; stated: every solid has to have a section, and every section its
    material; otherwise a region may have none, and solids without section are one. Raises DeckError for an element without
    section, with two or with one of another kind, for a section without material or set, one that is not supported, and a
    material that is not linear and elastic, or of shells and beams not isotropic.
    """
    properties = Properties()
    materials = Materials(definitions(keywords), stated, assembly.notes, properties)
    found = Sections(np.zeros(len(assembly.families), dtype=np.int64), properties)
    left = [found.left]
    for scope in assembly.scopes.values():
        for keyword in scope.part.keywords:
            if keyword.name not in FOR:
                continue
            rows = assembly.element_set(keyword.needs("ELSET"), scope, keyword)
            known = rows[assembly.families[rows] != ""]
            if not known.size and (rows.size or keyword.name != "SOLIDSECTION"):
                continue
            _check_family(assembly, keyword, known)
            if (taken := known[found.region[known] > 0]).size:
                raise keyword.error(
                    f"element {assembly.element_ids[taken[0]]} is in the section of "
                    f"{properties.regions[int(found.region[taken[0]])].name} already",
                    "let every element belong to one section",
                )
            within, written = assembly.split_name(keyword.parameters["ELSET"], scope)
            name = set_name.get((within.name, written.upper()), written)
            try:
                _add(assembly, scope, keyword, known, materials, found, name)
            except DeckError:
                if required or keyword.name == "SOLIDSECTION":
                    raise
                left.append(known)
    left.append(_without(assembly, found, np.concatenate(left), required, stated))
    gone = np.unique(np.concatenate(left))
    gone = gone[found.region[gone] == 0]
    ignored.update(Counter(f"*ELEMENT, TYPE={assembly.type[row]}" for row in gone.tolist()))
    if materials.unused:
        ignored["*MATERIAL that no section refers to"] += materials.unused
    return replace(found, left=gone)


def _check_family(assembly: Assembly, keyword: Keyword, rows: IntArray) -> None:
    family = assembly.families
    other = rows[~np.isin(family[rows], FOR[keyword.name])]
    if other.size:
        row = int(other[0])
        raise keyword.error(
            f"{assembly.element(row)} is a {'truss' if family[row] == 'rod' else family[row]} ({other.size} such elements)",
            f"take it out of the element set, and give it a {WANTED[str(family[row])]}",
        )


def _add(
    assembly: Assembly, scope: Scope, keyword: Keyword, rows: IntArray, made: Materials, found: Sections, name: str
) -> None:
    """A region of the elements in rows (k,), of that name."""
    number, offset, direction = len(found.properties.regions) + 1, np.zeros(2), np.full(3, np.nan)
    section: ShellSection | BeamSection | Laminate | None = None
    material = None
    if keyword.name == "SOLIDSECTION":
        rods = assembly.families[rows] == "rod"
        if "COMPOSITE" in keyword.parameters:
            found.properties.composites[number] = composite_solid(assembly, scope, keyword, rows, made)
            material = 0  # those of its layers
        if made.anisotropic(keyword):
            if rods.any():
                raise keyword.error(
                    f"{assembly.element(int(rows[np.argmax(rods)]))} is a truss, and its material is anisotropic",
                    "give trusses an isotropic material",
                )
            found.properties.orientations[number] = solid_orientation(assembly, scope, keyword)
        if rods.any():
            section = _truss(keyword, assembly.notes)
    elif keyword.name.startswith("SHELL"):
        section, offset, direction = shell_section(assembly, scope, keyword, made)
    else:
        types = sorted({assembly.type[row] for row in rows.tolist()})
        if "B33" in types and len(types) > 1:
            raise keyword.error(
                f"{' and '.join(types)} in one section: B33 do not shear", "give each type its own section"
            )
        beam, offset, direction = beam_section(scope, keyword, types != ["B33"], assembly.notes)
        if "MATERIAL" not in keyword.parameters and keyword.name == "BEAMGENERALSECTION":
            beam, *constants = own_constants(keyword, beam, assembly.notes)
            material = made.of_section(f"material of {name}", *constants)
        section = beam
    if isinstance(section, Laminate):
        material = 0  # those of its plies
    elif material is None:
        material = made.number(keyword)
    found.properties.regions[number] = Region(number, name, material)
    found.region[rows] = number
    if section is not None:
        found.properties.sections[number], found.offset[number], found.direction[number] = section, offset, direction


def _truss(keyword: Keyword, notes: list[str]) -> BeamSection:
    """Area of the trusses of a *SOLID SECTION, 1 where it states none."""
    rows = keyword.rows(needed=False)
    if not rows or not rows[0].text(0):
        notes.append(f"{keyword.where}: {keyword.title} states no area of its trusses: taken as 1, as Abaqus does")
        return BeamSection(1.0)
    return BeamSection(rows[0].positive(0, "the area"))


def _without(assembly: Assembly, found: Sections, left: IntArray, required: bool, stated: bool) -> IntArray:
    """Solids without section are a region, unless it has to be stated; rows of other elements without one, unless required."""
    family, regions = assembly.families, found.properties.regions
    without = np.setdiff1d(np.flatnonzero((family != "") & (found.region == 0)), left)
    solid = without[family[without] == "solid"]
    if solid.size and stated:
        raise assembly.element_error(
            int(solid[0]),
            f"has no section ({solid.size} elements)",
            f"add a *SOLID SECTION with its element set and a material{OR_CONFIG}",
        )
    if solid.size:
        number = len(regions) + 1
        regions[number] = Region(number, "without section", 0)
        found.region[solid] = number
    thin = without[family[without] != "solid"]
    if thin.size and required:
        row = int(thin[0])
        raise assembly.element_error(
            row,
            f"has no section ({thin.size} elements)",
            f"add a {WANTED[str(family[row])]} with its element set, or leave these elements out "
            f"(mesh.ignore: [{assembly.type[row]}])",
        )
    return thin


IN_ORDER = {"beam": (0, 1), "rod": (0, 1), "beam3": (0, 2, 1)}
"""Kind → where its nodes stand in the deck: ends, and the one between."""
APART = 1e-9
"""Length of an element over the extent of the model, below which its ends coincide."""


def shell_blocks(assembly: Assembly, sections: Sections) -> tuple[ShellBlock, ...]:
    """Shells with a section, a block a kind.

    Raises DeckError for a node that stands twice in a shell, and for one that has no area, is folded or warped too much.
    """
    blocks = []
    kinds = assembly.thin_kinds
    for kind in SHELL_KINDS:
        rows = np.flatnonzero((kinds == kind) & (sections.region > 0))
        if not rows.size:
            continue
        nodes = assembly.connectivity(rows, range(NODES[kind]))
        if (at := folded(nodes)) is not None:
            raise assembly.element_error(
                int(rows[at]), "has a node twice", "write a collapsed quadrangle as an S3, take others out"
            )
        plate_normals(
            assembly.position[nodes[:, : CORNERS[NODES[kind]]]],
            assembly.error_of(rows),
            assembly.name_of(rows),
            "S3",
            assembly.notes,
        )
        note_shared(nodes, assembly.name_of(rows), assembly.notes)
        region = sections.region[rows]
        offset = np.array([sections.offset[number][0] for number in region.tolist()])
        axis = np.array([sections.direction[number] for number in region.tolist()])
        plies = [isinstance(sections.properties.sections[number], Laminate) for number in region.tolist()]
        bare = np.isnan(axis).any(axis=1) & plies
        axis[bare] = default_axes(assembly.position[nodes[bare, : CORNERS[NODES[kind]]]])
        blocks.append(ShellBlock(kind, assembly.element_ids[rows], nodes, region, offset, axis))
    return tuple(blocks)


def beam_blocks(assembly: Assembly, sections: Sections) -> tuple[BeamBlock, ...]:
    """Beams and trusses with a section, a block a kind:

        x from the first node to the last,     n2 = x × v/|x × v|,   n1 = n2 × x

    y is n1 and z is n2; v is the direction n1 of the section, or points from the first node to one more of the element. A B32
    has its middle node between its ends.
    Raises DeckError for nodes that are missing or coincide, and for a direction n1 along the beam.
    """
    extent = float(np.ptp(assembly.position, axis=0).max()) if len(assembly.position) else 0.0
    blocks = []
    kinds = assembly.thin_kinds
    for kind in BEAM_KINDS:
        rows = np.flatnonzero((kinds == kind) & (sections.region > 0))
        if not rows.size:
            continue
        _check_count(assembly, rows, IN_ORDER[kind])
        nodes = assembly.connectivity(rows, IN_ORDER[kind])
        x = np.diff(assembly.position[nodes[:, :2]], axis=1)[:, 0]
        if (short := ~(np.linalg.norm(x, axis=1) > APART * extent)).any():
            raise assembly.element_error(
                int(rows[np.argmax(short)]), "has no length: its nodes coincide", "move a node, or take it out"
            )
        region = sections.region[rows]
        v = (
            np.eye(3)[np.argmin(np.abs(x), axis=1)]
            if kind == "rod"
            else _directions(assembly, sections, rows, region, len(IN_ORDER[kind]))
        )
        axes, lost = beam_axes(x, v)
        if lost.any():
            at = int(np.argmax(lost))
            n1 = ", ".join(f"{c:g}" for c in v[at])
            raise assembly.element_error(
                int(rows[at]),
                f"lies along the first axis n1 ({n1}) of its section",
                "give a direction across the beam on the line after the dimensions, which is 0, 0, -1 without it",
            )
        place = np.array([sections.offset[number] for number in region.tolist()])
        note_shared(nodes, assembly.name_of(rows), assembly.notes)
        own = np.repeat(axes[:, None], nodes.shape[1], axis=1)
        if kind == "beam3":
            own, _ = axes_along(assembly.position[nodes], axes, ALONG)
        off = own[..., 1] * place[:, None, :1] + own[..., 2] * place[:, None, 1:] if kind != "rod" else 0 * own[..., 0]
        released = np.zeros((len(rows), 2, 6), dtype=bool)
        blocks.append(BeamBlock(kind, assembly.element_ids[rows], nodes, region, axes, off, released))
    return tuple(blocks)


def _check_count(assembly: Assembly, rows: IntArray, order: tuple[int, ...]) -> None:
    """As many nodes as a beam has, or one more that n1 points to, which trusses have not."""
    for row in rows.tolist():
        nodes = assembly.nodes_of(row)
        truss = assembly.type[row].startswith("T")
        if not len(order) <= len(nodes) <= len(order) + (not truss):
            count, more = ("two", "third") if len(order) == 2 else ("three", "fourth")
            raise assembly.element_error(
                row, f"has {len(nodes)} nodes", f"give {count}" + ("" if truss else f", and a {more} that n1 points to")
            )
        if nodes.min() < 0:
            i = int(np.argmin(nodes)) + 1
            raise assembly.element_error(
                row, f"has a node that is not in the deck (its {i}.)", "add the node, or correct the id"
            )


def _directions(assembly: Assembly, sections: Sections, rows: IntArray, region: IntArray, count: int) -> FloatArray:
    """v (n, 3) of each beam of `count` nodes."""
    v = np.array([sections.direction[number] for number in region.tolist()])
    more = np.flatnonzero(assembly.first[rows + 1] - assembly.first[rows] == count + 1)
    v[more] = np.diff(assembly.position[assembly.connectivity(rows[more], (0, count))], axis=1)[:, 0]
    return v
