"""Which facets of a surface may carry a gauge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.errors import InfeasibleError, blame
from strainsight.mesh.facets import Facets
from strainsight.mesh.lying_on import covered
from strainsight.mesh.model import Mesh
from strainsight.sensors.surface import facet_centres
from strainsight.sensors.zones import Zone, inside, on_surface


def admissible(
    mesh: Mesh,
    facets: Facets,
    *,
    surface: str = "all",
    include: Sequence[Zone] = (),
    exclude: Sequence[Zone] = (),
    on_constraints: bool = False,
    key: str = "gauges",
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices (k,) of the facets that may carry gauges; centre (f, 3) [m] and outward normal (f, 3) of all facets.

    surface "all" or the name of a face, an element or node set (a facet belongs to a node set with all its nodes); facets on
    which another element lies that does not have their nodes are left out, and unless on_constraints those that touch an SPC,
    RBE2 or RBE3 node; include: in at least one of these zones, none: everywhere; exclude: in none of these. key: the section of
    the config that asks, to name what leaves no facet.
    Raises UserError for a set that is not there, InfeasibleError where no facet is left.
    """
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    left = np.ones(len(facets.element_id), dtype=bool)
    trail = [f"{len(left)} exterior"]

    def steps() -> Iterator[tuple[str, str, np.ndarray]]:
        with blame(f"{key}.surface"):
            every = np.ones(len(left), dtype=bool)
            chosen = every if surface == "all" else on_surface(mesh, facets, surface)
        yield f"{key}.surface", f"on the surface {surface!r}", chosen
        yield f"{key}.surface", "with an area", np.any(normal != 0, axis=1)
        if (lies := covered(mesh, facets)).any():
            yield "mesh.file", "that nothing lies on", ~lies
        if not on_constraints:
            yield f"{key}.surface", "away from constrained nodes", ~_on_constraints(mesh, facets)
        if include:
            with blame(f"{key}.include"):
                zones = [inside(zone, mesh, facets, centre, normal) for zone in include]
            yield f"{key}.include", "in zones to include", np.any(zones, axis=0)
        for i, zone in enumerate(exclude):
            with blame(f"{key}.exclude.{i}"):
                taken = inside(zone, mesh, facets, centre, normal)
            yield f"{key}.exclude.{i}", f"outside exclude.{i}", ~taken

    for where, what, mask in steps():
        before, left = left, left & mask
        trail.append(f"{np.count_nonzero(left)} {what}")
        if not left.any():
            raise InfeasibleError(
                f"no facet is left for a gauge, {where} takes the last {np.count_nonzero(before)}: {', '.join(trail)}",
                key=where,
                remedy="choose another surface, larger zones to include or smaller zones to exclude",
            )
    return np.flatnonzero(left), centre, normal


def _on_constraints(mesh: Mesh, facets: Facets) -> np.ndarray:
    held = np.zeros(len(mesh.position), dtype=bool)
    held[mesh.held] = True
    for rigid in mesh.rigid:
        held[[rigid.reference, *rigid.nodes]] = True
    for averaging in mesh.averaging:
        held[[averaging.reference, *averaging.nodes]] = True
    for relation in mesh.relations:
        held[relation.node] |= relation.ties
    for own in mesh.springs:
        held[own.node] = True
    return np.any(_among(facets, mesh.above(held)), axis=1)


def _among(facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """Which of the facets' nodes (f, 8) are among the chosen (n,) nodes; the padding is not."""
    return chosen[facets.nodes] & (facets.nodes >= 0)
