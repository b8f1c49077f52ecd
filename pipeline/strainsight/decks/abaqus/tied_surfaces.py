"""*TIE of an Abaqus deck: the nodes of one surface follow the facets of another that they lie on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.surfaces import Surface
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import Doubt
from strainsight.decks.numbers import parse_real
from strainsight.errors import UserError
from strainsight.mesh.model import IntArray, Mesh, Origin
from strainsight.mesh.surface_ties import with_surface_tie
from strainsight.mesh.thin import nodes_that_turn

PLAIN = {"NAME", "ADJUST", "POSITIONTOLERANCE", "TYPE", "NOROTATION", "CONSTRAINTRATIO", "TIEDNSET", "INPUT"}
"""Options of a *TIE that joins two surfaces; others make it a symmetry, or a tie of something else."""
TOLERANCE = 0.05
"""Of the mean size of the facets: how far off nodes may lie where the deck does not say (Abaqus; CalculiX: 0.025)."""


SECTOR = "CYCLICSYMMETRYMODEL"
"""The name of the keyword that makes a deck a sector."""
OF_THIN, OTHER = "*TIE that joins shells or beams", "*TIE that is a symmetry"
"""What a *TIE that is not supported is called, so that `mesh.ignore` can name it and keep the others."""


def plain_ties(assembly: Assembly) -> list[tuple[Scope, Keyword]]:
    """The *TIE that join surfaces; cyclic symmetry and the like are none."""
    return [(scope, keyword) for scope, keyword in assembly.keywords("TIE") if set(keyword.parameters) <= PLAIN]


def cyclic_ties(assembly: Assembly) -> list[tuple[Scope, Keyword]]:
    """The *TIE of cut faces, in a deck that is a sector."""
    if not any(True for _ in assembly.keywords(SECTOR)):
        return []
    return [pair for pair in assembly.keywords("TIE") if "CYCLICSYMMETRY" in pair[1].parameters]


def with_tied_surfaces(
    mesh: Mesh, assembly: Assembly, found: Mapping[tuple[str, str], Surface]
) -> tuple[Mesh, dict[str, list[str]]]:
    """A mesh in which the nodes of the first surface of each *TIE follow the second, see `with_surface_tie`; nodes that lie
    farther off than POSITION TOLERANCE, or than `TOLERANCE` of a facet, are left out, with a note, as in Abaqus and CalculiX.

    Beside it the *TIE that are not supported, `OTHER` and, where nodes of the first one turn (shells, beams) or the second one is
    not of solids, `OF_THIN` → file:line of each.
    Raises DeckError for surfaces that are not in the deck, and where no node of the first lies on the second.
    """
    plain = plain_ties(assembly)
    taken = [*plain, *cyclic_ties(assembly)]
    others = [keyword.where for pair in assembly.keywords("TIE") if pair not in taken for keyword in pair[1:]]
    refused = {OTHER: others} if others else {}
    for scope, keyword in plain:
        for row in keyword.rows():
            first, second = (surface_of(row, i, assembly, scope, found) for i in (0, 1))
            size = facet_size(mesh, first, second)
            if size is None:
                refused.setdefault(OF_THIN, []).append(row.where)
                continue
            given = keyword.parameters.get("POSITIONTOLERANCE", "")
            within = parse_real(given) if given else TOLERANCE * size
            if within is None:
                raise keyword.error("POSITION TOLERANCE is no number", "give a distance")
            name = f"*TIE {keyword.parameters.get('NAME', '')}".strip()
            try:
                mesh, tied = following(mesh, row, first.nodes, second.nodes, within, name)
            except UserError as error:
                raise row.error(error.what, error.remedy or "") from None
            left = len(np.setdiff1d(first.nodes, second.nodes)) - tied
            said = f"{row.where}: {tied} nodes of {first.name} follow {second.name} ({name})"
            if left:
                off = f"{left} of {tied + left} others lie more than {within:.3g} off, and are not tied"
                ways = "give *TIE a larger POSITION TOLERANCE, or tie them in the config (mesh.ties, type: surface)"
                said = Doubt(f"{said}; {off}: {ways}")
            assembly.notes.append(said)
    return mesh, refused


def facet_size(mesh: Mesh, first: Surface, second: Surface) -> float | None:
    """The mean size of the facets of the second surface; None where it is not of solids, or nodes of the first one turn."""
    turning = nodes_that_turn(mesh.shells, mesh.beams)
    solid = [nodes for _, nodes in second.facets if not np.isin(nodes, turning).any()]
    if not solid or len(solid) < len(second.facets) or np.isin(first.nodes, turning).any():
        return None
    corners = [mesh.position[nodes].mean(axis=1, keepdims=True) - mesh.position[nodes] for nodes in solid]
    return 2 * float(np.mean(np.concatenate([np.linalg.norm(own, axis=2).max(axis=1) for own in corners])))


def following(mesh: Mesh, row: Row, nodes: IntArray, onto: IntArray, within: float, name: str) -> tuple[Mesh, int]:
    """The mesh whose nodes (k,) follow the facets of nodes (m,) where they are within reach, by relations that stand at the
    row, and how many do. Raises UserError where none is."""
    before = len(mesh.relations)
    mesh = with_surface_tie(mesh, nodes, onto, within, name, far="left")
    made, origin = len(mesh.relations) - before, mesh.origin["relation"]
    file = row.keyword.files[row.i]
    files = origin.files if file in origin.files else (*origin.files, file)
    more = Origin(
        np.arange(1, before + made + 1),
        np.append(origin.line, np.full(made, row.keyword.numbers[row.i])),
        np.append(origin.file, np.full(made, files.index(file))),
        files,
    )
    return replace(mesh, origin={**mesh.origin, "relation": more}), made // 3


def surface_of(row: Row, i: int, assembly: Assembly, scope: Scope, found: Mapping[tuple[str, str], Surface]) -> Surface:
    """The surface that entry i of a row names; DeckError where there is none."""
    within, name = assembly.split_name(row.text(i), scope)
    surface = found.get((within.name.upper(), name.upper()))
    if surface is None:
        raise row.error(f"surface {row.text(i)!r} is not in the deck, or of another type", "add the *SURFACE")
    return surface
