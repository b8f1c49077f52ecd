"""Where a strain gauge can sit: exterior facets, and directions on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from strainsight.errors import InfeasibleError, UserError
from strainsight.gauges.surface import facet_centres
from strainsight.gauges.zones import Zone, inside
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh

STEEPEST = 10.0
"""Degrees: an axis nearer than this to a facet's normal has no trustworthy projection on it."""


@dataclass(frozen=True)
class Candidates:
    """Gauges that could be glued, m of them: facet after facet, on each its angles in the order given.

    element (m,) ids of the file; facet (m,) local number from 1; kind (m,) codes into FACET_KINDS; nodes (m, 8)
    indices padded with −1; position (m, 3) [m] the facet's centre; normal (m, 3) outward; direction (m, 3) unit,
    tangent; angle (m,) [deg].
    """

    element: np.ndarray
    facet: np.ndarray
    kind: np.ndarray
    nodes: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    direction: np.ndarray
    angle: np.ndarray

    def __len__(self) -> int:
        return len(self.element)

    def take(self, index: np.ndarray) -> Candidates:
        """Those at `index`, in its order."""
        return Candidates(*(getattr(self, field.name)[index] for field in fields(self)))


def candidates(
    mesh: Mesh,
    facets: Facets,
    axis: Sequence[float],
    angles: Sequence[float] = (0.0,),
    exclude: Sequence[Zone] = (),
    surface: str = "all",
    on_constraints: bool = False,
) -> Candidates:
    """One gauge at the centre of every admissible exterior facet for every angle α about the outward normal n:

        d₀ ∥ a − (a·n) n,     d = cos α d₀ + sin α n × d₀

    axis a (3,) of any length; angles [deg]; exclude zones; surface "all" or the name of an element or node set (a
    facet belongs to a node set with all its nodes). Facets that touch an SPC, RBE2 or RBE3 node are left out unless
    on_constraints.
    Raises UserError for a set that is not there and an axis of no length, InfeasibleError where no facet is left or
    the axis comes within 10° of a facet's normal.
    """
    a = np.asarray(axis, dtype=float)
    length = np.linalg.norm(a)
    if a.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise UserError(f"the gauge axis is {tuple(axis)}", remedy="give three numbers, not all zero")
    chosen = _on_surface(mesh, facets, surface)
    free = np.ones(len(chosen), dtype=bool) if on_constraints else ~_on_constraints(mesh, facets)
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    outside = np.any(normal != 0, axis=1)
    for zone in exclude:
        outside &= ~inside(zone, mesh, facets, centre, normal)
    keep = np.flatnonzero(chosen & free & outside)
    if keep.size == 0:
        raise InfeasibleError(
            f"no facet is left for a gauge: {len(chosen)} exterior, {np.count_nonzero(chosen)} of them on the surface "
            f"{surface!r}, {np.count_nonzero(chosen & free)} away from constrained nodes",
            remedy="choose another surface or smaller zones to exclude",
        )
    a = a / length
    n = normal[keep]
    steep = np.abs(n @ a) > np.cos(np.deg2rad(STEEPEST))
    if steep.any():
        first = keep[np.argmax(steep)]
        raise InfeasibleError(
            f"the gauge axis is within {STEEPEST:g}° of the normal of {np.count_nonzero(steep)} of {keep.size} facets "
            f"(element {facets.element_id[first]}, facet {facets.facet[first]}): it has no direction there",
            remedy="choose another gauges.direction.axis, restrict gauges.surface, or leave such facets out: "
            f"gauges.exclude: [{{normal_cone: {{axis: [{a[0]:.3g}, {a[1]:.3g}, {a[2]:.3g}], angle: {STEEPEST:g}}}}}]",
        )
    d0 = a - (n @ a)[:, None] * n
    d0 /= np.linalg.norm(d0, axis=1)[:, None]
    alpha = np.deg2rad(np.asarray(angles, dtype=float))
    d = np.cos(alpha)[:, None] * d0[:, None] + np.sin(alpha)[:, None] * np.cross(n, d0)[:, None]
    each = np.repeat(keep, len(alpha))
    return Candidates(
        facets.element_id[each],
        facets.facet[each],
        facets.kind[each],
        facets.nodes[each],
        centre[each],
        normal[each],
        d.reshape(-1, 3),
        np.tile(np.asarray(angles, dtype=float), keep.size),
    )


def _on_surface(mesh: Mesh, facets: Facets, surface: str) -> np.ndarray:
    if surface == "all":
        return np.ones(len(facets.element_id), dtype=bool)
    elements, nodes = surface in mesh.element_sets, surface in mesh.node_sets
    if elements and nodes:
        raise UserError(
            f"{surface!r} is both an element set and a node set", remedy="rename one of them in the mesh file"
        )
    if elements:
        return np.isin(facets.element_id, mesh.element_sets[surface])
    if nodes:
        inside = np.isin(mesh.node_ids, mesh.node_sets[surface])
        return np.all(_among(facets, inside) | (facets.nodes < 0), axis=1)
    known = ", ".join(sorted({*mesh.element_sets, *mesh.node_sets})) or "none"
    raise UserError(f"the set {surface!r} is not in the mesh", remedy=f'use "all" or one of its sets: {known}')


def _on_constraints(mesh: Mesh, facets: Facets) -> np.ndarray:
    held = np.zeros(len(mesh.position), dtype=bool)
    held[mesh.fixed.reshape(-1, 2)[:, 0]] = True
    for rigid in mesh.rigid:
        held[[rigid.reference, *rigid.nodes]] = True
    for averaging in mesh.averaging:
        held[[averaging.reference, *averaging.nodes]] = True
    return np.any(_among(facets, held), axis=1)


def _among(facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """Which of the facets' nodes (f, 8) are among the chosen (n,) nodes; the padding is not."""
    return chosen[facets.nodes] & (facets.nodes >= 0)
