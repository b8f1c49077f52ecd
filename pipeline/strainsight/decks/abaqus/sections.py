"""Sections of an Abaqus deck: the region of every element, its material, and what makes shells and beams solid."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from strainsight.decks.abaqus.beam_sections import beam_section, own_constants
from strainsight.decks.abaqus.materials import Materials, definitions
from strainsight.decks.abaqus.orientations import solid_orientation
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.shell_sections import composite_solid, shell_section
from strainsight.decks.abaqus.text import Keyword
from strainsight.decks.faults import OR_CONFIG
from strainsight.errors import DeckError
from strainsight.mesh.anisotropic import Anisotropic, Orientation
from strainsight.mesh.composite_solids import CompositeSolid
from strainsight.mesh.laminates import Lamina, Laminate
from strainsight.mesh.model import FloatArray, IntArray, Material, Region
from strainsight.mesh.thin import BeamSection, ShellSection

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
    """region (m,) of each element, 0 of those that are not imported; the regions, one a section; their materials,
    laminae those of plies, anisotropic those of solids that are, with the axes of regions of these, composites those
    with layers.

    sections: region → section of its shells, beams or rods; offset: region → where their middle lies from their nodes, along the
    normal of a shell, along n1 and n2 of a beam; direction (3,): n1 of a beam, x of the material of a shell; left (k,): rows of
    the shells, beams and rods without a section.
    """

    region: IntArray
    regions: dict[int, Region]
    materials: dict[int, Material]
    laminae: dict[int, Lamina]
    anisotropic: dict[int, Anisotropic]
    orientations: dict[int, Orientation]
    composites: dict[int, CompositeSolid]
    sections: dict[int, ShellSection | BeamSection | Laminate]
    offset: dict[int, FloatArray]
    direction: dict[int, FloatArray]
    left: IntArray


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
    made = Materials(definitions(keywords), stated, assembly.notes)
    family = assembly.families
    found = Sections(
        np.zeros(len(family), dtype=np.int64),
        {},
        made.found,
        made.laminae,
        made.solids,
        {},
        {},
        {},
        {},
        {},
        np.zeros(0, dtype=np.int64),
    )
    left = [found.left]
    for scope in assembly.scopes.values():
        for keyword in scope.part.keywords:
            if keyword.name not in FOR:
                continue
            rows = assembly.element_set(keyword.needs("ELSET"), scope, keyword)
            known = rows[family[rows] != ""]
            if not known.size and (rows.size or keyword.name != "SOLIDSECTION"):
                continue
            _check_family(assembly, keyword, known, family)
            if (taken := known[found.region[known] > 0]).size:
                raise keyword.error(
                    f"element {assembly.element_ids[taken[0]]} is in the section of "
                    f"{found.regions[int(found.region[taken[0]])].name} already",
                    "let every element belong to one section",
                )
            try:
                _add(assembly, scope, keyword, known, family, made, found, set_name)
            except DeckError:
                if required or keyword.name == "SOLIDSECTION":
                    raise
                left.append(known)
    left.append(_without(assembly, found, family, np.concatenate(left), required, stated))
    gone = np.unique(np.concatenate(left))
    gone = gone[found.region[gone] == 0]
    ignored.update(Counter(f"*ELEMENT, TYPE={assembly.type[row]}" for row in gone.tolist()))
    if made.unused:
        ignored["*MATERIAL that no section refers to"] += made.unused
    return replace(found, left=gone)


def _check_family(assembly: Assembly, keyword: Keyword, rows: IntArray, family: np.ndarray) -> None:
    other = rows[~np.isin(family[rows], FOR[keyword.name])]
    if other.size:
        row = int(other[0])
        raise keyword.error(
            f"{assembly.element(row)} is a {'truss' if family[row] == 'rod' else family[row]} ({other.size} such elements)",
            f"take it out of the element set, and give it a {WANTED[str(family[row])]}",
        )


def _add(
    assembly: Assembly,
    scope: Scope,
    keyword: Keyword,
    rows: IntArray,
    family: np.ndarray,
    made: Materials,
    found: Sections,
    set_name: dict[tuple[str, str], str],
) -> None:
    """A region of the elements in rows (k,)."""
    number, offset, direction = len(found.regions) + 1, np.zeros(2), np.full(3, np.nan)
    section: ShellSection | BeamSection | Laminate | None = None
    name = _region_name(assembly, keyword, scope, set_name)
    material = None
    if keyword.name == "SOLIDSECTION":
        rods = family[rows] == "rod"
        if "COMPOSITE" in keyword.parameters:
            found.composites[number] = composite_solid(assembly, scope, keyword, rows, made)
            material = 0  # those of its layers
        if made.anisotropic(keyword):
            if rods.any():
                raise keyword.error(
                    f"{assembly.element(int(rows[np.argmax(rods)]))} is a truss, and its material is anisotropic",
                    "give trusses an isotropic material",
                )
            found.orientations[number] = solid_orientation(assembly, scope, keyword)
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
    found.regions[number] = Region(number, name, material)
    found.region[rows] = number
    if section is not None:
        found.sections[number], found.offset[number], found.direction[number] = section, offset, direction


def _truss(keyword: Keyword, notes: list[str]) -> BeamSection:
    """Area of the trusses of a *SOLID SECTION, 1 where it states none."""
    rows = keyword.rows(needed=False)
    if not rows or not rows[0].text(0):
        notes.append(f"{keyword.where}: {keyword.title} states no area of its trusses: taken as 1, as Abaqus does")
        return BeamSection(1.0)
    area = rows[0].real(0, "the area")
    if not area > 0:
        raise rows[0].error(f"the area is {area:g}, not positive", "give a positive area")
    return BeamSection(area)


def _without(
    assembly: Assembly, found: Sections, family: np.ndarray, left: IntArray, required: bool, stated: bool
) -> IntArray:
    """Solids without section are a region, unless it has to be stated; rows of other elements without one, unless required."""
    without = np.flatnonzero((family != "") & (found.region == 0))
    without = np.setdiff1d(without, left)
    solid = without[family[without] == "solid"]
    if solid.size and not stated:
        number = len(found.regions) + 1
        found.regions[number] = Region(number, "without section", 0)
        found.region[solid] = number
    elif solid.size:
        raise assembly.element_error(
            int(solid[0]),
            f"has no section ({solid.size} elements)",
            f"add a *SOLID SECTION with its element set and a material{OR_CONFIG}",
        )
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


def _region_name(assembly: Assembly, keyword: Keyword, scope: Scope, set_name: dict[tuple[str, str], str]) -> str:
    within, written = assembly.split_name(keyword.parameters["ELSET"], scope)
    return set_name.get((within.name, written.upper()), written)
