"""Any mesh file in, a `Mesh` in SI units out."""

from __future__ import annotations

from pathlib import Path

from strainsight.errors import DeckError
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.nastran import read_nastran
from strainsight.mesh.units import length_factor, mass_factor, to_si

NASTRAN_SUFFIXES = (".bdf", ".nas", ".dat", ".blk", ".bulk")


def read_mesh(path: Path, length_unit: str = "m", mass_unit: str = "kg") -> Mesh:
    """Read a deck and convert it to m, kg, s (the deck's time unit is the second).

    Nastran bulk data (.bdf, .nas, .dat, .blk, .bulk). Other formats carry no materials and
    supports: they are refused.
    Raises DeckError for a file that cannot be taken over, UserError for an unknown unit.
    """
    length_factor(length_unit)
    mass_factor(mass_unit)
    path = Path(path)
    if not path.is_file():
        raise DeckError(
            "no such file" if not path.exists() else "not a file",
            where=str(path),
            remedy="check the name; a relative path counts from the config file",
        )
    if path.suffix.lower() not in NASTRAN_SUFFIXES:
        raise DeckError(
            f"a {path.suffix or 'suffixless'} file: regions, materials and supports must come with the mesh",
            where=str(path),
            remedy=f"export a Nastran deck ({', '.join(NASTRAN_SUFFIXES)}) with MAT1, PSOLID and SPC1 cards",
        )
    mesh = read_nastran(path)
    exterior_facets(mesh)  # so that elements that do not fit together show here
    return to_si(mesh, length_unit, mass_unit)
