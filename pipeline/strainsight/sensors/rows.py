"""What a gauge reads of a displacement field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import sparse

from strainsight.errors import InfeasibleError
from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.properties import Thickness
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.misplaced import misplaced
from strainsight.sensors.points import Points, points_of, stays, surface_of
from strainsight.sensors.surface import by_kind, carried, facet_points, normals
from strainsight.sensors.walk import Skin


def channel_rows(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    *,
    facets: Facets | Skin | None = None,
    offset: np.ndarray | None = None,
    rotation: np.ndarray | None = None,
    thickness: Thickness | None = None,
) -> np.ndarray:
    """What every channel reads in every displacement field: `channel_matrix` times the field.

    field (3n, r) [m per unit], row 3·node + component; offset (gauges, 2) [m] and rotation (gauges,) [deg] misplace the
    gauges of the `grids`, see `misplaced`. An accelerometer has the row of a displacement sensor, for accelerations.
    Returns (m, r) [strain or m per unit]. Raises InfeasibleError where the grid of a gauge runs over a sharp edge.
    """
    if offset is not None or rotation is not None:
        moved, _ = misplaced(position, candidates.grids, facets, offset, rotation)
        return candidates.read(channel_rows(position, moved, field, facets=facets, thickness=thickness))
    return channel_matrix(position, candidates, facets, thickness) @ np.asarray(field).reshape(3 * len(position), -1)


def fits(position: np.ndarray, candidates: Candidates, facets: Facets | Skin | None = None) -> np.ndarray:
    """Whether the grids of each channel's gauge (m,) lie on the surface without running over a sharp edge (over 30°)."""
    if not np.any(candidates.grids.length > 0):
        return np.ones(len(candidates), dtype=bool)
    grids = candidates.grids
    return ~candidates.any_grid(~stays(surface_of(position, grids, facets), grids)[grids.gauge])


def channel_matrix(
    position: np.ndarray,
    candidates: Candidates,
    facets: Facets | Skin | None = None,
    thickness: Thickness | None = None,
) -> sparse.csr_array:
    """Rows (m, 3n) of the facets' own shape functions, for displacements z of the nodes, row 3·node + component:

        strain at a point     ε = dᵀ sym(∇z) d = d·(∂z/∂s),    ∂Nₖ/∂s = d · J(JᵀJ)⁻¹ ∂Nₖ/∂ξ,    J = ∂x/∂ξ
        over a grid of length L     the mean of ε over −L/2 ≤ s ≤ L/2 along d, facet by facet
        motion     d·z = d·Σ Nₖ zₖ
        a bridge   Σₖ sₖ εₖ over its arms

    A gauge's d is tangent to the facet, so the surface gradient is all of ∇z that counts; along a grid it is carried with
    the surface.
    position (n, 3) [m]; candidates (m); facets of the whole surface, where a grid may reach beyond the facet of its
    centre (without them the facets that carry candidates are the surface); thickness: of shells that are thicker than those
    of the mesh, whose faces move as displacements of the nodes of the mesh say; gauges sit at the same ξ of the same facet.
    Raises InfeasibleError where a grid runs over a sharp edge or the end of the surface.
    """
    return matrix_of(position, points_within(position, candidates, facets), len(candidates), thickness)


def points_within(position: np.ndarray, candidates: Candidates, facets: Facets | Skin | None = None) -> Points:
    """The points that every channel sums or averages over. Raises InfeasibleError as `channel_matrix`."""
    grids = candidates.grids
    points, well = points_of(position, grids, facets)
    if not well.all():
        first = int(np.argmin(well))
        raise InfeasibleError(
            f"the grid of {np.count_nonzero(~well)} of {len(well)} channels runs over a sharp edge "
            f"(element {grids.element[first]}, facet {grids.facet[first]}, "
            f"grid {grids.length[first]:.3g} m long)",
            remedy="a shorter grid, or none near edges: "
            f"exclude: [{{near_edges: {0.5 * float(grids.length[first]):.3g}}}]",
        )
    if candidates.arms is None:
        return points
    weight = points.weight * candidates.sign_of_grid[points.channel]
    return replace(points, channel=candidates.channel_of_grid[points.channel], weight=weight)


def matrix_of(
    position: np.ndarray, points: Points, channels: int, thickness: Thickness | None = None
) -> sparse.csr_array:
    """The rows of `channel_matrix` (channels, 3n) from the points of the channels."""
    if thickness is not None:
        found, ratio = sparse.csr_array((channels, 3 * len(position))), thickness.ratio_of(points.element)
        for own in np.unique(ratio):
            G = thickness.moved(own)
            there = (G @ position.ravel()).reshape(position.shape)
            found = found + matrix_of(there, points.take(ratio == own), channels) @ G
        return sparse.csr_array(found)
    entries = [_entries(position, points.take(part), kind) for kind, part, _ in by_kind(points.kind, points.nodes)]
    value, row, column = (
        (np.concatenate(parts) for parts in zip(*entries, strict=True)) if entries else (np.zeros(0),) * 3
    )
    shape_ = (channels, 3 * len(position))
    return sparse.csr_array(sparse.coo_array((value, (row.astype(int), column.astype(int))), shape=shape_))


def _entries(position: np.ndarray, points: Points, kind: Kind) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, row and column of every entry of the points (p) on facets of one kind."""
    N = kind.shape(points.local)
    nodes = points.nodes[:, : N.shape[1]]
    d = points.direction
    strain = points.quantity == STRAIN
    if strain.any() and not len(kind.read_at):
        _, J = facet_points(kind, position[nodes[strain]], points.local[strain])
        # d in the dual base of the tangents: solve (JᵀJ) s = Jᵀd.
        s = np.linalg.solve(np.swapaxes(J, 1, 2) @ J, np.einsum("mca,mc->ma", J, d[strain])[..., None])
        N[strain] = (kind.gradient(points.local[strain]) @ s)[..., 0]
    value = (points.weight[:, None] * N)[..., None] * d[:, None]
    if strain.any() and len(kind.read_at):
        own = _read(kind, position[nodes[strain]], points.local[strain], d[strain])
        value[strain] = points.weight[strain, None, None] * own
    row = np.broadcast_to(points.channel[:, None, None], value.shape)
    column = 3 * nodes[..., None] + np.arange(3)
    return value.ravel(), row.ravel(), column.ravel()


def _read(kind: Kind, corners: np.ndarray, xi: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Rows (m, k, 3) of the strain along d (m, 3) at xi (m, 2), from the points where the facet's strain is read, d carried there
    over the bent surface, of triangles from strains along their sides; corners (m, k, 3) [m] all nodes of the facets."""
    _, J = facet_points(kind, corners, xi)
    normal, share = normals(J), kind.reading(xi)
    found, along_side = np.zeros(corners.shape), d[:, None]
    if kind.read_along:
        _, J = facet_points(kind, corners, np.broadcast_to(kind.centre, xi.shape))
        centre = normals(J)
        in_base = np.einsum("mca,mc->ma", J, carried(d, normal, centre))[..., None]
        a, b = np.linalg.solve(np.swapaxes(J, 1, 2) @ J, in_base)[..., 0].T
        normal, along_side = centre, np.stack([J[..., 0], J[..., 1], J[..., 1] - J[..., 0]], axis=1)
        share = share * np.stack([a * a + a * b, b * b + a * b, -a * b], axis=1)[:, list(kind.read_along)]
    for point, weight, side in zip(kind.read_at, share.T, kind.read_along or (0,) * 4, strict=True):
        at = np.broadcast_to(point, xi.shape)
        _, J = facet_points(kind, corners, at)
        along = carried(along_side[:, side], normal, normals(J))
        s = np.linalg.solve(np.swapaxes(J, 1, 2) @ J, np.einsum("mca,mc->ma", J, along)[..., None])
        slope = (kind.gradient(at) @ s)[..., 0]
        found += (weight[:, None] * slope)[..., None] * along[:, None]
    return found
