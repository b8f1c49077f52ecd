"""Any mesh file in, a `Mesh` in SI units out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from strainsight.decks.text import error_at
from strainsight.errors import UserError
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.given_sections import GivenSection
from strainsight.mesh.model import Mesh
from strainsight.mesh.node_order import check_node_order
from strainsight.mesh.units import length_factor, mass_factor, rescaled, to_si

FORMATS = {
    "nastran": (".bdf", ".nas", ".dat", ".blk", ".bulk", ".fem"),
    "abaqus": (".inp",),
    "gmsh": (".msh",),
    "frd": (".frd",),
}
"""Reader → endings of the names it reads; meshio reads the rest."""


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
    given: Mapping[str, GivenSection] | None = None,
    include: Sequence[Path] = (),
    contact: Literal["bonded", "open"] | None = None,
) -> Mesh:
    """Read a mesh or deck and convert it to m, kg, s (its time unit is the second).

    format: nastran, abaqus, gmsh, frd, meshio, or auto by the ending of the name (.gz before it is passed over). region_data:
    the cell data that holds region ids, for meshio. solids: there has to be one. materials: a deck has to state those of its
    solids; otherwise a region may be without, or elements without a region of their own are one. ignore: cards, keywords and
    types of elements of a deck that are left out, whatever they say. spc: set of supports of a Nastran deck, in
    place of what its case control selects; step: of an Abaqus deck, whose supports and elements count. given: key of the
    config → section in SI units of triangles, quadrangles or lines of a file that has no sections. include: folders beside that
    of a deck from which it may include files.
    contact: whether surfaces of a deck that are in contact are joined where they touch, or not.
    Raises DeckError for a file that cannot be imported, UserError for an unknown unit.
    """
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    path = Path(path)
    if not path.is_file():
        raise error_at(
            path,
            "no such file" if not path.exists() else "not a file",
            "check the name; a relative path counts from the config file",
        )
    format = format_of(path) if format == "auto" else format
    for value, key, of, program in ((spc, "spc", "nastran", "Nastran"), (step, "step", "abaqus", "Abaqus")):
        if value is not None and format != of:
            raise UserError(f"{path.name} is no {program} deck, which mesh.{key} is of", remedy="remove the key")
    if given and format in ("nastran", "abaqus"):
        raise UserError(
            f"{path.name} is a deck, which states its sections itself",
            key=next(iter(given)),
            remedy="remove the key, and give the deck's elements a property (PSHELL, PBAR, *SHELL SECTION, *BEAM SECTION)",
        )
    if given and format == "frd":
        raise UserError(
            f"of {path.name} solids are read, which have no section", key=next(iter(given)), remedy="remove the key"
        )
    sections = rescaled(given or {}, 1 / L, 1 / M)
    if format == "nastran":
        from strainsight.decks.nastran.deck import read_nastran

        mesh = read_nastran(path, required=solids, stated=materials, ignore=ignore, spc=spc, include=include)
    elif format == "abaqus":
        from strainsight.decks.abaqus.deck import read_abaqus

        mesh = read_abaqus(
            path, required=solids, stated=materials, ignore=ignore, include=include, contact=contact, step=step
        )
    elif format == "gmsh":
        from strainsight.decks.gmsh.mesh import read_gmsh

        mesh = read_gmsh(path, required=solids, given=sections)
    elif format == "frd":
        from strainsight.decks.frd import read_frd_mesh

        mesh = read_frd_mesh(path, required=solids)
    else:
        from strainsight.decks.other.mesh import read_meshio

        mesh = read_meshio(path, region_data, required=solids, given=sections)
    with mesh.located():
        check_node_order(mesh)
        exterior_facets(mesh)  # so that elements that do not fit together show here
    return to_si(mesh, length_unit, mass_unit)


def format_of(path: Path) -> str:
    """Which reader a file is for: by the ending of its name, and for .msh by its first line."""
    endings = [ending.lower() for ending in path.suffixes if ending.lower() != ".gz"]
    ending = endings[-1] if endings else ""
    found = next((name for name, known in FORMATS.items() if ending in known), "meshio")
    if found == "gmsh":
        from strainsight.decks.gmsh.mesh import is_gmsh

        return found if is_gmsh(path) else "meshio"
    return found
