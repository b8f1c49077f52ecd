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
from strainsight.mesh.model import Mesh, Origin
from strainsight.mesh.surface_ties import with_surface_tie, without_held
from strainsight.mesh.thin import nodes_that_turn

PLAIN = {"NAME", "ADJUST", "POSITIONTOLERANCE", "TYPE", "NOROTATION", "CONSTRAINTRATIO", "TIEDNSET", "INPUT"}
"""Options of a *TIE that joins two surfaces; others make it a symmetry, or a tie of something else."""
TOLERANCE = 0.05
"""Of the mean size of the facets: how far off nodes may lie where the deck does not say (Abaqus; CalculiX: 0.025)."""


OF_THIN, OTHER = "*TIE that joins shells or beams", "*TIE that is a symmetry"
"""What a *TIE that is not supported is called, so that `mesh.ignore` can name it and keep the others."""


def plain_ties(assembly: Assembly) -> list[tuple[Scope, Keyword]]:
    """The *TIE that join surfaces; cyclic symmetry and the like are none."""
    return [(scope, keyword) for scope, keyword in assembly.keywords("TIE") if set(keyword.parameters) <= PLAIN]


def with_tied_surfaces(
    mesh: Mesh, assembly: Assembly, found: Mapping[tuple[str, str], Surface]
) -> tuple[Mesh, dict[str, list[str]]]:
    """A mesh in which the nodes of the first surface of each *TIE follow the second, see `with_surface_tie`; nodes that lie
    farther off than POSITION TOLERANCE, or than `TOLERANCE` of a facet, are left out, with a note, as in Abaqus and CalculiX.

    Beside it the *TIE that are not supported, `OTHER` and, where nodes of the first one turn (shells, beams) or the second one is
    not of solids, `OF_THIN` → file:line of each.
    Raises DeckError for surfaces that are not in the deck, and where no node of the first lies on the second.
    """
    origin = mesh.origin["relation"]
    where = [(origin.files[i], line) for i, line in zip(origin.file.tolist(), origin.line.tolist(), strict=True)]
    turning = nodes_that_turn(mesh.shells, mesh.beams)
    plain = plain_ties(assembly)
    others = [keyword.where for pair in assembly.keywords("TIE") if pair not in plain for keyword in pair[1:]]
    refused = {OTHER: others} if others else {}
    for scope, keyword in plain:
        for row in keyword.rows():
            first, second = (_surface(row, i, assembly, scope, found) for i in (0, 1))
            solid = [nodes for _, nodes in second.facets if not np.isin(nodes, turning).any()]
            if not solid or len(solid) < len(second.facets) or np.isin(first.nodes, turning).any():
                refused.setdefault(OF_THIN, []).append(row.where)
                continue
            corners = [mesh.position[nodes].mean(axis=1, keepdims=True) - mesh.position[nodes] for nodes in solid]
            size = 2 * float(np.mean(np.concatenate([np.linalg.norm(own, axis=2).max(axis=1) for own in corners])))
            given = keyword.parameters.get("POSITIONTOLERANCE", "")
            within = parse_real(given) if given else TOLERANCE * size
            if within is None:
                raise keyword.error("POSITION TOLERANCE is no number", "give a distance")
            name = f"*TIE {keyword.parameters.get('NAME', '')}".strip()
            before = len(mesh.relations)
            try:
                mesh = with_surface_tie(mesh, first.nodes, second.nodes, within, name, far="left")
            except UserError as error:
                raise row.error(error.what, error.remedy or "") from None
            tied = (len(mesh.relations) - before) // 3
            where += [(keyword.files[row.i], keyword.numbers[row.i])] * (3 * tied)
            left = len(np.setdiff1d(first.nodes, second.nodes)) - tied
            said = f"{row.where}: {tied} nodes of {first.name} follow {second.name} ({name})"
            if left:
                off = f"{left} of {tied + left} others lie more than {within:.3g} off, and are not tied"
                ways = "give *TIE a larger POSITION TOLERANCE, or tie them in the config (mesh.ties, type: surface)"
                said = Doubt(f"{said}; {off}: {ways}")
            assembly.notes.append(said)
    files = tuple(dict.fromkeys(file for file, _ in where))
    mesh = replace(
        mesh,
        origin={
            **mesh.origin,
            "relation": Origin(
                np.arange(1, len(where) + 1),
                np.array([line for _, line in where], dtype=np.int64),
                np.array([files.index(file) for file, _ in where], dtype=np.int64),
                files,
            ),
        },
    )
    return without_held(mesh), refused


def _surface(row: Row, i: int, assembly: Assembly, scope: Scope, found: Mapping[tuple[str, str], Surface]) -> Surface:
    within, name = assembly.split_name(row.text(i), scope)
    surface = found.get((within.name.upper(), name.upper()))
    if surface is None:
        raise row.error(f"surface {row.text(i)!r} is not in the deck, or of another type", "add the *SURFACE")
    return surface
