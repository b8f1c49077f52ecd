"""Strain operator (matrix H) of gauges: readings in a displacement field, and the surface points that they average."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy import sparse

from strainsight.errors import InfeasibleError
from strainsight.mesh.facets import Facets, by_kind, facet_key
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.properties import Thickness
from strainsight.sensors.candidates import STEEPEST, STRAIN, Candidates, tangents
from strainsight.sensors.surface import carried, facet_points, normals, tangent, turned
from strainsight.sensors.surface_paths import Skin, Trail, local_at, skin_of, walk

GAUSS = 0.5 + np.sqrt(1 / 12) * np.array([-1.0, 1.0])
WEIGHT = np.array([0.5, 0.5])
"""Gauss-Legendre on [0, 1], exact to degree 3, the degree of the strain along a line on a straight facet."""


@dataclass(frozen=True)
class ChannelPoints:
    """p points: channel (p,), element (p,) its id, kind (p,), nodes (p, 8), local (p, 2) ξ, direction (p, 3), quantity (p,),
    weight (p,), with the sum 1 over a grid, times the sign of the grid in a bridge."""

    channel: np.ndarray
    element: np.ndarray
    kind: np.ndarray
    nodes: np.ndarray
    local: np.ndarray
    direction: np.ndarray
    quantity: np.ndarray
    weight: np.ndarray

    def take(self, index: np.ndarray) -> ChannelPoints:
        """The points at `index`."""
        return ChannelPoints(*(getattr(self, entry.name)[index] for entry in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence[ChannelPoints]) -> ChannelPoints:
        """All points of the parts."""
        return cls(*(np.concatenate([getattr(part, entry.name) for part in parts]) for entry in fields(cls)))


def surface_of(position: np.ndarray, candidates: Candidates, facets: Facets | Skin | None) -> Skin:
    """The surface of the candidates; without facets it consists of the facets that carry a candidate."""
    if isinstance(facets, Skin):
        return facets
    if facets is None:
        candidates = candidates.grids
        _, first = np.unique(facet_key(candidates.element, candidates.facet), return_index=True)
        facets = Facets(
            candidates.element[first],
            candidates.facet[first],
            candidates.kind[first],
            candidates.nodes[first],
            region=np.zeros(len(first), dtype=np.int64),
        )
    return skin_of(position, facets)


def stays(skin: Skin, candidates: Candidates) -> np.ndarray:
    """Which gauges (gauges,) have all their grids on the surface, without crossing a sharp edge or its end."""
    which = np.flatnonzero(candidates.length > 0)
    trail, _ = _grid_trails(skin, candidates, which)
    bad = np.zeros(candidates.gauges, dtype=bool)
    bad[candidates.gauge[np.tile(which, 2)[~trail.reached]]] = True
    return ~bad


def _grid_trails(skin: Skin, candidates: Candidates, which: np.ndarray) -> tuple[Trail, np.ndarray]:
    """The trails from the centres of the channels `which` (k,) forward to the ends of their grids, then those backward, and their
    directions (2k, 3)."""
    both = np.tile(which, 2)
    ahead = np.repeat([1.0, -1.0], len(which))[:, None] * candidates.direction[both]
    start = skin.index_of(candidates.element[which], candidates.facet[which])
    return walk(
        skin,
        np.tile(start, 2),
        candidates.position[both],
        candidates.normal[both],
        ahead,
        0.5 * candidates.length[both],
    ), ahead


def _grids(skin: Skin, candidates: Candidates, which: np.ndarray) -> tuple[ChannelPoints, np.ndarray]:
    """The points of the channels `which` (k,), and whether their grids stay on the surface (k,)."""
    k, both = len(which), np.tile(which, 2)
    origin, normal = candidates.position[both], candidates.normal[both]
    trail, ahead = _grid_trails(skin, candidates, which)
    covered = trail.end - trail.begin
    piece = np.repeat(np.flatnonzero(covered > 0), len(GAUSS))
    walker, facet = trail.walker[piece], trail.facet[piece]
    u = trail.begin[piece] + np.tile(GAUSS, len(piece) // len(GAUSS)) * covered[piece]
    plane = np.stack([ahead[walker], np.cross(normal[walker], ahead[walker])], axis=1)
    local, is_inside = local_at(skin, facet, origin[walker], plane, np.column_stack([u, np.zeros(len(u))]))
    channel = both[walker]
    points = ChannelPoints(
        channel,
        skin.facets.element_id[facet],
        skin.facets.kind[facet],
        skin.facets.nodes[facet],
        local,
        carried(candidates.direction[channel], normal[walker], skin.frames(facet, local)[1]),
        candidates.quantity[channel],
        np.tile(WEIGHT, len(piece) // len(GAUSS)) * covered[piece] / candidates.length[channel],
    )
    complete = trail.reached[:k] & trail.reached[k:]
    complete[walker[~is_inside] % k] = False
    return points, complete


HALVINGS = 12


def misplaced(
    position: np.ndarray,
    candidates: Candidates,
    facets: Facets | Skin | None,
    offset: np.ndarray | None = None,
    rotation: np.ndarray | None = None,
) -> tuple[Candidates, np.ndarray]:
    """Move gauges over the surface and rotate them; also returns which of them (gauges,) a sharp edge limits.

    offset (gauges, 2) [m] along the `installation_axes` of each gauge, in its tangent plane; rotation (gauges,) [deg],
    right-handed about the normal. All channels of a gauge move as one, and their directions follow the surface without rotation
    about the normal. A point gauge stops at a sharp edge; a gauge with grids is moved and rotated by the largest share of the
    target that leaves its grids on the surface.
    position (n, 3) [m]; candidates: grids of bridges are gauges here (`Candidates.grids`); facets of the whole surface (None:
    those that carry candidates)."""
    gauges = candidates.gauges
    offset = np.zeros((gauges, 2)) if offset is None else np.asarray(offset, dtype=float)
    rotation = np.zeros(gauges) if rotation is None else np.asarray(rotation, dtype=float)
    skin = surface_of(position, candidates, facets)
    moved, limited = _move(skin, candidates, offset, rotation)
    has_grid = np.zeros(gauges, dtype=bool)
    has_grid[candidates.gauge[candidates.length > 0]] = True
    if not has_grid.any():
        return moved, limited
    to_shorten = np.flatnonzero((limited | ~stays(skin, moved)) & has_grid)
    if not len(to_shorten):
        return moved, limited
    part = candidates.take(candidates.channels(to_shorten))
    low, high = np.zeros(len(to_shorten)), np.ones(len(to_shorten))
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        tried, blocked = _move(skin, part, share[:, None] * offset[to_shorten], share * rotation[to_shorten])
        feasible = ~blocked & stays(skin, tried)
        low, high = np.where(feasible, share, low), np.where(feasible, high, share)
    share = np.ones(gauges)
    share[to_shorten] = low
    moved, limited = _move(skin, candidates, share[:, None] * offset, share * rotation)
    limited[to_shorten] = True
    return moved, limited


def installation_axes(candidates: Candidates) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangents e₁ and e₂ = n × e₁ (gauges, 3), the axes of offsets: e₁ ∥ d − (d·n) n of the first channel of a gauge, or
    from `tangents` if d is within 10° of n."""
    first = candidates.take(candidates.first)
    n = first.normal
    upright = np.abs(np.sum(first.direction * n, axis=1)) > np.cos(np.deg2rad(STEEPEST))
    e1 = tangent(np.where(upright[:, None], tangents(n), first.direction), n)
    return e1, np.cross(n, e1)


def _move(
    skin: Skin, candidates: Candidates, offset: np.ndarray, rotation: np.ndarray
) -> tuple[Candidates, np.ndarray]:
    first = candidates.take(candidates.first)
    n = first.normal
    e1, e2 = installation_axes(candidates)
    distance = np.linalg.norm(offset, axis=1)
    ahead = (offset[:, :1] * e1 + offset[:, 1:] * e2) / np.where(distance > 0, distance, 1.0)[:, None]
    go = np.flatnonzero(distance > 0)
    start = skin.index_of(first.element, first.facet)
    trail = walk(skin, start[go], first.position[go], n[go], ahead[go], distance[go])
    plane = np.stack([ahead[go], np.cross(n[go], ahead[go])], axis=1)
    target = np.column_stack([trail.length, np.zeros(len(go))])
    local, facet = first.local.copy(), start
    new_local, ok = local_at(skin, trail.last, first.position[go], plane, target)
    local[go[ok]], facet[go[ok]] = new_local[ok], trail.last[ok]
    limited = np.zeros(len(first), dtype=bool)
    limited[go] = ~(trail.reached & ok)
    x, after = skin.frames(facet, local)
    g = candidates.gauge
    return replace(
        candidates,
        **skin.facets.columns(facet[g]),
        position=x[g],
        normal=after[g],
        direction=turned(carried(candidates.direction, n[g], after[g]), after[g], rotation[g]),
        local=local[g],
    ), limited


def channel_rows(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    *,
    facets: Facets | Skin | None = None,
    thickness: Thickness | None = None,
) -> np.ndarray:
    """Readings of every channel in every displacement field: `channel_matrix` times the field.

    field (3n, r) [m per unit], row 3·node + component. An accelerometer has the row of a displacement sensor, to be applied to
    accelerations. Returns (m, r) [strain or m per unit]. Raises InfeasibleError if the grid of a gauge crosses a sharp edge."""
    return channel_matrix(position, candidates, facets, thickness) @ np.asarray(field).reshape(3 * len(position), -1)


def fits(position: np.ndarray, candidates: Candidates, facets: Facets | Skin | None = None) -> np.ndarray:
    """Whether the grids of the gauge of each channel (m,) are on the surface without crossing a sharp edge (over 30°)."""
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
    """Strain operator H (m, 3n) from the shape functions of the facets, for nodal displacements z, row 3·node + component:

        strain at a point     ε = dᵀ sym(∇z) d = d·(∂z/∂s),    ∂Nₖ/∂s = d · J(JᵀJ)⁻¹ ∂Nₖ/∂ξ,    J = ∂x/∂ξ
        over a grid of length L     the mean of ε over −L/2 ≤ s ≤ L/2 along d, facet by facet
        motion     d·z = d·Σ Nₖ zₖ
        a bridge   Σₖ sₖ εₖ over its arms

    The direction d of a gauge is tangent to the facet, so only the surface gradient of z counts; along a grid it follows the
    surface.
    position (n, 3) [m]; candidates (m); facets of the whole surface, where a grid may extend over several facets (default: the
    facets that carry candidates); thickness: of shells that are thicker than those of the mesh, whose faces follow the
    displacements of its nodes; gauges keep ξ and facet. Raises InfeasibleError if a grid crosses a sharp edge or the end of the
    surface."""
    return matrix_of(position, points_within(position, candidates, facets), len(candidates), thickness)


def points_within(position: np.ndarray, candidates: Candidates, facets: Facets | Skin | None = None) -> ChannelPoints:
    """The points that every channel sums or averages.

    A channel without a grid has the point ξ. A grid is followed from its centre in both directions, and each of its pieces on one
    facet has two Gauss points, so that the jumps of strain between facets are averaged.
    Raises InfeasibleError as `channel_matrix`."""
    grids = candidates.grids
    at, which = (np.flatnonzero(each) for each in (grids.length == 0, grids.length > 0))
    columns = (getattr(grids, entry.name)[at] for entry in fields(ChannelPoints)[1:-1])
    points = ChannelPoints(*(at, *columns, np.ones(len(at))))
    if len(which):
        along, complete = _grids(surface_of(position, grids, facets), grids, which)
        if not complete.all():
            first = int(which[np.argmin(complete)])
            raise InfeasibleError(
                f"{np.count_nonzero(~complete)} of {len(grids)} channels have a measuring grid that crosses a sharp edge "
                f"(first: element {grids.element[first]}, facet {grids.facet[first]}, "
                f"grid {grids.length[first]:.3g} m long)",
                remedy="Use a shorter measuring grid, or exclude positions near edges: "
                f"gauges.exclude: [{{near_edges: {0.5 * float(grids.length[first]):.3g}}}].",
            )
        points = ChannelPoints.joined([points, along])
    if candidates.arms is None:
        return points
    weight = points.weight * candidates.sign_of_grid[points.channel]
    return replace(points, channel=candidates.channel_of_grid[points.channel], weight=weight)


def matrix_of(
    position: np.ndarray, points: ChannelPoints, channels: int, thickness: Thickness | None = None
) -> sparse.csr_array:
    """The rows of `channel_matrix` (channels, 3n) from the points of the channels."""
    if thickness is not None:
        total, ratio = sparse.csr_array((channels, 3 * len(position))), thickness.ratio_of(points.element)
        for value in np.unique(ratio):
            G = thickness.moved(value)
            moved_position = (G @ position.ravel()).reshape(position.shape)
            total = total + matrix_of(moved_position, points.take(ratio == value), channels) @ G
        return sparse.csr_array(total)
    entries = [_entries(position, points.take(part), kind) for kind, part, _ in by_kind(points.kind, points.nodes)]
    value, row, column = (
        (np.concatenate(parts) for parts in zip(*entries, strict=True)) if entries else (np.zeros(0),) * 3
    )
    shape_ = (channels, 3 * len(position))
    return sparse.csr_array(sparse.coo_array((value, (row.astype(int), column.astype(int))), shape=shape_))


def _entries(position: np.ndarray, points: ChannelPoints, kind: Kind) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, row and column of every entry of the points (p) on facets of one kind."""
    N = kind.shape(points.local)
    nodes = points.nodes[:, : N.shape[1]]
    d = points.direction
    strain = points.quantity == STRAIN
    if strain.any() and not len(kind.read_at):
        _, J = facet_points(kind, position[nodes[strain]], points.local[strain])
        # d in the dual basis of the tangents: solve (JᵀJ) s = Jᵀd
        s = np.linalg.solve(np.swapaxes(J, 1, 2) @ J, np.einsum("mca,mc->ma", J, d[strain])[..., None])
        N[strain] = (kind.gradient(points.local[strain]) @ s)[..., 0]
    value = (points.weight[:, None] * N)[..., None] * d[:, None]
    if strain.any() and len(kind.read_at):
        gradient = _strain_from_reading_points(kind, position[nodes[strain]], points.local[strain], d[strain])
        value[strain] = points.weight[strain, None, None] * gradient
    row = np.broadcast_to(points.channel[:, None, None], value.shape)
    return value.ravel(), row.ravel(), (3 * nodes[..., None] + np.arange(3)).ravel()


def _strain_from_reading_points(kind: Kind, corners: np.ndarray, xi: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Rows (m, k, 3) of the strain along d (m, 3) at xi (m, 2), from the points where the strain of the facet is evaluated; d
    follows the curved surface; for triangles from strains along their sides; corners (m, k, 3) [m] all nodes of the facets."""
    _, J = facet_points(kind, corners, xi)
    normal, share = normals(J), kind.reading(xi)
    rows, along_side = np.zeros(corners.shape), d[:, None]
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
        rows += (weight[:, None] * slope)[..., None] * along[:, None]
    return rows
