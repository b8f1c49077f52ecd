"""The points of the surface that a channel averages over."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from strainsight.mesh.facets import Facets, facet_key
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.surface import by_kind, carried, facet_points, normals
from strainsight.sensors.walk import Skin, Trail, local_at, skin_of, walk

GAUSS = 0.5 + np.sqrt(1 / 12) * np.array([-1.0, 1.0])
WEIGHT = np.array([0.5, 0.5])
"""Gauss-Legendre on [0, 1], exact to degree 3, which is that of the strain along a line on a straight facet."""


@dataclass(frozen=True)
class Points:
    """p points: channel (p,), element (p,) its id, kind (p,), nodes (p, 8), local (p, 2) ξ, direction (p, 3), quantity (p,),
    weight (p,), which adds up to 1 over a grid, of a bridge to the sign of the grid."""

    channel: np.ndarray
    element: np.ndarray
    kind: np.ndarray
    nodes: np.ndarray
    local: np.ndarray
    direction: np.ndarray
    quantity: np.ndarray
    weight: np.ndarray

    def take(self, index: np.ndarray) -> Points:
        """Those at `index`."""
        return Points(*(getattr(self, entry.name)[index] for entry in fields(self)))


def surface_of(position: np.ndarray, candidates: Candidates, facets: Facets | Skin | None) -> Skin:
    """The surface that the candidates lie on; without facets that of the facets that carry one."""
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


def points_of(position: np.ndarray, candidates: Candidates, facets: Facets | Skin | None) -> tuple[Points, np.ndarray]:
    """The points of every channel of one grid, and which channels (m,) have a grid that stays on the surface.

    A channel without a grid has the point of its ξ. A grid is walked from its centre both ways, and every piece of it on one
    facet has the two points of Gauss, so that the jumps of strain from facet to facet are averaged and not sampled.
    """
    spread = candidates.length > 0
    at = np.flatnonzero(~spread)
    single = Points(
        at,
        candidates.element[at],
        candidates.kind[at],
        candidates.nodes[at],
        candidates.local[at],
        candidates.direction[at],
        candidates.quantity[at],
        np.ones(len(at)),
    )
    well = np.ones(len(candidates), dtype=bool)
    if not spread.any():
        return single, well
    grid, well[spread] = _grids(surface_of(position, candidates, facets), candidates, np.flatnonzero(spread))
    return Points(*(np.concatenate([getattr(p, e.name) for p in (single, grid)]) for e in fields(Points))), well


def stays(skin: Skin, candidates: Candidates) -> np.ndarray:
    """Which gauges (gauges,) have all their grids on the surface, not over a sharp edge or its end."""
    which = np.flatnonzero(candidates.length > 0)
    trail, _ = _ways(skin, candidates, which)
    bad = np.zeros(candidates.gauges, dtype=bool)
    bad[candidates.gauge[np.tile(which, 2)[~trail.reached]]] = True
    return ~bad


def _ways(skin: Skin, candidates: Candidates, which: np.ndarray) -> tuple[Trail, np.ndarray]:
    """The walks from the centres of the channels `which` (k,) forward to the ends of their grids, then those backward, and
    their directions (2k, 3)."""
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


def _grids(skin: Skin, candidates: Candidates, which: np.ndarray) -> tuple[Points, np.ndarray]:
    """The points of the channels `which` (k,), and whether their grids stay on the surface (k,)."""
    k, both = len(which), np.tile(which, 2)
    origin, normal = candidates.position[both], candidates.normal[both]
    trail, ahead = _ways(skin, candidates, which)
    covered = trail.end - trail.begin
    piece = np.repeat(np.flatnonzero(covered > 0), len(GAUSS))
    walker, facet = trail.walker[piece], trail.facet[piece]
    u = trail.begin[piece] + np.tile(GAUSS, len(piece) // len(GAUSS)) * covered[piece]
    plane = np.stack([ahead[walker], np.cross(normal[walker], ahead[walker])], axis=1)
    local, found = local_at(skin, facet, origin[walker], plane, np.column_stack([u, np.zeros(len(u))]))
    channel = both[walker]
    points = Points(
        channel,
        skin.facets.element_id[facet],
        skin.facets.kind[facet],
        skin.facets.nodes[facet],
        local,
        carried(candidates.direction[channel], normal[walker], normals_at(skin, facet, local)),
        candidates.quantity[channel],
        np.tile(WEIGHT, len(piece) // len(GAUSS)) * covered[piece] / candidates.length[channel],
    )
    well = trail.reached[:k] & trail.reached[k:]
    well[walker[~found] % k] = False
    return points, well


def normals_at(skin: Skin, facet: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Outward unit normals (p, 3) at ξ (p, 2) of the facets (p,)."""
    n = np.zeros((len(facet), 3))
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        _, J = facet_points(kind, skin.position[nodes], local[which])
        n[which] = normals(J)
    return n
