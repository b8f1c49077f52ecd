"""Sections of an Abaqus deck: region and material of every element, and the shell and beam blocks."""

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
    section_constants,
    shell_section,
)
from strainsight.decks.abaqus.text import Keyword
from strainsight.decks.faults import OR_CONFIG, find_repeated_node, note_shared, plural
from strainsight.errors import DeckError
from strainsight.mesh.assigned_sections import beam_axes
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
"""Keyword → families of the elements to which it applies."""
WANTED = {"solid": "*SOLID SECTION", "shell": "*SHELL SECTION", "beam": "*BEAM SECTION", "rod": "*SOLID SECTION"}


@dataclass(frozen=True)
class Sections:
    """region (m,) of each element, 0 if it is not imported; properties: the regions, one a section, and their data.

    offset: region → offset of the element middle from the nodes, along the normal of a shell, along n1 and n2 of a beam;
    direction (3,): n1 of a beam, material axis x of a shell; left (k,): rows of shells, beams and rods without section."""

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
    materials_required: bool,
) -> Sections:
    """*SOLID SECTION of solids and trusses, *SHELL SECTION, *BEAM SECTION and *BEAM GENERAL SECTION.

    set_name: (instance, SET) → name in the mesh; required: require supported sections of shells and beams; otherwise elements
    without one are left out and counted; materials_required: require a section of every solid and a material of every section;
    otherwise a region may have no material, and solids without section form one region. Raises DeckError for an element without
    section or with two, a section of another family, a missing material or set, and an unsupported section or material."""
    properties = Properties()
    materials = Materials(definitions(keywords), materials_required, assembly.notes, properties)
    sections = Sections(np.zeros(len(assembly.families), dtype=np.int64), properties)
    left = [sections.left]
    for scope in assembly.scopes.values():
        for keyword in scope.part.keywords:
            if keyword.name not in FOR:
                continue
            rows = assembly.set_rows("ELEMENT", keyword.needs("ELSET"), scope, keyword)
            known = rows[assembly.families[rows] != ""]
            if not known.size and (rows.size or keyword.name != "SOLIDSECTION"):
                continue
            _check_family(assembly, keyword, known)
            if (assigned := known[sections.region[known] > 0]).size:
                raise keyword.error(
                    f"element {assembly.element_ids[assigned[0]]} already belongs to section "
                    f"{properties.regions[int(sections.region[assigned[0]])].name}",
                    "assign every element to exactly one section",
                )
            within, written = assembly.split_name(keyword.parameters["ELSET"], scope)
            name = set_name.get((within.name, written.upper()), written)
            try:
                _add(assembly, scope, keyword, known, materials, sections, name)
            except DeckError:
                if required or keyword.name == "SOLIDSECTION":
                    raise
                left.append(known)
    left.append(_handle_without_section(assembly, sections, np.concatenate(left), required, materials_required))
    omitted = np.unique(np.concatenate(left))
    omitted = omitted[sections.region[omitted] == 0]
    ignored.update(Counter(f"*ELEMENT, TYPE={assembly.type[row]}" for row in omitted.tolist()))
    if materials.unused:
        ignored["*MATERIAL that no section refers to"] += materials.unused
    return replace(sections, left=omitted)


def _check_family(assembly: Assembly, keyword: Keyword, rows: IntArray) -> None:
    family = assembly.families
    if (other := rows[~np.isin(family[rows], FOR[keyword.name])]).size:
        row = int(other[0])
        raise keyword.error(
            f"the element set contains {assembly.element(row)}, to which this section does not apply "
            f"({plural(other.size, 'such element')} in total)",
            f"remove these elements from the element set, and add a {WANTED[str(family[row])]} for them",
        )


def _add(
    assembly: Assembly,
    scope: Scope,
    keyword: Keyword,
    rows: IntArray,
    materials: Materials,
    sections: Sections,
    name: str,
) -> None:
    """Add a region of the elements in rows (k,) with this name."""
    number, offset, direction = len(sections.properties.regions) + 1, np.zeros(2), np.full(3, np.nan)
    section: ShellSection | BeamSection | Laminate | None = None
    material = None
    if keyword.name == "SOLIDSECTION":
        rods = assembly.families[rows] == "rod"
        if "COMPOSITE" in keyword.parameters:
            sections.properties.composites[number] = composite_solid(assembly, scope, keyword, rows, materials)
            material = 0  # those of its layers
        if materials.anisotropic(keyword):
            if rods.any():
                raise keyword.error(
                    f"{assembly.element(int(rows[np.argmax(rods)]))} is a truss, but its material is anisotropic",
                    "use an isotropic material for trusses",
                )
            sections.properties.orientations[number] = solid_orientation(assembly, scope, keyword)
        if rods.any():
            section = _truss(keyword, assembly.notes)
    elif keyword.name.startswith("SHELL"):
        section, offset, direction = shell_section(assembly, scope, keyword, materials)
    else:
        types = sorted({assembly.type[row] for row in rows.tolist()})
        if "B33" in types and len(types) > 1:
            raise keyword.error(
                f"{' and '.join(types)} elements are in one section, but B33 elements have no shear deformation",
                "use a separate section for each element type",
            )
        beam, offset, direction = beam_section(scope, keyword, types != ["B33"], assembly.notes)
        if "MATERIAL" not in keyword.parameters and keyword.name == "BEAMGENERALSECTION":
            beam, *constants = section_constants(keyword, beam, assembly.notes)
            material = materials.of_section(f"material of {name}", *constants)
        section = beam
    if isinstance(section, Laminate):
        material = 0  # those of its plies
    elif material is None:
        material = materials.number(keyword)
    sections.properties.regions[number] = Region(number, name, material)
    sections.region[rows] = number
    if section is not None:
        sections.properties.sections[number], sections.offset[number], sections.direction[number] = (
            section,
            offset,
            direction,
        )


def _truss(keyword: Keyword, notes: list[str]) -> BeamSection:
    """Area of the trusses of a *SOLID SECTION, 1 by default."""
    rows = keyword.rows(needed=False)
    if not rows or not rows[0].text(0):
        notes.append(
            f"{keyword.where}: the *SOLID SECTION of trusses has no area, so the area is set to 1, as in Abaqus"
        )
        return BeamSection(1.0)
    return BeamSection(rows[0].positive(0, "the area"))


def _handle_without_section(
    assembly: Assembly, sections: Sections, left: IntArray, required: bool, materials_required: bool
) -> IntArray:
    """Make a region of the solids without section, unless materials are required; return rows of other elements
    without section, unless required."""
    family, regions = assembly.families, sections.properties.regions
    without = np.setdiff1d(np.flatnonzero((family != "") & (sections.region == 0)), left)
    solid = without[family[without] == "solid"]
    if solid.size and materials_required:
        row = int(solid[0])
        raise assembly.element_error(
            row,
            f"{assembly.element(row)} has no section ({plural(solid.size, 'such element')} in total)",
            f"add a *SOLID SECTION for the element set of these elements, with a material{OR_CONFIG}",
        )
    if solid.size:
        number = len(regions) + 1
        regions[number] = Region(number, "without section", 0)
        sections.region[solid] = number
    thin = without[family[without] != "solid"]
    if thin.size and required:
        row = int(thin[0])
        raise assembly.element_error(
            row,
            f"{assembly.element(row)} has no section ({plural(thin.size, 'such element')} in total)",
            f"add a {WANTED[str(family[row])]} for the element set of these elements, or leave these elements out (mesh.ignore: "
            f"[{assembly.type[row]}])",
        )
    return thin


IN_ORDER = {"beam": (0, 1), "rod": (0, 1), "beam3": (0, 2, 1)}
"""Kind → positions of its nodes in the deck: ends first, then the middle."""
APART = 1e-9
"""Length of an element relative to the model extent below which its ends coincide."""


def shell_blocks(assembly: Assembly, sections: Sections) -> tuple[ShellBlock, ...]:
    """Shells with a section, one block a kind. Raises DeckError for a repeated node and for a shell without area, or folded or
    warped too much."""
    blocks = []
    kinds = assembly.thin_kinds
    for kind in SHELL_KINDS:
        if not (rows := np.flatnonzero((kinds == kind) & (sections.region > 0))).size:
            continue
        nodes = assembly.connectivity(rows, range(NODES[kind]))
        if (at := find_repeated_node(nodes)) is not None:
            row = int(rows[at])
            raise assembly.element_error(
                row,
                f"{assembly.element(row)} has the same node twice",
                "replace a collapsed quadrilateral by an S3; remove other elements with a repeated node",
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
    """Beams and trusses with a section, one block a kind:

        x from the first node to the last,     n2 = x × v/|x × v|,   n1 = n2 × x

    y is n1 and z is n2; v is the direction n1 of the section, or the vector from the first node to an additional
    node. A B32 has its middle node between its ends. Raises DeckError for nodes that are missing or coincide, and for
    a direction n1 parallel to the beam."""
    extent = float(np.ptp(assembly.position, axis=0).max()) if len(assembly.position) else 0.0
    blocks = []
    kinds = assembly.thin_kinds
    for kind in BEAM_KINDS:
        if not (rows := np.flatnonzero((kinds == kind) & (sections.region > 0))).size:
            continue
        _check_count(assembly, rows, IN_ORDER[kind])
        nodes = assembly.connectivity(rows, IN_ORDER[kind])
        x = np.diff(assembly.position[nodes[:, :2]], axis=1)[:, 0]
        if (short := ~(np.linalg.norm(x, axis=1) > APART * extent)).any():
            row = int(rows[np.argmax(short)])
            what = f"{assembly.element(row)} has no length: its nodes coincide"
            raise assembly.element_error(row, what, "move a node, or remove the element")
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
            row = int(rows[at])
            raise assembly.element_error(
                row,
                f"{assembly.element(row)} is parallel to the first axis n1 ({n1}) of its section",
                "specify n1, a direction across the beam, on the line after the section dimensions; the default is 0, 0, -1",
            )
        place = np.array([sections.offset[number] for number in region.tolist()])
        note_shared(nodes, assembly.name_of(rows), assembly.notes)
        node_axes = np.repeat(axes[:, None], nodes.shape[1], axis=1)
        if kind == "beam3":
            node_axes, _ = axes_along(assembly.position[nodes], axes, ALONG)
        off = (
            node_axes[..., 1] * place[:, None, :1] + node_axes[..., 2] * place[:, None, 1:]
            if kind != "rod"
            else 0 * node_axes[..., 0]
        )
        released = np.zeros((len(rows), 2, 6), dtype=bool)
        blocks.append(BeamBlock(kind, assembly.element_ids[rows], nodes, region, axes, off, released))
    return tuple(blocks)


def _check_count(assembly: Assembly, rows: IntArray, order: tuple[int, ...]) -> None:
    """Raise DeckError unless each beam has its nodes, and at most one more (not for trusses) that defines n1."""
    for row in rows.tolist():
        nodes = assembly.nodes_of(row)
        truss = assembly.type[row].startswith("T")
        if not len(order) <= len(nodes) <= len(order) + (not truss):
            count, more = ("two", "third") if len(order) == 2 else ("three", "fourth")
            raise assembly.element_error(
                row,
                f"{assembly.element(row)} has {len(nodes)} nodes",
                f"specify {count} nodes" + ("" if truss else f", and optionally a {more} node that defines n1"),
            )
        if nodes.min() < 0:
            i = int(np.argmin(nodes)) + 1
            what = f"a node that is not in the deck (position {i} in the node list of the element)"
            raise assembly.element_error(
                row, f"{assembly.element(row)} refers to {what}", "add the node, or correct the id"
            )


def _directions(assembly: Assembly, sections: Sections, rows: IntArray, region: IntArray, count: int) -> FloatArray:
    """Direction v (n, 3) of each beam of `count` nodes."""
    v = np.array([sections.direction[number] for number in region.tolist()])
    more = np.flatnonzero(assembly.first[rows + 1] - assembly.first[rows] == count + 1)
    v[more] = np.diff(assembly.position[assembly.connectivity(rows[more], (0, count))], axis=1)[:, 0]
    return v
