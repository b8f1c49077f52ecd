"""Read a mesh file of any format into a `Mesh` in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from strainsight.decks.text import error_at
from strainsight.errors import UserError
from strainsight.mesh.assigned_sections import GivenSection
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.node_order import check_node_order
from strainsight.mesh.units import length_factor, mass_factor, rescaled, to_si

FORMATS = {
    "nastran": (".bdf", ".nas", ".dat", ".blk", ".bulk", ".fem"),
    "abaqus": (".inp",),
    "gmsh": (".msh",),
    "frd": (".frd",),
}
"""Reader → file name endings; meshio reads all others."""


def read_mesh(
    path: Path,
    length_unit: str = "m",
    mass_unit: str = "kg",
    *,
    format: str = "auto",
    region_data: str | None = None,
    solids: bool = True,
    materials: bool = True,
    ignore: Sequence[str] = (),
    spc: int | None = None,
    step: int | None = None,
    sections: Mapping[str, GivenSection] | None = None,
    include: Sequence[Path] = (),
    contact: Literal["bonded", "open"] | None = None,
) -> Mesh:
    """Read a mesh or deck and convert it to m, kg, s. The time unit of the file is the second.

    format: nastran, abaqus, gmsh, frd, meshio, or auto by the ending of the name (.gz is removed first). region_data: cell
    data with region ids, for meshio. solids: require solid elements. materials: require the deck to define the materials of
    its solids; otherwise a region may have no material, and elements without a region form one. ignore: cards, keywords and
    element types of a deck to leave out. spc: support set of a Nastran deck, instead of the one in its case control. step:
    step of an Abaqus deck that defines supports and elements. sections: config key → section in SI units of triangles,
    quadrilaterals or lines of a file without sections. include: further folders from which a deck may include files.
    contact: whether surfaces of a deck that are in contact are bonded where they touch, or open.
    Raises DeckError for a file that cannot be imported, UserError for an unknown unit."""
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    path = Path(path)
    if not path.is_file():
        raise error_at(
            path,
            "no such file" if not path.exists() else "not a file",
            "correct the file name; a relative path is relative to the folder of the config file",
        )
    format = format_of(path) if format == "auto" else format
    for value, key, of, program in ((spc, "spc", "nastran", "Nastran"), (step, "step", "abaqus", "Abaqus")):
        if value is not None and format != of:
            raise UserError(
                f"{path.name} is not a {program} deck, and mesh.{key} applies only to {program} decks",
                remedy=f"remove mesh.{key}",
            )
    if sections and format in ("nastran", "abaqus"):
        raise UserError(
            f"{path.name} is a Nastran or Abaqus deck, which must define the sections itself",
            key=next(iter(sections)),
            remedy="remove this key, and define the sections in the deck (Nastran: PSHELL, PBAR; Abaqus: *SHELL SECTION, "
            "*BEAM SECTION)",
        )
    if sections and format == "frd":
        raise UserError(
            f"only solids are imported from {path.name}, and solids have no section",
            key=next(iter(sections)),
            remedy="remove this key",
        )
    own_units = rescaled(sections or {}, 1 / L, 1 / M)
    if format == "nastran":
        from strainsight.decks.nastran.deck import read_nastran

        mesh = read_nastran(
            path, required=solids, materials_required=materials, ignore=ignore, spc=spc, include=include
        )
    elif format == "abaqus":
        from strainsight.decks.abaqus.deck import read_abaqus

        mesh = read_abaqus(
            path,
            required=solids,
            materials_required=materials,
            ignore=ignore,
            include=include,
            contact=contact,
            step=step,
        )
    elif format == "gmsh":
        from strainsight.decks.gmsh.mesh import read_gmsh

        mesh = read_gmsh(path, required=solids, sections=own_units)
    elif format == "frd":
        from strainsight.decks.frd import read_frd_mesh

        mesh = read_frd_mesh(path, required=solids)
    else:
        from strainsight.decks.other.mesh import read_meshio

        mesh = read_meshio(path, region_data, required=solids, sections=own_units)
    with mesh.located():
        check_node_order(mesh)
        exterior_facets(mesh)  # detects elements that do not fit together
    return to_si(mesh, length_unit, mass_unit)


def format_of(path: Path) -> str:
    """Reader of a file, from the ending of its name, and for .msh from its first line."""
    endings = [ending.lower() for ending in path.suffixes if ending.lower() != ".gz"]
    ending = endings[-1] if endings else ""
    reader = next((name for name, known in FORMATS.items() if ending in known), "meshio")
    if reader == "gmsh":
        from strainsight.decks.gmsh.sections import is_gmsh

        return reader if is_gmsh(path) else "meshio"
    return reader
