"""*CYCLIC SYMMETRY MODEL of a CalculiX deck: a sector, made the whole ring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.surfaces import Surface
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.abaqus.ties import SECTOR, TOLERANCE, cyclic_ties, following, surface_of
from strainsight.decks.faults import Doubt
from strainsight.decks.text import parse_integer, parse_real
from strainsight.errors import UserError
from strainsight.mesh.cyclic import Ring, whole_ring
from strainsight.mesh.model import IntArray, Mesh


def with_whole_ring(
    mesh: Mesh, assembly: Assembly, found: dict[tuple[str, str], Surface]
) -> tuple[Mesh, dict[tuple[str, str], Surface]]:
    """The mesh, and its surfaces, of the whole ring where the deck is a sector, see `whole_ring`, and a note on it: N of *CYCLIC
    SYMMETRY MODEL, its axis, and the cut faces of the *TIE, CYCLIC SYMMETRY. Nodes of the first of these that meet none of the
    second follow its facets.

    Faces of a model with CONTACT press on those of the next sector, as their *CONTACT PAIR says, and are no cut. Raises DeckError
    for sectors of several numbers or axes (multistage), and for what `whole_ring` refuses.
    """
    models = list(assembly.keywords(SECTOR))
    if not models:
        return mesh, found
    first = models[0][1]
    count, axis = _of(first)
    for _, keyword in models[1:]:
        if _of(keyword)[0] != count or not np.allclose(_of(keyword)[1], axis):
            raise keyword.error(
                f"sectors of another number or axis than those of {first.where}",
                "a structure of several stages is not made whole: mesh all of it",
            )
    touching = {k.parameters.get("TIE", "").upper() for _, k in models if "CONTACT" in k.parameters}
    ties = [(s, tie) for s, tie in cyclic_ties(assembly) if tie.parameters.get("NAME", "").upper() not in touching]
    cuts = [(row, *_cut(row, assembly, scope, found)) for scope, tie in ties for row in tie.rows()]
    if not cuts:
        raise first.error("no *TIE, CYCLIC SYMMETRY has its cut faces", "add it, with the two surfaces")
    a, b = axis.reshape(2, 3)
    try:
        ring = whole_ring(mesh, count, a, b - a, [(one.nodes, other.nodes) for _, one, other in cuts])
    except UserError as error:
        raise first.error(error.what, error.remedy or "") from None
    made = _with_loose(ring, cuts, assembly)
    surfaces = {key: _whole(surface, ring.at) for key, surface in found.items()}
    n = len(mesh.position)
    loose = sum(len(own) for own, _ in ring.loose)
    met = count * n - len(ring.mesh.position)
    own = [region.name for number, region in mesh.regions.items() if number + ring.shift in ring.mesh.regions]
    assembly.notes.append(
        f"{first.where}: the sector is made a whole ring of {count}: {len(ring.mesh.position)} nodes, ids of copy j are those of "
        f"the sector + j × {ring.shift}; {met} nodes of cut faces and the axis became others"
        + f", {loose} follow the facets of the opposite face" * bool(loose)
        + (f"; {', '.join(own)}, whose axes turn: a region in each, as '{own[0]} (sector 2)'" if own else "")
        + "; sets and loads are on every copy, SECTOR-1, SECTOR-2, … have one each"
    )
    return made, surfaces


def _of(keyword: Keyword) -> tuple[int, np.ndarray]:
    """The number of sectors, and two points (6,) on the axis."""
    count = parse_integer(keyword.needs("N"))
    if count is None or count < 2:
        raise keyword.error(f"N is {keyword.parameters['N']!r}, no number of sectors", "give an integer above 1")
    axis = keyword.rows()[0].reals(6, "a coordinate")
    if np.allclose(axis[:3], axis[3:]):
        raise keyword.error("the two points of its axis are one", "give two points on the axis")
    return count, axis


def _cut(
    row: Row, assembly: Assembly, scope: Scope, found: Mapping[tuple[str, str], Surface]
) -> tuple[Surface, Surface]:
    one, other = (surface_of(row, i, assembly, scope, found) for i in (0, 1))
    if not len(one.nodes) or not len(other.nodes):
        raise row.error("a cut face has no nodes", "correct the surface")
    return one, other


def _with_loose(ring: Ring, cuts: list[tuple[Row, Surface, Surface]], assembly: Assembly) -> Mesh:
    """The ring, with nodes of cut faces that meet no other node following the facets there."""
    mesh = ring.mesh
    for (row, _, other), (nodes, onto) in zip(cuts, ring.loose, strict=True):
        if not len(nodes):
            continue
        given = row.keyword.parameters.get("POSITIONTOLERANCE", "")
        spacing = np.asarray(cKDTree(mesh.position[onto]).query(mesh.position[onto], k=2)[0])[:, 1].mean()
        within = parse_real(given) if given else 2 * TOLERANCE * float(spacing)
        if within is None:
            raise row.keyword.error("POSITION TOLERANCE is no number", "give a distance")
        try:
            mesh, tied = following(mesh, row, nodes, onto, within, "*TIE, CYCLIC SYMMETRY")
        except UserError as error:
            raise row.error(error.what, error.remedy or "") from None
        if tied < len(nodes):
            off = (
                f"{len(nodes) - tied} nodes of cut faces lie more than {within:.3g} off {other.name} of the next sector"
            )
            assembly.notes.append(
                Doubt(f"{row.where}: {off}, and are free: check the number of sectors, and the mesh there")
            )
    return mesh


def _whole(surface: Surface, at: IntArray) -> Surface:
    """A surface on every copy."""
    nodes, first = np.unique(at[:, surface.nodes], return_index=True)
    weight = np.tile(surface.weight, len(at))[first]
    facets = tuple((kind, np.concatenate([own[rows] for own in at])) for kind, rows in surface.facets)
    return replace(surface, nodes=nodes, weight=weight, facets=facets)
